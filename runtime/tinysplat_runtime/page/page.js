// Puts the page together: its scene, its panel and its words.
import { makeCloud } from "./cloud.js";
import { unpack } from "./unpack.js";
import { Viewer } from "./viewer.js";

const find = (id) => document.getElementById(id);
const MANY_VIEWS = 12; // from which a slider chooses among them
const HINT_MS = 9000;
const WORDS = { // classes of bytes, as visitors may call them
  depth: "distances", color: "colours", opacity: "transparency", scale: "sizes", rotation: "directions", offset: "fine positions",
  metadata: "description", photos: "photos",
};

function element(tag, text) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  return made;
}

async function packedData() { // within the page, or beside it on the server that serves it
  const text = find("data").textContent.trim();
  if (!text) return new Uint8Array(await (await fetch("data")).arrayBuffer());
  return Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
}

function fillClasses(bytes) {
  const shown = Object.entries(bytes).filter(([, n]) => n > 0), total = shown.reduce((sum, [, n]) => sum + n, 0), table = element("table");
  for (const [name, n] of shown) {
    const row = table.insertRow();
    row.insertCell().textContent = WORDS[name] ?? name;
    row.insertCell().textContent = `${(n / 1000).toFixed(1)} KB`;
    const bar = element("div"), cell = table.insertRow().insertCell();
    bar.className = "bar";
    bar.style.width = `${(100 * n) / total}%`;
    cell.colSpan = 2;
    cell.append(bar);
  }
  find("classes").replaceChildren(...(total ? [table] : []));
}

class Panel {
  constructor(viewer, scene, cloud) {
    Object.assign(this, { viewer, scene });
    const { views, hasCameras } = scene, isMany = views.length > MANY_VIEWS;
    find("caption").textContent = scene.caption;
    find("summary").textContent = scene.summary;
    fillClasses(scene.bytes);
    find("views").hidden = !hasCameras || isMany || views.length < 2;
    find("placeRow").hidden = !hasCameras || !isMany;
    find("linesRow").hidden = find("freeRow").hidden = find("nearRow").hidden = find("ownRow").hidden = !hasCameras;
    find("fliesRow").hidden = hasCameras;
    this.buttons = isMany ? [] : views.map((_, i) => {
      const button = element("button", `photo ${i + 1}`);
      button.type = "button";
      button.onclick = () => this.select(i);
      return button;
    });
    find("views").replaceChildren(...this.buttons);
    find("place").max = views.length - 1;
    find("degree").max = find("degree").value = Math.sqrt(cloud.functions) - 1;
    find("degreeRow").hidden = cloud.functions === 1;
    this.#listen();
    this.shown();
  }

  #listen() {
    const { viewer } = this, { settings } = viewer;
    find("place").oninput = () => this.select(Number(find("place").value));
    for (const [id, name, value] of [["depth", "depth", "checked"], ["lines", "lines", "checked"], ["own", "ownPixels", "checked"], ["near", "nearFirst", "checked"], ["degree", "degree", "value"], ["opacity", "leastOpacity", "value"]]) {
      find(id).oninput = () => {
        settings[name] = value === "value" ? Number(find(id).value) : find(id).checked;
        viewer.move();
        this.shown();
      };
    }
    find("swing").checked = viewer.isSwinging;
    find("swing").onchange = () => viewer.swing(find("swing").checked);
    find("free").onchange = () => {
      viewer.setFree(find("free").checked);
      find("fliesRow").hidden = !find("free").checked;
    };
    find("flies").onchange = () => { viewer.free.flies = find("flies").checked; };
    find("photoPlace").onchange = () => this.shown();
    find("back").onclick = () => { viewer.back(); viewer.canvas.focus(); };
  }

  select(i) {
    this.viewer.select(i);
    this.shown();
  }

  shown() {
    const { viewer, scene } = this, { current } = viewer, { photo } = scene.views[current], place = find("photoPlace").value;
    for (const id of ["degree", "opacity"]) find(id).parentElement.querySelector("output").textContent = find(id).value;
    find("place").parentElement.querySelector("output").textContent = current + 1;
    this.buttons.forEach((button, n) => button.setAttribute("aria-pressed", String(n === current && !viewer.isAway)));
    find("swing").checked = viewer.isSwinging;
    find("photoRow").hidden = !photo;
    find("photo").hidden = !photo || place === "off" || (place === "over" && (viewer.isAway || viewer.isSwinging));
    find("photo").className = place;
    if (photo) find("photo").src = photo;
    find("back").hidden = !viewer.isAway;
  }
}

function hint(isTouch) {
  const words = find("hint");
  words.textContent = isTouch ? "Drag to look around · pinch to come closer · tap twice to return" : "Drag to look around · scroll to come closer · double click to return";
  words.hidden = false;
  setTimeout(() => words.classList.add("done"), HINT_MS);
}

function fail(error) {
  find("fault").textContent = `This page cannot show the scene: ${error.message ?? error}`;
  find("fault").hidden = false;
  find("cover").hidden = true;
  console.error(error);
}

async function main() {
  const options = new URLSearchParams(location.search.slice(1) || location.hash.slice(1)), isBare = options.has("bare");
  document.body.classList.toggle("bare", isBare);
  const scene = JSON.parse(find("scene").textContent), poster = scene.views[0].photo;
  if (poster) Object.assign(find("poster"), { src: poster, hidden: false });
  await new Promise((done) => { requestAnimationFrame(() => setTimeout(done)); }); // the poster first
  const isStill = options.has("still") || matchMedia("(prefers-reduced-motion: reduce)").matches;
  let panel = null;
  const viewer = new Viewer(find("view"), {
    drawn: () => find("cover").classList.add("done"), moved: () => panel?.shown(),
    touched: () => { find("hint").classList.add("done"); panel?.shown(); },
  }, { isBare, isStill });
  const cloud = makeCloud(await unpack(scene, await packedData()));
  viewer.show(scene, cloud);
  panel = new Panel(viewer, scene, cloud);
  const first = Number(options.get("camera") ?? 0);
  if (first && scene.views[first]) viewer.select(first, true);
  if (!isBare) hint(matchMedia("(pointer: coarse)").matches);
  globalThis.page = viewer; // for the console, and for checks
}

main().catch(fail);
