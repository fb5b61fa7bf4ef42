// The page's data back to what splats.js draws: columns.py has how they were packed.
"use strict";

// A column of n whole numbers: zigzag differences along the rows, byte planes, low bytes first.
function readColumn(data, at, n, bytes) {
  const column = new Int32Array(n);
  for (let i = 0, value = 0; i < n; i++) {
    let code = 0;
    for (let b = 0; b < bytes; b++) code |= data[at + b * n + i] << (8 * b);
    value = (value + ((code >>> 1) ^ -(code & 1))) | 0;
    column[i] = value;
  }
  return column;
}

function readColumns(data, count, described) {
  const columns = {};
  let at = 0;
  for (const [name, bytes] of described) {
    columns[name] = readColumn(data, at, count, bytes);
    at += bytes * count;
  }
  if (at !== data.length) throw new Error("the page's data are cut short");
  return columns;
}

const HALF_BITS = new Uint32Array(1), HALF_VALUE = new Float32Array(HALF_BITS.buffer);

function half(value) { // bits of the nearest half float
  HALF_VALUE[0] = Math.max(-65504, Math.min(65504, value));
  const bits = HALF_BITS[0], sign = (bits >>> 16) & 0x8000, exponent = (bits >>> 23) & 255;
  if (exponent < 113) return sign | Math.round(Math.abs(HALF_VALUE[0]) * 16777216);
  return sign | (((bits & 0x7fffffff) - 0x38000000 + 0x1000) >>> 13);
}

const snorm = (value) => Math.round(value * 32767) & 0xffff;

// The three smaller parts of a quaternion, in units of 1/steps, and which one was left out: all four (wxyz).
function quatOf(columns, i, steps, out) {
  let rest = 1;
  for (let k = 0; k < 3; k++) {
    const value = columns[`quat_${k}`][i] / steps;
    out[k + (k >= columns.quat_largest[i])] = value;
    rest -= value * value;
  }
  out[columns.quat_largest[i]] = Math.sqrt(Math.max(rest, 0));
}

// Means (3n) in page units.
function meansOf(columns, count, scene) {
  const means = new Float32Array(3 * count);
  if (!columns.view) {
    for (let k = 0; k < 3; k++) {
      const column = columns[`mean_${k}`];
      for (let i = 0; i < count; i++) means[3 * i + k] = Math.sinh(column[i] * scene.meanStep) * scene.meanKnee;
    }
    return means;
  }
  for (let i = 0; i < count; i++) {
    const { K: [fx, skew, fy, cx, cy], rotation: [right, down, forward], position } = scene.views[columns.view[i] % OTHER_LAYERS];
    const z = 2 ** (columns.depth[i] / scene.depthSteps), y = ((columns.pixel_1[i] / scene.pixelSteps - cy) / fy) * z;
    const x = ((columns.pixel_0[i] / scene.pixelSteps - cx) * z - skew * y) / fx;
    for (let k = 0; k < 3; k++) means[3 * i + k] = position[k] + right[k] * x + down[k] * y + forward[k] * z;
  }
  return means;
}

const OTHER_LAYERS = 64; // added to the views of Gaussians that are no surface of a photo

// The code of how wide the pixel is, at the Gaussian's depth, that it stands for in its view; 0 without views.
function ownPixel(columns, i, scene) {
  if (!columns.view) return 0;
  const { K: [fx, , fy] } = scene.views[columns.view[i] % OTHER_LAYERS], [steps, lowest] = scene.logSteps;
  return Math.round((columns.depth[i] / scene.depthSteps - Math.log2(fx * fy) / 2 + lowest) * steps);
}

function geometryOf(columns, count, scene, means, views) {
  const words = new Uint32Array(8 * count), floats = new Float32Array(words.buffer), quat = [0, 0, 0, 0];
  for (let i = 0; i < count; i++) {
    const at = 8 * i;
    for (let k = 0; k < 3; k++) floats[at + k] = means[3 * i + k];
    words[at + 3] = columns.opacity[i] | (views[i] << 8);
    quatOf(columns, i, scene.quatSteps, quat);
    words[at + 4] = snorm(quat[0]) | (snorm(quat[1]) << 16);
    words[at + 5] = snorm(quat[2]) | (snorm(quat[3]) << 16);
    words[at + 6] = columns.scale_0[i] | (columns.scale_1[i] << 16);
    words[at + 7] = columns.scale_2[i] | (ownPixel(columns, i, scene) << 16);
  }
  return words;
}

// SH coefficients from components: mean + Σ component·step·basis, or the components themselves without a basis.
function coloursOf(columns, count, scene) {
  const { mean, basis, step } = scene.sh, width = mean.length, functions = width / 3, rank = basis ? basis.length : width;
  const words = new Uint32Array(2 * functions * count), values = new Float64Array(width);
  const parts = Array.from({ length: rank }, (_, r) => columns[`sh_${r}`]);
  for (let i = 0; i < count; i++) {
    values.set(mean);
    for (let r = 0; r < rank; r++) {
      const part = parts[r][i] * step;
      if (!basis) values[r] += part;
      else if (part) for (let k = 0, row = basis[r]; k < width; k++) values[k] += part * row[k];
    }
    for (let b = 0, at = 2 * functions * i; b < functions; b++, at += 2) {
      words[at] = half(values[3 * b]) | (half(values[3 * b + 1]) << 16);
      words[at + 1] = half(values[3 * b + 2]);
    }
  }
  return words;
}

async function unpack(scene, compressed) {
  const stream = new Blob([compressed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const columns = readColumns(new Uint8Array(await new Response(stream).arrayBuffer()), scene.count, scene.columns);
  const means = meansOf(columns, scene.count, scene);
  const views = columns.view ? Uint8Array.from(columns.view) : new Uint8Array(scene.count).fill(OTHER_LAYERS);
  const geometry = geometryOf(columns, scene.count, scene, means, views);
  return {
    count: scene.count, means, views, geometry, colours: coloursOf(columns, scene.count, scene),
    functions: scene.sh.mean.length / 3, logSteps: scene.logSteps, nearest: scene.nearest, farthest: scene.farthest, opacities: columns.opacity,
  };
}
