// node draw.mjs FOLDER IN.json OUT.f32: splats of Gaussians by the page's own arithmetic, in the order of drawing, eleven floats each.
import { readFileSync, writeFileSync } from "node:fs";
import { pathToFileURL } from "node:url";
import { basisOf, functionsOf } from "./glsl.mjs";

const [folder, input, output] = process.argv.slice(2);
const module = (name) => import(pathToFileURL(`${folder}/${name}`));
const { ARITHMETIC } = await module("arithmetic.js");
const { Camera } = await module("camera.js");
const { distances, shares, sorting } = await module("near.js");
const { dot, unit } = await module("vectors.js");

const glsl = functionsOf(ARITHMETIC);
const { max, sqrt } = Math;
const vector = (x, y, z, w) => ({ x, y, z, w });

const scene = JSON.parse(readFileSync(input, "utf8"));
const { width, height, parts, views, depth, nearPlane, degree } = scene;
const floats = (name) => Float32Array.from(scene[name]);
const [means, quats, scales, opacities, sh] = ["means", "quats", "scales", "opacities", "sh"].map(floats);
const camera = new Camera(scene.camera, 1);
const { projection, principal, focal } = camera.fitted(width, height);
const rows = [0, 3, 6].map((at) => vector(...projection.slice(at, at + 3)));

const isNear = scene.order === "near" && views.length > 1;
const share = isNear ? shares(distances(views, depth, camera)) : views.flatMap(() => [0, 1]);
const z = camera.rotation[2];
const order = sorting(means, parts)([...z, -dot(z, camera.position)], nearPlane, share);
const partOf = (i) => parts.find(({ from, to }) => from <= i && i < to);

function colour(i, d) {
  const sum = [0.5, 0.5, 0.5];
  const functions = (degree + 1) ** 2;
  const basis = basisOf(glsl, { x: d[0], y: d[1], z: d[2] });
  for (let n = 0; n < functions; n++) for (let k = 0; k < 3; k++) sum[k] += basis[n] * sh[3 * (functions * i + n) + k];
  return sum.map((value) => max(value, 0));
}

const drawn = [];
for (const entry of order) {
  const i = entry & 0x7fffffff;
  const isCopy = entry > 0x7fffffff;
  const { view } = partOf(i);
  const at = [0, 1, 2].map((k) => means[3 * i + k] - camera.position[k]);
  const ray = vector(...at);
  const point = rows.map((row) => glsl.dot3(row, ray));
  const u = point[0] / point[2];
  const v = point[1] / point[2];
  const limit = (x, c, size) => max(-0.15 * size - c, Math.min(1.15 * size - c, x));
  const q = vector(...quats.subarray(4 * i, 4 * i + 4));
  const s = vector(...scales.subarray(3 * i, 3 * i + 3));
  const m1 = glsl.across(glsl.jacobian(rows[0], rows[2], limit(u, principal[0], width), point[2]), q, s);
  const m2 = glsl.across(glsl.jacobian(rows[1], rows[2], limit(v, principal[1], height), point[2]), q, s);
  const area = glsl.cross3(m1, m2);
  const b = glsl.dot3(m1, m2);
  const plain = glsl.dot3(area, area);
  let [a, c] = [glsl.dot3(m1, m1), glsl.dot3(m2, m2)];
  let own = 0;
  if (scene.dilation === "own") {
    const widths = (view >= 0 ? [views[view]] : views).map(({ K, rotation, position }) => {
      const deep = dot(
        rotation[2],
        [0, 1, 2].map((k) => means[3 * i + k] - position[k]),
      );
      return ((deep / sqrt(K[0] * K[2])) * focal) / point[2];
    });
    const seen = widths.filter((width) => width > 0);
    if (seen.length) own = max(Math.min(...seen), view >= 0 ? 0 : 1);
  }
  const wider = glsl.widening(a, b, c, plain, own);
  const det = plain + wider.x * (a + c + wider.x);
  [a, c] = [a + wider.x, c + wider.x];
  const opacity = opacities[i] * wider.y * (view >= 0 ? share[2 * view + 1] : 1);
  const part = isCopy ? share[2 * view] : 1;
  const reach = Math.log(opacity / glsl.LEAST_ALPHA);
  if (!(reach > 0)) continue;
  const axes = glsl.halfAxes(a, b, c, det);
  drawn.push(u + principal[0], v + principal[1], axes.x, axes.y, axes.z, opacity, part, isCopy, ...colour(i, unit(at)));
}
writeFileSync(output, Float32Array.from(drawn));
