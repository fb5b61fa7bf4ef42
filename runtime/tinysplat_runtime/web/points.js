/** Metadata of mode free, checked: docs/FORMAT.md, FREE, TIER and SEEN. */
import { MAX_CODE, MAX_DECODED, MAX_ROTATION, requireBound } from "./bounds.js";
import { MAX_INTRINSIC, MAX_POSITION, MIN_FOCAL } from "./cameras.js";
import { crc32 } from "./cursor.js";
import { COLOR, MAX_SIDE, OPACITY, ROTATION, SCALE, channelName, readRecord, readStream } from "./layers.js";
import { cursor, label, only } from "./sections.js";

/** @typedef {import("./cursor.js").Cursor} Cursor */
/** @typedef {import("./layers.js").Channel} Channel */
/** @typedef {import("./sections.js").Section} Section */

const MAX_LEVELS = 21;
const MAX_TIERS = 16;
const MAX_GROWTH = 2;
const STREAMS = 6;
const MAX_THRESHOLDS = 255;
const MAX_CLASSES = 32;
/** Gaussians that a byte of a file may stand for. */
const MAX_PER_BYTE = 256;
/** Largest logarithm of a scale, and of a contracted coordinate. */
export const MAX_LOG = 69;

/** Channels by which others are sorted, in this order. */
export const DETERMINING = ["opacity0", "scale0", "scale1"];

/** @typedef {Channel & { centre: number }} FreeChannel */

/**
 * @typedef {object} FreeTier
 * @property {number} count
 * @property {number[]} levels cells of each level of the octree
 * @property {number} leaves
 * @property {number} escapes
 * @property {number} cell
 * @property {Uint8Array[] | undefined} streams of FREP; none where a prefix does not hold them all
 * @property {FreeChannel[]} channels
 * @property {number} growth of logarithms of scales before it where it is absent
 */

/**
 * @typedef {object} FreeScene
 * @property {number} count of all tiers
 * @property {number} degree
 * @property {Float64Array} centre
 * @property {number} radius
 * @property {Float64Array} low
 * @property {number} middle m of the sizes
 * @property {Float64Array[]} thresholds of each determinant
 * @property {{ first: number, gains: Float64Array }[]} orders
 * @property {Float64Array} mean of the SH coefficients
 * @property {Float64Array} basis d × k row by row
 * @property {number} k
 * @property {FreeTier[]} tiers
 */

/**
 * How many determinants a channel's order follows.
 *
 * @param {Channel} channel
 */
export function orderOf(channel) {
  if (channel.planeClass === ROTATION) return 3;
  if (channel.planeClass === OPACITY) return 0;
  return channel.planeClass === SCALE && channel.target === 0 ? 1 : 2;
}

/**
 * @param {Section[]} sections
 * @param {{ maxPixels: number, maxMemory: number }} limits
 * @returns {FreeScene}
 */
export function readFree(sections, limits) {
  const fields = cursor(only(sections, "FREE"));
  const [first, degree, levelCount] = [fields.u32(), fields.u8(), fields.u8()];
  const [channelCount, k] = [fields.u16(), fields.u16()];
  fields.take(6);
  const [leaves, escapes] = [fields.u32(), fields.u32()];
  const [centre, [radius, cell], low] = [fields.numbers("f64", 3), fields.numbers("f64", 2), fields.numbers("f64", 3)];
  const middle = fields.f32();
  const behind = tiersBehind(sections);
  const count = behind.reduce((sum, tier) => sum + tier.count, first);
  const d = 3 * (degree + 1) ** 2;
  fields.require(degree <= 4, `SH degree ${degree}, accepted are 0 to 4`);
  fields.require(first >= 1 && count <= limits.maxPixels, `${count} Gaussians, the limit is ${limits.maxPixels}`);
  const paid = MAX_PER_BYTE * sections.reduce((sum, { data }) => sum + data.length, 0);
  fields.require(count <= paid, `${count} Gaussians, the file's bytes stand for ${paid} at most`);
  fields.require(k <= d, `k = ${k}, accepted are 0 to ${d}`);
  fields.require(channelCount === 7 + k, `${channelCount} channels, expected ${7 + k}`);
  const memory = count * (4 * (11 + d) + 2 * (7 + k) + 8 * (16 + k) + 64);
  fields.require(memory <= limits.maxMemory, `${memory} bytes to decode, the limit is ${limits.maxMemory}`);
  const space = { centre, radius, low };
  const tier = { count: first, leaves, escapes, cell, growth: 0 };
  const octree = readOctree(fields, sections, 0, tier, levelCount, space);
  const thresholds = DETERMINING.map(() => readFloats(fields, MAX_THRESHOLDS));
  const isRising = thresholds.every((values) => values.every((value, i) => i === 0 || value > values[i - 1]));
  fields.require(isRising, "thresholds do not rise");
  const orders = DETERMINING.map(() => {
    const [start, gains] = [fields.u16(), readFloats(fields, MAX_CLASSES)];
    fields.require(gains.length > 0, "an order without gains");
    return { first: start, gains };
  });
  const mean = fields.numbers("f32", d);
  const basis = fields.numbers("f16", d * k);
  const tiers = [{ ...tier, ...octree, channels: readFreeChannels(fields, k) }];
  fields.finish();
  behind.forEach(({ fields: own, levelCount: levels, ...fixed }, i) => {
    const tree = readOctree(own, sections, i + 1, fixed, levels, space);
    tiers.push({ ...fixed, ...tree, channels: readFreeChannels(own, k) });
    own.finish();
  });
  const stray = sections.find(({ type, index }) => type === "FREP" && index > behind.length);
  fields.require(!stray, `${stray && label(stray)} holds positions of no tier`);
  const scene = { count, degree, centre, radius, low, middle, thresholds, orders, mean, basis, k, tiers };
  checkFreeRanges(fields, scene);
  return scene;
}

const VIEWPOINT_BYTES = 52;
const MAX_VIEWPOINTS = 4096;

/**
 * Cameras of the photos that a scene was made from, as far as the file has them.
 *
 * @param {Section[]} sections
 * @param {ArrayLike<number>} origin
 * @returns {import("./cameras.js").Camera[]}
 */
export function readViewpoints(sections, origin) {
  if (!sections.some(({ type }) => type === "SEEN")) return [];
  const fields = cursor(only(sections, "SEEN"));
  const count = only(sections, "SEEN").data.length / VIEWPOINT_BYTES;
  const isWhole = Number.isInteger(count) && count >= 1 && count <= MAX_VIEWPOINTS;
  fields.require(isWhole, `${count} cameras, accepted are 1 to ${MAX_VIEWPOINTS}`);
  const cameras = Array.from({ length: count }, () => {
    const place = fields.numbers("f32", 3).map((x, axis) => x + origin[axis]);
    const turn = fields.numbers("f32", 4);
    const [fx, fy, cx, cy] = fields.numbers("f32", 4);
    const [width, height] = [fields.u32(), fields.u32()];
    const size = Math.hypot(...turn);
    fields.require(Math.abs(size - 1) <= 1e-3, `a quaternion of length ${size}, expected 1`);
    fields.require(place.every((x) => Math.abs(x) <= MAX_POSITION), `a camera at ${place}`);
    fields.require(fx >= MIN_FOCAL && fy >= MIN_FOCAL, `focal lengths ${fx} and ${fy}`);
    fields.require([fx, fy, cx, cy].every((x) => Math.abs(x) <= MAX_INTRINSIC), "an intrinsic number out of range");
    const isSized = width >= 1 && height >= 1 && Math.max(width, height) <= MAX_SIDE;
    fields.require(isSized, `a picture of ${width}x${height}, sides are 1 to ${MAX_SIDE}`);
    const [w, x, y, z] = turn.map((component) => component / size);
    const c2w = Float64Array.of(
      1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), place[0],
      2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), place[1],
      2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y), place[2],
      0, 0, 0, 1,
    );
    return { width, height, fx, fy, cx, cy, skew: 0, c2w };
  });
  fields.finish();
  return cameras;
}

/**
 * The fixed fields of the sections TIER, which have the numbers 1, 2, 3, …
 *
 * @param {Section[]} sections
 */
function tiersBehind(sections) {
  const found = sections.filter(({ type }) => type === "TIER").sort((a, b) => a.index - b.index);
  return found.map((section, i) => {
    const fields = cursor(section);
    fields.require(section.index === i + 1 && i + 1 < MAX_TIERS, `expected TIER[${i + 1}], of at most ${MAX_TIERS - 1}`);
    const [count, levelCount] = [fields.u32(), fields.u8()];
    fields.take(3);
    const [leaves, escapes, cell, growth] = [fields.u32(), fields.u32(), fields.f64(), fields.f32()];
    fields.require(count > 0, "0 Gaussians, accepted are 1 and more");
    fields.require(growth >= 0 && growth <= MAX_GROWTH, `growth ${growth}, accepted are 0 to ${MAX_GROWTH}`);
    return { fields, count, levelCount, leaves, escapes, cell, growth };
  });
}

/**
 * Levels and streams of a tier's positions.
 *
 * @param {Cursor} fields
 * @param {Section[]} sections
 * @param {number} number of the tier
 * @param {{ count: number, leaves: number, escapes: number, cell: number }} tier
 * @param {number} levelCount
 * @param {{ centre: Float64Array, radius: number, low: Float64Array }} space
 */
function readOctree(fields, sections, number, { count, leaves, escapes, cell }, levelCount, { centre, radius, low }) {
  const points = only(sections, "FREP", number);
  fields.require(levelCount >= 1 && levelCount <= MAX_LEVELS, `${levelCount} levels, accepted are 1 to ${MAX_LEVELS}`);
  checkGrid(fields, centre, radius, cell, low, levelCount);
  const levels = Array.from({ length: levelCount }, () => fields.u32());
  const chain = [...levels, leaves];
  const grows = levels.every((size, i) => chain[i + 1] >= size && chain[i + 1] <= 8 * size);
  fields.require(levels[0] === 1 && grows, "the octree's levels do not grow as an octree's do");
  fields.require(leaves <= count && escapes <= leaves, `${leaves} leaves and ${escapes} escapes for ${count} Gaussians`);
  return { levels, streams: readPointStreams(fields, points) };
}

/**
 * @param {Cursor} fields
 * @param {Float64Array} centre
 * @param {number} radius
 * @param {number} cell
 * @param {Float64Array} low
 * @param {number} levels
 */
function checkGrid(fields, centre, radius, cell, low, levels) {
  for (const x of centre) fields.require(Math.abs(x) <= MAX_DECODED, `a centre at ${x}`);
  fields.require(radius > 0 && radius < MAX_DECODED && cell > 0 && cell <= 1, `radius ${radius} or cell ${cell}`);
  const reach = Math.max(...low.map(Math.abs)) + cell * 2 ** levels;
  const largest = radius * Math.exp(Math.min(reach, MAX_LOG)) + Math.max(...centre.map(Math.abs));
  fields.require(reach <= MAX_LOG && largest <= MAX_DECODED, "positions can decode to more than 1e30");
}

/**
 * @param {Cursor} fields
 * @param {Section} points
 */
function readPointStreams(fields, points) {
  const streams = [];
  const isAtHand = points.data.length === points.length; // not where a prefix ends before or in it
  let end = 0;
  for (let i = 0; i < STREAMS; i++) {
    const [length, crc] = [fields.u32(), fields.u32()];
    const data = points.data.subarray(end, end + length);
    const isRight = !isAtHand || (data.length === length && crc32(data) === crc);
    fields.require(isRight, `stream ${i} of the positions was altered`);
    streams.push(data);
    end += length;
  }
  fields.require(end === points.length, `${points.length} bytes of positions, ${end} announced`);
  return isAtHand ? streams : undefined;
}

/**
 * @param {Cursor} fields
 * @param {number} most
 */
function readFloats(fields, most) {
  const count = fields.u16();
  fields.require(count <= most, `${count} numbers, at most ${most}`);
  const values = fields.numbers("f32", count);
  fields.require(values.every((value) => Math.abs(value) < MAX_DECODED), "a number is out of range");
  return values;
}

/**
 * @param {Cursor} fields
 * @param {number} k
 */
function readFreeChannels(fields, k) {
  const wanted = [[COLOR, k], [OPACITY, 1], [SCALE, 3], [ROTATION, 3]];
  /** @type {FreeChannel[]} */
  const channels = [];
  for (const [planeClass, targets] of wanted) {
    let end = 0;
    for (let target = 0; target < targets; target++) {
      const channel = { ...readRecord(fields), centre: fields.f32() };
      const isExpected = channel.planeClass === planeClass && channel.target === target;
      fields.require(isExpected, `class ${channel.planeClass}, channel ${channel.target} where others belong`);
      fields.require(Math.abs(channel.centre) < MAX_DECODED, `${channelName(channel)}: centre out of range`);
      if (channel.isCoded) {
        channel.streams.push(readStream(fields, end));
        end = channel.streams[0].end;
      }
      channels.push(channel);
    }
  }
  return channels;
}

/**
 * @param {Cursor} fields
 * @param {FreeScene} scene
 */
function checkFreeRanges(fields, scene) {
  const { mean, basis, k, orders, tiers, middle } = scene;
  fields.require(Math.abs(middle) <= MAX_LOG, `size_middle ${middle}`);
  fields.require(mean.every(Number.isFinite) && basis.every(Number.isFinite), "a number is not finite");
  for (const { channels } of tiers) {
    const reach = channels.map((channel) => {
      const order = orderOf(channel);
      const gain = order ? Math.max(...orders[order - 1].gains.map(Math.abs)) : 1;
      const coded = Math.abs(channel.offset) + (channel.isCoded ? MAX_CODE * Math.abs(channel.scale) : 0);
      return gain * coded + Math.abs(channel.centre);
    });
    channels.forEach((channel, i) => {
      if (channel.planeClass === COLOR) return;
      const bound = channel.planeClass === ROTATION ? MAX_ROTATION : MAX_DECODED;
      requireBound(reach[i], bound, channelName(channel), fields.section);
    });
    mean.forEach((value, row) => {
      let sum = Math.abs(value);
      for (let i = 0; i < k; i++) sum += Math.abs(basis[row * k + i]) * reach[i];
      requireBound(sum, MAX_DECODED, "sh", fields.section);
    });
  }
}
