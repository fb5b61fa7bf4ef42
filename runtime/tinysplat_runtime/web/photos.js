/** Photos of mode photos: docs/FORMAT.md, PHOT. */
import { require } from "./errors.js";
import { newArrays } from "./synthesis.js";

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

/** @typedef {import("./tsplat.js").Prediction} Prediction */
/** @typedef {Prediction["layers"][number]} Predicted */

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
    const fits =
      layer.cameras.length === views && fieldsOf(layer).every(([name, size]) => layer[name].length === views * size);
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
  const joined = layers.map((layer) => {
    const arrays = newArrays(count * layer.height * layer.width, layer.degree);
    return { ...layer, cameras: Array(count), ...arrays };
  });
  found.forEach((prediction, g) => {
    const isAlike =
      prediction.layers.length === layers.length &&
      prediction.layers.every(
        (layer, i) =>
          layer.height === layers[i].height && layer.width === layers[i].width && layer.degree === layers[i].degree,
      );
    require(isAlike, "layers of another shape than of the group before", "network");
    const shift = [0, 1, 2].map((axis) => prediction.origin[axis] - origin[axis]);
    prediction.layers.forEach((layer, i) => {
      for (const view of groups[g].kept) {
        const at = groups[g].views.indexOf(view);
        joined[i].cameras[view] = layer.cameras[at];
        for (const [name, size] of fieldsOf(layer)) {
          const values = layer[name].subarray(at * size, (at + 1) * size);
          joined[i][name].set(values, view * size);
          if (name === "means")
            for (let n = 0; n < size; n++) joined[i].means[view * size + n] = values[n] + shift[n % 3];
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
  return [
    ["means", 3 * pixels],
    ["quats", 4 * pixels],
    ["scales", 3 * pixels],
    ["opacities", pixels],
    ["sh", 3 * (degree + 1) ** 2 * pixels],
  ];
}
