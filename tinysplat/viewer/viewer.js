// The page's own code. Data: the JSON in #scene (made by page.py), gzipped arrays in #arrays, three.js and Spark in #libraries.
"use strict";

const scene = JSON.parse(document.getElementById("scene").textContent);
const find = (id) => document.getElementById(id);

const SETTLING = 12; // frames that new Gaussians take to be sorted

async function unzip(id) {
  const bytes = Uint8Array.from(atob(find(id).textContent), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

async function loadLibraries() {
  const url = URL.createObjectURL(new Blob([await unzip("libraries")], { type: "text/javascript" }));
  await new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = url;
    script.onload = resolve;
    script.onerror = () => reject(new Error("the page's libraries do not load"));
    document.head.append(script);
  });
  return globalThis.Libraries ?? Libraries;
}

// Values of all 65,536 half-precision numbers.
const HALVES = Float32Array.from({ length: 65536 }, (_, h) => {
  const sign = h >> 15 ? -1 : 1, exponent = (h >> 10) & 31, fraction = h & 1023;
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -14 * (fraction / 1024));
});

// Columns of a 3DGS .ply, each a Float32Array: byte planes of one column follow each other, low byte first.
function readColumns(data) {
  const n = scene.count, columns = {};
  let at = 0;
  for (const [name, bytes] of scene.columns) {
    const values = new Float32Array(n), word = new DataView(new ArrayBuffer(4));
    for (let i = 0; i < n; i++) {
      for (let b = 0; b < bytes; b++) word.setUint8(b, data[at + b * n + i]);
      values[i] = bytes === 2 ? HALVES[word.getUint16(0, true)] : word.getFloat32(0, true);
    }
    columns[name] = values;
    at += bytes * n;
  }
  return columns;
}

// The Gaussians of at least an opacity, as a .ply file's bytes.
function writePly(columns, minOpacity) {
  const names = Object.keys(columns);
  const least = minOpacity > 0 ? Math.log(minOpacity / (1 - minOpacity)) : -Infinity;
  const rows = [];
  columns.opacity.forEach((logit, i) => { if (logit >= least) rows.push(i); });
  const properties = names.map((name) => `property float ${name}\n`).join("");
  const header = new TextEncoder().encode(
    `ply\nformat binary_little_endian 1.0\nelement vertex ${rows.length}\n${properties}end_header\n`);
  const file = new Uint8Array(header.length + 4 * names.length * rows.length);
  file.set(header);
  const view = new DataView(file.buffer, header.length);
  names.forEach((name, c) => {
    rows.forEach((row, r) => view.setFloat32(4 * (r * names.length + c), columns[name][row], true));
  });
  return file;
}

function frustum(THREE, camera, size) {
  const [fx, fy, cx, cy] = camera.intrinsics;
  const corner = (u, v) => [((u - cx) / fx) * size, (-(v - cy) / fy) * size, -size];
  const [a, b, c, d] = [corner(0, 0), corner(camera.width, 0), corner(camera.width, camera.height), corner(0, camera.height)];
  const apex = [0, 0, 0];
  const points = [apex, a, apex, b, apex, c, apex, d, a, b, b, c, c, d, d, a].flat();
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
  const lines = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: 0xffb454 }));
  lines.applyMatrix4(new THREE.Matrix4().set(...camera.pose.flat()));
  return lines;
}

function element(tag, text) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  return made;
}

function fillPanel(select) {
  find("summary").textContent = scene.summary;
  const total = Object.values(scene.bytes).reduce((sum, n) => sum + n, 0);
  if (total) {
    const table = element("table");
    for (const [name, bytes] of Object.entries(scene.bytes)) {
      const row = table.insertRow();
      row.insertCell().textContent = name;
      row.insertCell().textContent = `${(bytes / 1000).toFixed(1)} KB`;
      const bar = element("div");
      bar.className = "bar";
      bar.style.width = `${(100 * bytes) / total}%`;
      const cell = table.insertRow().insertCell();
      cell.colSpan = 2;
      cell.append(bar);
    }
    find("classes").append(table);
  }
  scene.cameras.forEach((_, i) => {
    const button = element("button", `view ${i}`);
    button.onclick = () => select(i);
    find("views").append(button);
  });
  find("degree").max = scene.degree;
  find("degree").value = scene.degree;
}

async function main() {
  const { THREE, OrbitControls, SparkRenderer, SplatMesh } = await loadLibraries();
  const columns = readColumns(await unzip("arrays"));
  const bare = new URLSearchParams(location.search.slice(1) || location.hash.slice(1));
  document.body.classList.toggle("bare", bare.has("bare"));

  const canvas = find("view");
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: false, preserveDrawingBuffer: true });
  renderer.setPixelRatio(bare.has("bare") ? 1 : devicePixelRatio);
  const world = new THREE.Scene();
  const eye = new THREE.PerspectiveCamera(60, 1, 0.01, 1000);
  let dirty = true, frames = 0; // a frame is drawn when something changed, so that a still page takes no power
  const onDirty = () => { dirty = true; };
  const spark = new SparkRenderer({
    renderer, onDirty, accumExtSplats: true,
    // our rasteriser's definition: 0.3 px² of dilation without weaker opacities, order by z, alpha from 1/255 on
    preBlurAmount: 0.3, blurAmount: 0, sortRadial: false, minAlpha: 1 / 255, maxStdDev: Math.sqrt(2 * Math.log(255)), clipXY: 2,
  });
  world.add(spark);
  const controls = new OrbitControls(eye, canvas);
  controls.listenToKeyEvents(canvas);
  const frusta = new THREE.Group();
  scene.cameras.forEach((camera) => frusta.add(frustum(THREE, camera, 0.15)));
  frusta.visible = !bare.has("bare");
  world.add(frusta);

  let current = 0, mesh = null, building = Promise.resolve();

  // The current view's field of view and principal point, the picture as large as the window allows.
  function fit() {
    const camera = scene.cameras[current], width = innerWidth, height = innerHeight;
    renderer.setSize(width, height, false);
    const scale = Math.min(width / camera.width, height / camera.height);
    const [fx, fy, cx, cy] = camera.intrinsics;
    eye.aspect = (width / height) * (fy / fx);
    eye.fov = (2 * Math.atan(height / 2 / (fy * scale)) * 180) / Math.PI;
    eye.setViewOffset(width, height, (camera.width / 2 - cx) * scale, (camera.height / 2 - cy) * scale, width, height);
    eye.updateProjectionMatrix();
    dirty = true;
  }

  function select(i) {
    current = i;
    const camera = scene.cameras[i];
    const pose = new THREE.Matrix4().set(...camera.pose.flat());
    pose.decompose(eye.position, eye.quaternion, eye.scale);
    eye.scale.set(1, 1, 1);
    const forward = new THREE.Vector3(0, 0, -scene.target).applyQuaternion(eye.quaternion);
    eye.up.set(0, 1, 0).applyQuaternion(eye.quaternion);
    controls.target.copy(eye.position).add(forward);
    fit();
    controls.update();
    showPhoto();
  }

  function showPhoto() {
    const photo = scene.cameras[current].photo;
    find("photoRow").hidden = !photo;
    find("photo").hidden = !(photo && find("photoToggle").checked);
    if (photo) find("photo").src = photo;
  }

  async function rebuild() {
    const next = new SplatMesh({ fileBytes: writePly(columns, Number(find("opacity").value)), fileType: "ply", extSplats: true });
    await next.initialized;
    next.maxSh = Number(find("degree").value);
    next.updateVersion?.();
    world.add(next);
    if (mesh) { world.remove(mesh); mesh.dispose(); }
    mesh = next;
    frames = 0;
  }

  function relabel() {
    find("degree").parentElement.querySelector("output").textContent = find("degree").value;
    find("opacity").parentElement.querySelector("output").textContent = Number(find("opacity").value).toFixed(2);
  }

  fillPanel(select);
  relabel();
  for (const id of ["degree", "opacity"]) {
    find(id).oninput = relabel;
    find(id).onchange = () => { building = building.then(rebuild).catch(fail); };
  }
  find("photoToggle").onchange = showPhoto;
  find("frusta").onchange = () => { frusta.visible = find("frusta").checked; dirty = true; };
  addEventListener("resize", fit);
  controls.addEventListener("change", () => { dirty = true; });
  controls.addEventListener("start", () => { find("photoToggle").checked = false; showPhoto(); });

  await rebuild();
  select(Math.min(Number(bare.get("camera") ?? 0), scene.cameras.length - 1));
  renderer.setAnimationLoop(() => {
    if (!bare.has("bare")) controls.update();
    if (!dirty && frames > SETTLING) return;
    dirty = false;
    renderer.render(world, eye);
    if (++frames !== SETTLING) return;
    document.body.dataset.cut = find("opacity").value; // what checks/viewer.py waits for
    document.body.dataset.ready = "yes";
  });
}

function fail(error) {
  const place = find("fault");
  place.textContent = `This page cannot show the scene: ${error.message ?? error}`;
  place.hidden = false;
  console.error(error);
}

main().catch(fail);
