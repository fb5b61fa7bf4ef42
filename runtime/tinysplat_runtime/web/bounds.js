/**
 * What a layer's metadata lets decoding come to: docs/FORMAT.md, LAYR, "Numbers that are each in range …". Interval
 * arithmetic over codes from 0 to 4095 shows that nothing leaves float32, before any decoding.
 */
import { require } from "./errors.js";
import { CLASS_NAMES, COLOR, OFFSET, ROTATION, SCALE } from "./table.js";

/** @typedef {import("./layers.js").Layer} Layer */

export const MAX_CODE = 4095;
export const MAX_DECODED = 1e30;
export const MAX_ROTATION = 1e15;

/**
 * Memory that decoding a layer takes: its Gaussians, their codes, and both as float32.
 *
 * @param {Layer} layer
 */
export function decodingBytes(layer) {
  const pictures = layer.channels.filter((channel) => channel.isCoded).length;
  const numbers = 11 + 3 * (layer.degree + 1) ** 2;
  return layer.cameras.length * layer.height * layer.width * (4 * (numbers + 22) + 6 * (pictures + 2));
}

/**
 * Largest magnitude that a class's records can add up to, by target, of those that it has.
 *
 * @param {Layer} layer
 * @param {number} planeClass
 */
function largest(layer, planeClass) {
  /** @type {number[]} */
  const sums = [];
  for (const channel of layer.channels) {
    if (channel.planeClass !== planeClass) continue;
    const reach = Math.abs(channel.offset) + (channel.isCoded ? MAX_CODE * Math.abs(channel.scale) : 0);
    sums[channel.target] = (sums[channel.target] ?? 0) + reach;
  }
  return sums;
}

/**
 * @param {number} value
 * @param {number} bound
 * @param {string} what
 * @param {string} where
 */
export function requireBound(value, bound, what, where) {
  require(value <= bound, `${what} can decode to ${value.toPrecision(3)}, at most ${bound}`, where); // NaN is refused
}

/**
 * Refuse a layer whose codes can decode to numbers that float32 does not hold.
 *
 * @param {Layer} layer
 * @param {Float64Array} origin
 * @param {string} where
 */
export function checkRanges(layer, origin, where) {
  require(layer.zMin >= 1e-30 && layer.zMax <= MAX_DECODED, "depths out of range", where);
  const reach = CLASS_NAMES.map((_, planeClass) => largest(layer, planeClass));
  CLASS_NAMES.forEach((name, planeClass) => {
    const bound = planeClass === ROTATION ? MAX_ROTATION : MAX_DECODED;
    requireBound(Math.max(0, ...Object.values(reach[planeClass])), bound, name, where);
  });
  let scale = Math.max(0, ...Object.values(reach[SCALE]));
  const { mix, basis, k } = layer;
  if (mix) {
    const rows = [0, 1, 2].map((i) => {
      const weights = Math.abs(mix[3 * i]) + Math.abs(mix[3 * i + 1]) + Math.abs(mix[3 * i + 2]);
      return weights * scale + Math.abs(mix[9 + i]);
    });
    scale = Math.max(...rows);
  }
  if (basis) {
    let sum = 0;
    reach[COLOR].forEach((value, target) => {
      let most = 0;
      for (let at = target; at < basis.length; at += k) most = Math.max(most, Math.abs(basis[at]));
      sum += most * value;
    });
    requireBound(sum, MAX_DECODED, "sh", where);
  }
  for (const camera of layer.cameras) {
    const focal = Math.sqrt(camera.fx * camera.fy);
    requireBound(Math.max(scale, (scale * layer.zMax) / focal), MAX_DECODED, "scales", where);
    const y = ((reach[OFFSET][1] ?? 0) + layer.height + Math.abs(camera.cy)) / camera.fy;
    const x = ((reach[OFFSET][0] ?? 0) + layer.width + Math.abs(camera.cx) + Math.abs(camera.skew) * y) / camera.fx;
    const { c2w } = camera;
    const away = Math.hypot(c2w[3] - origin[0], c2w[7] - origin[1], c2w[11] - origin[2]);
    requireBound((x + y + 1) * Math.max(layer.zMax, 1) + away, MAX_DECODED, "means", where);
  }
}
