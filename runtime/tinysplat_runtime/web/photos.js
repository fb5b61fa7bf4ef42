/** Photos of the modes photos and hybrid: docs/FORMAT.md, "Photos", and "Hybrid files". */
import { exactRotation, quaternionOf } from "./cameras.js";
import { require } from "./errors.js";

/** @typedef {import("./cameras.js").Camera} Camera */
/** @typedef {import("./synthesis.js").Arrays} Arrays */

const RED = 0.2126;
const BLUE = 0.0722;
const GREEN = 1 - RED - BLUE;
const WHITE = 1023;
const GREY = 512;

/** Size at which a photo is coded. @param {number} side */
export function codedSide(side) {
  return 16 * Math.ceil(side / 16);
}

/**
 * Samples of chroma minus grey, doubled down and across, of the coded size.
 *
 * @param {Uint16Array} samples
 * @param {number} height of the coded photo
 * @param {number} width
 */
function doubled(samples, height, width) {
  const [rows, columns] = [height / 2, width / 2];
  const tall = new Float32Array(height * columns);
  for (let y = 0; y < height; y++) {
    const row = y >> 1;
    const next = Math.min(Math.max(row + (y & 1 ? 1 : -1), 0), rows - 1);
    for (let x = 0; x < columns; x++) {
      tall[y * columns + x] = 0.75 * (samples[row * columns + x] - GREY) + 0.25 * (samples[next * columns + x] - GREY);
    }
  }
  const out = new Float32Array(height * width);
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const column = x >> 1;
      const next = Math.min(Math.max(column + (x & 1 ? 1 : -1), 0), columns - 1);
      out[y * width + x] = 0.75 * tall[y * columns + column] + 0.25 * tall[y * columns + next];
    }
  }
  return out;
}

/**
 * A photo's RGB in [0, 1], pixel by pixel.
 *
 * @param {Uint16Array[]} planes Y, Cb and Cr as decoded, of the coded size
 * @param {number} height of the photo
 * @param {number} width
 */
export function photoPixels(planes, height, width) {
  const [codedHeight, codedWidth] = [codedSide(height), codedSide(width)];
  const blue = doubled(planes[1], codedHeight, codedWidth);
  const red = doubled(planes[2], codedHeight, codedWidth);
  const out = new Float32Array(3 * height * width);
  for (let y = 0, to = 0; y < height; y++) {
    for (let at = y * codedWidth; at < y * codedWidth + width; at++, to += 3) {
      const luma = planes[0][at];
      const r = luma + 2 * (1 - RED) * red[at];
      const b = luma + 2 * (1 - BLUE) * blue[at];
      const g = (luma - RED * r - BLUE * b) / GREEN;
      out[to] = Math.min(Math.max(r / WHITE, 0), 1);
      out[to + 1] = Math.min(Math.max(g / WHITE, 0), 1);
      out[to + 2] = Math.min(Math.max(b / WHITE, 0), 1);
    }
  }
  return out;
}

/**
 * A layer as a network gives it: per pixel, views outermost.
 *
 * @typedef {object} Predicted
 * @property {number} height of the grid
 * @property {number} width
 * @property {number} degree
 * @property {Camera[]} cameras
 * @property {Float32Array} means relative to `origin`
 * @property {Float32Array} quats
 * @property {Float32Array} scales
 * @property {Float32Array} opacities
 * @property {Float32Array} sh
 */

/** @typedef {{ layers: Predicted[], origin: ArrayLike<number> }} Prediction */

/**
 * What a network was asked for and gave, held to each other.
 *
 * @param {Prediction} prediction
 * @param {number} views
 */
export function checkPrediction(prediction, views) {
  const { layers, origin } = prediction;
  require(layers.length > 0 && origin.length === 3, "no layers", "network");
  for (const layer of layers) {
    const count = views * layer.height * layer.width;
    const coefficients = 3 * (layer.degree + 1) ** 2;
    const fits =
      layer.cameras.length === views && layer.means.length === 3 * count && layer.quats.length === 4 * count &&
      layer.scales.length === 3 * count && layer.opacities.length === count && layer.sh.length === coefficients * count;
    require(fits, `a layer of ${layer.width}x${layer.height} whose arrays have other sizes`, "network");
  }
}

/**
 * One prediction of all views from those of groups: of each the views that it keeps.
 *
 * @param {Prediction[]} found
 * @param {import("./extras.js").Group[]} groups
 * @param {number} count of views
 * @returns {Prediction}
 */
export function joinGroups(found, groups, count) {
  const [{ layers, origin }] = found;
  if (found.length === 1) return found[0];
  const joined = layers.map((layer) => ({ ...layer, cameras: Array(count), ...emptyArrays(layer, count) }));
  found.forEach((prediction, g) => {
    const isAlike = prediction.layers.length === layers.length && prediction.layers.every((layer, i) =>
      layer.height === layers[i].height && layer.width === layers[i].width && layer.degree === layers[i].degree);
    require(isAlike, "layers of another shape than of the group before", "network");
    const shift = [0, 1, 2].map((axis) => prediction.origin[axis] - origin[axis]);
    prediction.layers.forEach((layer, i) => {
      for (const view of groups[g].kept) {
        const at = groups[g].views.indexOf(view);
        joined[i].cameras[view] = layer.cameras[at];
        for (const [name, size] of fieldsOf(layer)) {
          const values = layer[name].subarray(at * size, (at + 1) * size);
          joined[i][name].set(values, view * size);
          if (name === "means") for (let n = 0; n < size; n++) joined[i].means[view * size + n] = values[n] + shift[n % 3];
        }
      }
    });
  });
  return { layers: joined, origin };
}

/**
 * Arrays of a layer, and how many numbers each has of a view.
 *
 * @param {Predicted} layer
 * @returns {["means" | "quats" | "scales" | "opacities" | "sh", number][]}
 */
function fieldsOf({ height, width, degree }) {
  const pixels = height * width;
  return [["means", 3 * pixels], ["quats", 4 * pixels], ["scales", 3 * pixels], ["opacities", pixels], ["sh", 3 * (degree + 1) ** 2 * pixels]];
}

/** @param {Predicted} layer @param {number} count of views @returns {Pick<Predicted, "means" | "quats" | "scales" | "opacities" | "sh">} */
function emptyArrays(layer, count) {
  return /** @type {any} */ (Object.fromEntries(fieldsOf(layer).map(([name, size]) => [name, new Float32Array(count * size)])));
}

/**
 * A view of a prediction as what a hybrid file's codes are added to: the inverse of steps 3 to 6.
 *
 * @param {Predicted} layer
 * @param {number} view
 * @param {ArrayLike<number>} origin
 * @returns {import("./synthesis.js").Base}
 */
export function predictedBase(layer, view, origin) {
  const { height, width, means, quats, scales, opacities } = layer;
  const pixels = height * width;
  const channels = Array.from({ length: 11 }, () => new Float64Array(pixels));
  const camera = layer.cameras[view];
  const m = exactRotation(camera);
  const own = quaternionOf(m);
  const focal = Math.sqrt(camera.fx * camera.fy);
  const centre = [3, 7, 11].map((i, axis) => camera.c2w[i] - origin[axis]);
  const isValid = new Uint8Array(pixels);
  for (let pixel = 0; pixel < pixels; pixel++) {
    const g = view * pixels + pixel;
    const [a, b, c] = [0, 1, 2].map((axis) => means[3 * g + axis] - centre[axis]);
    const [x, y, z] = [0, 1, 2].map((axis) => m[axis] * a + m[3 + axis] * b + m[6 + axis] * c);
    if (!(z > 0)) continue;
    isValid[pixel] = 1;
    const [column, row] = [pixel % width, Math.floor(pixel / width)];
    channels[0][pixel] = -1 / z;
    channels[1][pixel] = (camera.fx * x + camera.skew * y) / z + camera.cx - column - 0.5;
    channels[2][pixel] = (camera.fy * y) / z + camera.cy - row - 0.5;
    for (let axis = 0; axis < 3; axis++) channels[3 + axis][pixel] = (scales[3 * g + axis] * focal) / z;
    const quat = inFrame(own, quats, 4 * g);
    for (let i = 0; i < 4; i++) channels[6 + i][pixel] = quat[i];
    channels[10][pixel] = opacities[g];
  }
  fillInvalid(channels, isValid);
  turnSigns(channels.slice(6, 10));
  const coefficients = 3 * (layer.degree + 1) ** 2;
  const sh = layer.sh.subarray(view * pixels * coefficients, (view + 1) * pixels * coefficients);
  return { channels, sh, coefficients };
}

/**
 * conjugate(own) ⊗ q / |q|.
 *
 * @param {number[]} own
 * @param {Float32Array} quats
 * @param {number} at
 */
function inFrame(own, quats, at) {
  const [w, x, y, z] = own;
  const [a, b, c, d] = quats.subarray(at, at + 4);
  const length = Math.hypot(a, b, c, d) || 1;
  return [
    (w * a + x * b + y * c + z * d) / length,
    (w * b - x * a - y * d + z * c) / length,
    (w * c + x * d - y * a - z * b) / length,
    (w * d - x * c + y * b - z * a) / length,
  ];
}

/**
 * A Gaussian at z ≤ 0 takes the median of its view and opacity 0.
 *
 * @param {Float64Array[]} channels
 * @param {Uint8Array} isValid
 */
function fillInvalid(channels, isValid) {
  if (isValid.every((flag) => flag === 1)) return;
  require(isValid.some((flag) => flag === 1), "every Gaussian of a view is behind its camera", "network");
  channels.forEach((values, channel) => {
    // Medians are of z itself, as projecting has it.
    const shown = values.filter((_, pixel) => isValid[pixel] === 1).map((value) => (channel === 0 ? -1 / value : value));
    shown.sort();
    const half = shown.length >> 1;
    const median = shown.length % 2 ? shown[half] : (shown[half - 1] + shown[half]) / 2;
    const filling = channel === 10 ? 0 : channel === 0 ? -1 / median : median;
    for (let pixel = 0; pixel < values.length; pixel++) if (!isValid[pixel]) values[pixel] = filling;
  });
}

/**
 * Of q and −q the one nearer to the view's dominant rotation: the eigenvector of Σ q qᵀ with its largest component
 * positive, found by squaring the matrix.
 *
 * @param {Float64Array[]} quats
 */
function turnSigns(quats) {
  let matrix = quats.map((a) => quats.map((b) => a.reduce((sum, value, i) => sum + value * b[i], 0)));
  for (let step = 0; step < 40; step++) {
    const trace = matrix[0][0] + matrix[1][1] + matrix[2][2] + matrix[3][3];
    const unit = matrix.map((row) => row.map((value) => value / trace));
    matrix = unit.map((row) => unit.map((_, j) => row.reduce((sum, value, k) => sum + value * unit[k][j], 0)));
  }
  const dominant = matrix.reduce((best, row, i) => (row[i] > best[matrix.indexOf(best)] ? row : best), matrix[0]);
  const towards = dominant.map((value) => value * Math.sign(dominant[matrix.indexOf(dominant)]));
  for (let pixel = 0; pixel < quats[0].length; pixel++) {
    let similarity = 0;
    for (let i = 0; i < 4; i++) similarity += towards[i] * quats[i][pixel];
    if (similarity < 0) for (let i = 0; i < 4; i++) quats[i][pixel] *= -1;
  }
}
