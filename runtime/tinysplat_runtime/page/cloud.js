// Gaussians as what splats.js draws: textures' words, and what the page asks of them.
import { add, clamp, dot, scaled } from "./vectors.js";

const LOG_STEPS = 1024; // of a length's code to a doubling
const LOG_LOWEST = 32; // added to a length's logarithm
const INNER = 0.05; // of a picture's shorter side, over which its surface fades towards its edges
const OUTER = 0.1; // and over which what lies beyond does
const SOLID = 0.5; // opacity from which a Gaussian counts as a surface
const GROUND = 0.3; // of the scene's mean colour, where nothing is known

const HALF_BITS = new Uint32Array(1);
const HALF_VALUE = new Float32Array(HALF_BITS.buffer);

export function half(value) {
  // bits of the nearest half float
  HALF_VALUE[0] = clamp(value, -65504, 65504);
  const bits = HALF_BITS[0];
  const sign = (bits >>> 16) & 0x8000;
  const exponent = (bits >>> 23) & 255;
  if (exponent < 113) return sign | Math.round(Math.abs(HALF_VALUE[0]) * 16777216);
  return sign | (((bits & 0x7fffffff) - 0x38000000 + 0x1000) >>> 13);
}

const lengthCode = (length) =>
  length > 0 ? clamp(Math.round((Math.log2(length) + LOG_LOWEST) * LOG_STEPS), 1, 65535) : 0;

const snorm = (value) => Math.round(value * 32767) & 0xffff;

// Where a point lies in a view: pixel x and y, and depth.
function pixelIn({ K: [fx, skew, fy, cx, cy], rotation, position }, point) {
  const ray = add(point, position, -1);
  const z = dot(rotation[2], ray);
  const y = dot(rotation[1], ray) / z;
  return [(fx * dot(rotation[0], ray)) / z + skew * y + cx, fy * y + cy, z];
}

// How wide a pixel is, where a point lies, of the view that shows it largest; 0 behind all of them.
function nearestPixel(views, point) {
  let least = Infinity;
  for (const { K, rotation, position } of views) {
    const width = dot(rotation[2], add(point, position, -1)) / Math.sqrt(K[0] * K[2]);
    if (width > 0 && width < least) least = width;
  }
  return least < Infinity ? least : 0;
}

// How much of its opacity is drawn of what lies at a pixel of its view: less towards the edges, where other views go on
// or a backdrop without detail, and less the farther beyond them. Squared, as many Gaussians lie over one another.
export function fadeAt({ width, height }, isFront, x, y) {
  const out = Math.max(-x, x - width, -y, y - height) / Math.min(width, height);
  const t = clamp(isFront ? -out / INNER : 1 - out / OUTER, 0, 1);
  const smooth = t * t * (3 - 2 * t);
  return smooth * smooth;
}

// scene: { count, means (3n, page units), scales (3n), quats (4n, wxyz), opacities (n), sh (3·functions·n), functions,
// parts: [{ view, isFront, from, to }], views, hasCameras }; parts cover all Gaussians, and view is -1 where they are of
// none. Views are those of photos where it has cameras.
export function makeCloud(scene) {
  const { count, means, opacities, parts, views } = scene;
  const photos = scene.hasCameras ? views : [];
  const words = new Uint32Array(8 * count);
  const floats = new Float32Array(words.buffer);
  for (const { view, isFront, from, to } of parts) {
    const camera = views[view];
    const focal = camera && Math.sqrt(camera.K[0] * camera.K[2]);
    for (let i = from; i < to; i++) {
      const at = 8 * i;
      const point = means.subarray(3 * i, 3 * i + 3);
      floats.set(point, at);
      const [x, y, z] = camera ? pixelIn(camera, point) : [0, 0, 0];
      const fade = camera ? Math.round(255 * fadeAt(camera, isFront, x, y)) : 255;
      const own = lengthCode(camera ? z / focal : nearestPixel(photos, point));
      words[at + 3] = Math.round(255 * opacities[i]) | ((view + 1) << 8) | (fade << 24);
      fillShape(scene, i, words, at + 4, own);
    }
  }
  const solid = parts.filter(({ isFront }) => isFront);
  return {
    count,
    means,
    opacities,
    parts,
    functions: scene.functions,
    viewCount: parts.some(({ view }) => view >= 0) ? views.length : 0,
    logSteps: [LOG_STEPS, LOG_LOWEST],
    geometry: words,
    colours: colourWords(scene),
    ...depthsOf(scene, solid),
    ground: groundOf(scene, solid),
  };
}

function fillShape({ scales, quats }, i, words, at, own) {
  const q = quats.subarray(4 * i, 4 * i + 4);
  const size = Math.hypot(q[0], q[1], q[2], q[3]) || 1;
  words[at] = snorm(q[0] / size) | (snorm(q[1] / size) << 16);
  words[at + 1] = snorm(q[2] / size) | (snorm(q[3] / size) << 16);
  words[at + 2] = lengthCode(scales[3 * i]) | (lengthCode(scales[3 * i + 1]) << 16);
  words[at + 3] = lengthCode(scales[3 * i + 2]) | (own << 16);
}

function colourWords({ count, functions, sh }) {
  const words = new Uint32Array(2 * functions * count);
  for (let i = 0; i < functions * count; i++) {
    words[2 * i] = half(sh[3 * i]) | (half(sh[3 * i + 1]) << 16);
    words[2 * i + 1] = half(sh[3 * i + 2]);
  }
  return words;
}

// Of surfaces in their own views: the harmonic mean of depths, how far inverse depths spread beside their mean, and the
// range of depths. Without views, of all Gaussians before the page's own.
function depthsOf({ means, opacities, views, parts }, solid) {
  let sum = 0;
  let squares = 0;
  let seen = 0;
  const some = [];
  for (const { view, from, to } of solid.length ? solid : parts) {
    const { rotation, position } = views[Math.max(view, 0)];
    for (let i = from; i < to; i++) {
      const z = dot(rotation[2], add(means.subarray(3 * i, 3 * i + 3), position, -1));
      if (!(z > 0)) continue;
      sum += 1 / z;
      squares += 1 / (z * z);
      if (seen++ % 16 === 0 && opacities[i] > 0.1) some.push(z);
    }
  }
  some.sort((a, b) => a - b);
  const mean = sum / seen;
  const at = (share) => some[Math.floor(share * (some.length - 1))] ?? 1;
  return {
    depth: seen ? 1 / mean : 1,
    spread: seen ? Math.sqrt(Math.max(squares / seen / (mean * mean) - 1, 0)) : 0,
    nearest: at(0.02),
    farthest: Math.max(at(0.98), 1.01 * at(0.02)),
  };
}

// The colour where nothing is known: the scene's own, dark.
function groundOf({ count, opacities, sh, functions }, solid) {
  const sum = [0, 0, 0];
  let seen = 0;
  for (const { from, to } of solid.length ? solid : [{ from: 0, to: count }]) {
    for (let i = from; i < to; i += 17) {
      if (opacities[i] < SOLID) continue;
      for (let k = 0; k < 3; k++) sum[k] += clamp(0.5 + 0.28209479177387814 * sh[3 * functions * i + k], 0, 1);
      seen++;
    }
  }
  return scaled(sum, GROUND / Math.max(seen, 1));
}
