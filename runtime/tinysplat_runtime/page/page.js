// Puts the page together: its panel, its camera, and frames whenever something changed.
"use strict";

const scene = JSON.parse(document.getElementById("scene").textContent);
const find = (id) => document.getElementById(id);
const SLOW_MS = 45; // a frame that takes longer is drawn with fewer pixels while things move
const COARSEST = 0.25;

async function packedData() { // within the page, or beside it on the server that serves it
  const text = find("data").textContent.trim();
  if (!text) return new Uint8Array(await (await fetch("data")).arrayBuffer());
  return Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
}

// Corners of the cameras' pictures, a little way in front of them, as lines (…, 3).
function frusta(views, size) {
  const lines = [];
  for (const { K: [fx, skew, fy, cx, cy], width, height, rotation, position } of views) {
    const corner = (u, v) => {
      const y = (v - cy) / fy, x = (u - cx - skew * y) / fx;
      return add(add(add(position, rotation[0], x * size), rotation[1], y * size), rotation[2], size);
    };
    const [a, b, c, d] = [corner(0, 0), corner(width, 0), corner(width, height), corner(0, height)];
    lines.push(position, a, position, b, position, c, position, d, a, b, b, c, c, d, d, a);
  }
  return new Float32Array(lines.flat());
}

function element(tag, text) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  return made;
}

function fillClasses() {
  const total = Object.values(scene.bytes).reduce((sum, n) => sum + n, 0);
  if (!total) return;
  const table = element("table");
  for (const [name, bytes] of Object.entries(scene.bytes)) {
    const row = table.insertRow();
    row.insertCell().textContent = name;
    row.insertCell().textContent = `${(bytes / 1000).toFixed(1)} KB`;
    const bar = element("div"), cell = table.insertRow().insertCell();
    bar.className = "bar";
    bar.style.width = `${(100 * bytes) / total}%`;
    cell.colSpan = 2;
    cell.append(bar);
  }
  find("classes").append(table);
}

class Page {
  constructor(cloud, options) {
    this.canvas = find("view");
    this.isBare = options.has("bare");
    this.splats = new Splats(this.canvas, cloud, () => this.change());
    this.camera = new Camera(scene.views[0], scene.reach);
    this.controls = new Controls(this.canvas, this.camera, scene.up, { moved: () => this.move(), picked: (x, y) => this.#pick(x, y) });
    this.lines = scene.hasCameras ? frusta(scene.views, 0.04 * scene.reach) : null;
    this.last = 0;
    this.share = 1;
    this.time = 0;
    this.#fillPanel();
    new ResizeObserver(() => this.#fit()).observe(this.canvas);
    this.#fit();
    const first = Number(options.get("camera") ?? 0);
    this.select(scene.views[first] ? first : 0);
    requestAnimationFrame((now) => this.#frame(now));
  }

  #fillPanel() {
    find("summary").textContent = scene.summary;
    document.body.classList.toggle("bare", this.isBare);
    if (Math.min(innerWidth, innerHeight) < 600) find("panel").open = false;
    fillClasses();
    find("linesRow").hidden = find("views").hidden = !scene.hasCameras;
    this.buttons = scene.views.map((_, i) => {
      const button = element("button", `view ${i}`);
      button.onclick = () => this.select(i);
      return button;
    });
    find("views").append(...this.buttons);
    find("degree").max = find("degree").value = Math.sqrt(this.splats.cloud.functions) - 1;
    find("degreeRow").hidden = this.splats.cloud.functions === 1;
    for (const id of ["degree", "opacity", "depth", "lines", "own"]) find(id).oninput = () => this.change();
    find("near").oninput = () => this.move();
    find("nearRow").hidden = !scene.viewDepth;
    find("ownRow").hidden = !scene.columns.some(([name]) => name === "view");
    find("fly").onchange = () => { this.controls.flies = find("fly").checked; };
    find("swing").onchange = () => { this.centre = null; this.change(); };
    find("photoPlace").onchange = () => this.#showPhoto();
  }

  #fit() {
    const ratio = this.isBare ? 1 : Math.min(devicePixelRatio, 2);
    this.canvas.width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    this.canvas.height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    this.change();
  }

  // Stands where view i was taken from.
  select(i) {
    this.current = i;
    this.camera.set(scene.views[i], scene.reach);
    this.centre = null;
    this.#showPhoto();
    this.move();
    this.buttons.forEach((button, n) => button.setAttribute("aria-pressed", n === i));
  }

  #showPhoto() {
    const { photo } = scene.views[this.current], place = find("photoPlace").value;
    find("photoRow").hidden = !photo;
    find("photo").hidden = !photo || place === "off";
    find("photo").className = place;
    if (photo) find("photo").src = photo;
  }

  // The camera has moved: Gaussians need another order.
  move() {
    if (find("photo").className === "over" && this.controls?.isMoving) find("photo").hidden = true;
    if (this.splats.isSorted) this.splats.sort(this.camera, scene.nearPlane, this.shares());
    else this.waits = true;
    this.change();
  }

  change() { // a frame is drawn when something changed, so that a still page takes no power
    delete document.body.dataset.ready;
    this.isDirty = true;
  }

  // Turns about the point under a pixel: the middle of the nearest Gaussians that show there.
  #pick(x, y) {
    const { means, opacities } = this.splats.cloud, { clientWidth, clientHeight } = this.canvas;
    const { projection: P, principal, focals } = this.camera.fitted(clientWidth, clientHeight), depths = [];
    for (let i = 0; i < opacities.length; i++) {
      if (opacities[i] < 64) continue;
      const ray = add(means.subarray(3 * i, 3 * i + 3), this.camera.position, -1), z = dot(P.slice(6), ray);
      if (z <= scene.nearPlane) continue;
      const dx = dot(P.slice(0, 3), ray) / z + principal[0] - x, dy = dot(P.slice(3, 6), ray) / z + principal[1] - y;
      if (dx * dx + dy * dy < 64) depths.push(z);
    }
    if (!depths.length) return;
    const depth = depths.sort((a, b) => a - b)[depths.length >> 2], [right, down, forward] = this.camera.rotation;
    const u = (x - principal[0]) / focals[0], v = (y - principal[1]) / focals[1];
    const point = add(add(add(this.camera.position, right, u * depth), down, v * depth), forward, depth);
    const to = add(point, this.camera.position, -1), distance = Math.hypot(...to);
    this.camera.swing(scene.up, -Math.atan2(dot(to, right), dot(to, forward)), -Math.atan2(dot(to, down), dot(to, forward)));
    this.camera.reach = distance;
    this.move();
  }

  // How much of their opacity views' surfaces are drawn first with from here: render/near.py has the definition.
  shares() {
    const shares = new Float32Array(MAX_VIEWS);
    if (!scene.viewDepth || !find("near").checked) return shares;
    const { position, rotation } = this.camera, length = (v) => Math.hypot(...v);
    const distances = scene.views.map((view) => Math.hypot(
      length(add(position, view.position, -1)) / scene.viewDepth, length(add(rotation[2], view.rotation[2], -1))));
    const [nearest, second] = [...distances].sort((a, b) => a - b), reach = 1.5 * second;
    distances.forEach((distance, v) => {
      if (reach <= nearest) shares[v] = distance <= nearest ? 1 : 0;
      else shares[v] = Math.max(0, Math.min(1, (reach - distance) / (reach - nearest))) ** 2;
    });
    return shares;
  }

  drawing() {
    for (const id of ["degree", "opacity"]) find(id).parentElement.querySelector("output").textContent = find(id).value;
    return {
      nearPlane: scene.nearPlane, shares: this.shares(), ownPixels: find("own").checked, degree: Number(find("degree").value), leastOpacity: Number(find("opacity").value),
      depth: find("depth").checked, lines: find("lines").checked && !this.isBare ? this.lines : null,
    };
  }

  // A gentle swing about the target, for as long as it is asked for.
  #swing(seconds) {
    this.centre ??= { rotation: this.camera.rotation, position: this.camera.position, target: this.camera.target };
    this.time += seconds;
    Object.assign(this.camera, { rotation: this.centre.rotation, position: this.centre.position });
    this.camera.swing(scene.up, 0.12 * Math.sin(this.time), 0.05 * Math.cos(this.time) - 0.05, this.centre.target);
    this.move();
  }

  #frame(now) {
    const elapsed = Math.min(now - this.last, 250);
    this.last = now;
    this.controls.step(elapsed / 1000);
    const swings = find("swing").checked && !this.controls.isMoving;
    if (swings) this.#swing(elapsed / 1000);
    else this.centre = null;
    if (this.waits && this.splats.isSorted) {
      this.waits = false;
      this.splats.sort(this.camera, scene.nearPlane, this.shares());
    }
    const moves = swings || this.controls.isMoving;
    if (this.isDirty || (!moves && this.share < 1)) {
      if (!moves || this.isBare) this.share = 1;
      else if (elapsed > SLOW_MS && this.wasMoving) this.share = Math.max(this.share / 2, COARSEST);
      this.isDirty = false;
      this.splats.draw(this.camera, this.drawing(), this.share);
      if (this.splats.isSorted && !this.waits && this.share === 1) document.body.dataset.ready = find("opacity").value;
    }
    this.wasMoving = moves;
    requestAnimationFrame((next) => this.#frame(next));
  }
}

function fail(error) {
  find("fault").textContent = `This page cannot show the scene: ${error.message ?? error}`;
  find("fault").hidden = false;
  console.error(error);
}

async function main() {
  const options = new URLSearchParams(location.search.slice(1) || location.hash.slice(1));
  globalThis.page = new Page(await unpack(scene, await packedData()), options); // for the console, and for checks
}

main().catch(fail);
