/** A layer's metadata: docs/FORMAT.md, LAYR. */
import { layerCameras, readColumns, requireSides } from "./cameras.js";
import { cursor, only } from "./sections.js";
import { CLASS_NAMES, DEPTH, channelName, channelsOf } from "./table.js";

/** @typedef {import("./cameras.js").Camera} Camera */
/** @typedef {import("./table.js").Channel} Channel */

const INVERSE_DEPTH = 1;
export const OWN_INTRINSICS = 2;
const RELATIVE_ROTATION = 4;
const SCALE_MIX = 8;
const BASIS = 16;

/**
 * @typedef {object} Layer
 * @property {number} height
 * @property {number} width
 * @property {number} degree
 * @property {boolean} isInverse the depth channel holds −1/z
 * @property {number} set index of its parameter sets
 * @property {number} k columns of the basis
 * @property {number} zMin
 * @property {number} zMax
 * @property {Camera[]} cameras with the layer's own grid and intrinsics
 * @property {number[][] | undefined} references quaternions per view, which rotations are relative to
 * @property {Float64Array | undefined} mix S row by row, then s
 * @property {Float64Array | undefined} basis d × k row by row
 * @property {Channel[]} channels
 */

/**
 * @param {import("./container.js").Container} file
 * @param {number} index
 * @returns {Layer}
 */
export function readLayer(file, index) {
  const fields = cursor(only(file.sections, "LAYR", index));
  const [height, width, degree, sourceDegree] = [fields.u32(), fields.u32(), fields.u8(), fields.u8()];
  const [flags, set, k] = [fields.u8(), fields.u8(), fields.u16()];
  const [zMin, zMax, lost, condition] = fields.numbers("f32", 4);
  requireSides(fields, height, width);
  fields.require(degree <= sourceDegree && sourceDegree <= 4, `SH degree ${degree} of ${sourceDegree}`);
  fields.require(zMin > 0 && zMin <= zMax && zMax < Infinity, `depth limits ${zMin} to ${zMax}`);
  fields.require(Number.isFinite(lost) && condition > 0 && condition < Infinity, "a number is out of range");
  fields.require(flags < 32, `unknown flags ${flags}`);
  const cameras = layerCameras(fields, file, height, width, (flags & OWN_INTRINSICS) !== 0);
  let references;
  if (flags & RELATIVE_ROTATION) {
    references = file.views.map(readColumns(fields, file.viewCount, 4));
    const isUnit = references.every((quat) => Math.abs(Math.hypot(...quat) - 1) < 1e-3);
    fields.require(isUnit, "a reference quaternion is not of length 1");
  }
  const mix = flags & SCALE_MIX ? fields.numbers("f32", 12) : undefined;
  fields.require(!mix || mix.every(Number.isFinite), "the scale mix is not finite");
  const d = 3 * (degree + 1) ** 2;
  let basis;
  if (flags & BASIS) {
    fields.require(k >= 1 && k <= d, `k = ${k}, accepted are 1 to ${d}`);
    basis = fields.numbers("f16", d * k);
    fields.require(basis.every(Number.isFinite), "the basis is not finite");
  } else {
    fields.require(degree === 0 && k === 0, `degree ${degree} without a basis`);
  }
  fields.finish();
  const [channels, targets, seen] = [channelsOf(file.table, index), [1, k || 3, 1, 3, 4, 2], new Set()];
  for (const channel of channels) {
    const { planeClass, target } = channel;
    fields.require(target < targets[planeClass], `${CLASS_NAMES[planeClass]} has no channel ${target}`);
    const name = channelName(channel);
    fields.require(planeClass === DEPTH || !seen.has(name), `${name} stands twice`);
    seen.add(name);
  }
  return {
    height,
    width,
    degree,
    isInverse: (flags & INVERSE_DEPTH) !== 0,
    set,
    k,
    zMin,
    zMax,
    cameras,
    references,
    mix,
    basis,
    channels,
  };
}
