/** A layer's metadata: docs/FORMAT.md, LAYR. */
import { readIntrinsics } from "./cameras.js";
import { cursor } from "./sections.js";

/** @typedef {import("./cameras.js").Camera} Camera */
/** @typedef {import("./cursor.js").Cursor} Cursor */

/** Numbers of the classes of planes. */
export const DEPTH = 0;
export const COLOR = 1;
export const OPACITY = 2;
export const SCALE = 3;
export const ROTATION = 4;
export const OFFSET = 5;
export const CLASS_NAMES = ["depth", "color", "opacity", "scale", "rotation", "offset"];

export const MAX_SIDE = 1 << 16;
const MAX_CHANNELS = 256;
export const MAX_QP = 51;
const INVERSE_DEPTH = 1;
const RELATIVE_ROTATION = 2;
const SCALE_MIX = 4;
const BASIS = 8;
const OWN_INTRINSICS = 16;
const INTRA = 1;

/**
 * A picture: the last `length` bytes of the first `end` of `data`, which a prefix may not hold.
 *
 * @typedef {{ end: number, length: number, crc: number, data: Uint8Array }} Stream
 */

/**
 * @typedef {object} Channel
 * @property {number} planeClass
 * @property {number} target which channel of the class it adds to
 * @property {number} scale units per code
 * @property {number} offset value of code 0, or of a constant channel
 * @property {boolean} isCoded whether it has pictures; else it is constant
 * @property {Stream[]} streams one per view, of a coded channel
 */

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
 * @property {boolean} isOwn whether `cameras` have other intrinsics than the file's
 * @property {boolean} isRelative whether rotations are relative to `references`
 * @property {Float64Array[] | undefined} references quaternions per view
 * @property {Float64Array | undefined} mix S row by row, then s
 * @property {Float64Array | undefined} basis d × k row by row
 * @property {Channel[]} channels
 */

/** @param {Channel} channel */
export function channelName(channel) {
  return `${CLASS_NAMES[channel.planeClass]}${channel.target}`;
}

/**
 * @param {import("./sections.js").Section} section
 * @param {Camera[]} poses
 * @param {boolean} isInParts whether what belongs to views stands in sections VIEW: the layer has none as yet
 * @returns {Layer}
 */
export function readLayer(section, poses, isInParts) {
  const fields = cursor(section);
  const [height, width, degree, sourceDegree] = [fields.u32(), fields.u32(), fields.u8(), fields.u8()];
  const [flags, set, count, k] = [fields.u8(), fields.u8(), fields.u16(), fields.u16()];
  const [zMin, zMax, lost, condition] = fields.numbers("f32", 4);
  const fits = height >= 1 && width >= 1 && Math.max(height, width) <= MAX_SIDE;
  fields.require(fits, `grid ${width}x${height}, sides are 1 to ${MAX_SIDE}`);
  fields.require(degree <= sourceDegree && sourceDegree <= 4, `SH degree ${degree} of ${sourceDegree}`);
  fields.require(zMin > 0 && zMin <= zMax && zMax < Infinity, `depth limits ${zMin} to ${zMax}`);
  fields.require(Number.isFinite(lost) && condition > 0 && condition < Infinity, "a number is out of range");
  fields.require(flags < 32, `unknown flags ${flags}`);
  fields.require(count <= MAX_CHANNELS, `${count} channels, at most ${MAX_CHANNELS}`);
  const [isOwn, isRelative] = [(flags & OWN_INTRINSICS) !== 0, (flags & RELATIVE_ROTATION) !== 0];
  const here = isInParts ? [] : poses;
  const cameras = here.map((pose) => ({ ...pose, ...(isOwn ? readIntrinsics(fields) : {}), width, height }));
  const references = isRelative ? here.map(() => readReference(fields)) : undefined;
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
  const channels = readChannels(fields, count, [1, k || 3, 1, 3, 4, 2], here.length);
  fields.finish();
  const isInverse = (flags & INVERSE_DEPTH) !== 0;
  return {
    height, width, degree, isInverse, set, k, zMin, zMax, cameras, isOwn, isRelative, references, mix, basis, channels,
  };
}

/** A view's reference quaternion. @param {Cursor} fields */
export function readReference(fields) {
  const quat = fields.numbers("f32", 4);
  fields.require(Math.abs(Math.hypot(...quat) - 1) < 1e-3, "a reference quaternion is not of length 1");
  return quat;
}

/**
 * Length and CRC-32 of a picture.
 *
 * @param {Cursor} fields
 * @param {number} before bytes in front of it
 * @returns {Stream}
 */
export function readStream(fields, before) {
  const [length, crc] = [fields.u32(), fields.u32()];
  return { end: before + length, length, crc, data: fields.bytes.subarray(0, 0) };
}

/**
 * @param {Cursor} fields
 * @param {number} count
 * @param {number[]} targets channels of each class
 * @param {number} views
 */
function readChannels(fields, count, targets, views) {
  const ends = targets.map(() => 0);
  const seen = new Set();
  /** @type {Channel[]} */
  const channels = [];
  for (let i = 0; i < count; i++) {
    const channel = readRecord(fields);
    const { planeClass, target } = channel;
    fields.require(planeClass < targets.length, `plane class ${planeClass}`);
    fields.require(target < targets[planeClass], `${CLASS_NAMES[planeClass]} has no channel ${target}`);
    fields.require(i === 0 || planeClass >= channels[i - 1].planeClass, "channels are out of order");
    const name = channelName(channel);
    fields.require(planeClass === DEPTH || !seen.has(name), `${name} stands twice`);
    seen.add(name);
    for (let view = 0; view < (channel.isCoded ? views : 0); view++) {
      const stream = readStream(fields, ends[planeClass]);
      channel.streams.push(stream);
      ends[planeClass] = stream.end;
    }
    channels.push(channel);
  }
  return channels;
}

/**
 * The fixed part of a channel record.
 *
 * @param {Cursor} fields
 * @returns {Channel}
 */
export function readRecord(fields) {
  const [planeClass, target, coding, qp] = fields.take(4);
  const [scale, offset] = fields.numbers("f32", 2);
  fields.require(coding <= INTRA, `coding ${coding} is unknown`);
  fields.require(qp <= MAX_QP, `QP ${qp}, accepted are 0 to ${MAX_QP}`);
  fields.require(Math.abs(scale) < 1e30 && Math.abs(offset) < 1e30, "scale or offset out of range");
  return { planeClass, target, scale, offset, isCoded: coding === INTRA, streams: [] };
}
