/** Metadata of mode list, checked: docs/FORMAT.md, LIST and TIER. */
import { MAX_CODE, MAX_DECODED, MAX_ROTATION, requireBound } from "./bounds.js";
import { TsplatError } from "./errors.js";
import { cursor, only } from "./sections.js";
import { COLOR, OPACITY, POSITION, ROTATION, SCALE, channelName, channelsOf, requireSet } from "./table.js";

/** @typedef {import("./cursor.js").Cursor} Cursor */
/** @typedef {import("./table.js").Channel} Channel */

const MAX_LEVELS = 21;
const MAX_GROWTH = 2;
const MAX_THRESHOLDS = 255;
const MAX_CLASSES = 32;
/** Gaussians that a byte of a file may stand for. */
const MAX_PER_BYTE = 256;
/** Largest logarithm of a scale, and of a contracted coordinate. */
export const MAX_LOG = 69;

/** Channels by which others are sorted, in this order. */
export const DETERMINING = ["opacity0", "scale0", "scale1"];

/** @typedef {Channel & { centre: number }} TierChannel */

/**
 * @typedef {object} Tier
 * @property {number} count
 * @property {number[]} levels cells of each level of the octree
 * @property {number} leaves
 * @property {number} escapes
 * @property {number} cell
 * @property {number} set index of its parameter sets
 * @property {import("./table.js").Stream} positions
 * @property {TierChannel[]} channels by class and target
 * @property {number} growth of logarithms of scales before it where it is absent
 */

/**
 * @typedef {object} List
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
 * @property {Tier[]} tiers
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
 * @param {import("./container.js").Container} file
 * @param {number} tierCount
 * @param {{ maxPixels: number, maxMemory: number }} limits
 * @returns {List}
 */
export function readList(file, tierCount, limits) {
  const fields = cursor(only(file.sections, "LIST"));
  const degree = fields.u8();
  fields.u8();
  const k = fields.u16();
  const [centre, [radius], low] = [fields.numbers("f64", 3), fields.numbers("f64", 1), fields.numbers("f64", 3)];
  const middle = fields.f32();
  const d = 3 * (degree + 1) ** 2;
  fields.require(degree <= 4, `SH degree ${degree}, accepted are 0 to 4`);
  fields.require(k <= d, `k = ${k}, accepted are 0 to ${d}`);
  const thresholds = DETERMINING.map(() => readFloats(fields, MAX_THRESHOLDS));
  const isRising = thresholds.every((values) => values.every((value, i) => i === 0 || value > values[i - 1]));
  fields.require(isRising, "thresholds do not rise");
  const orders = DETERMINING.map(() => {
    const [first, gains] = [fields.u16(), readFloats(fields, MAX_CLASSES)];
    fields.require(gains.length > 0, "an order without gains");
    return { first, gains };
  });
  const mean = fields.numbers("f32", d);
  const basis = fields.numbers("f16", d * k);
  fields.finish();
  const tiers = Array.from({ length: tierCount }, (_, number) => readTier(file, number, k));
  for (const { cell, levels } of tiers) checkGrid(fields, centre, radius, cell, low, levels.length);
  const count = tiers.reduce((sum, tier) => sum + tier.count, 0);
  fields.require(count <= limits.maxPixels, `${count} Gaussians, the limit is ${limits.maxPixels}`);
  const paid = MAX_PER_BYTE * file.sections.reduce((sum, { data }) => sum + data.length, 0);
  fields.require(count <= paid, `${count} Gaussians, the file's bytes stand for ${paid} at most`);
  const memory = count * (4 * (11 + d) + 2 * (7 + k) + 8 * (16 + k) + 64);
  fields.require(memory <= limits.maxMemory, `${memory} bytes to decode, the limit is ${limits.maxMemory}`);
  const scene = { count, degree, centre, radius, low, middle, thresholds, orders, mean, basis, k, tiers };
  checkListRanges(fields, scene);
  return scene;
}

/**
 * @param {import("./container.js").Container} file
 * @param {number} number of the tier
 * @param {number} k
 * @returns {Tier}
 */
function readTier(file, number, k) {
  const fields = cursor(only(file.sections, "TIER", number));
  const [count, levelCount, set] = [fields.u32(), fields.u8(), fields.u8()];
  fields.u16();
  const [leaves, escapes, cell, growth] = [fields.u32(), fields.u32(), fields.f64(), fields.f32()];
  fields.require(count > 0, "0 Gaussians, accepted are 1 and more");
  fields.require(growth >= 0 && growth <= MAX_GROWTH, `growth ${growth}, accepted are 0 to ${MAX_GROWTH}`);
  fields.require(levelCount >= 1 && levelCount <= MAX_LEVELS, `${levelCount} levels, accepted are 1 to ${MAX_LEVELS}`);
  const levels = Array.from({ length: levelCount }, () => fields.u32());
  const chain = [...levels, leaves];
  const grows = levels.every((size, i) => chain[i + 1] >= size && chain[i + 1] <= 8 * size);
  fields.require(levels[0] === 1 && grows, "the octree's levels do not grow as an octree's do");
  fields.require(
    leaves <= count && escapes <= leaves,
    `${leaves} leaves and ${escapes} escapes for ${count} Gaussians`,
  );
  const centres = fields.numbers("f32", 7 + k);
  fields.require(
    centres.every((centre) => Math.abs(centre) < MAX_DECODED),
    "a centre is out of range",
  );
  fields.finish();
  const found = channelsOf(file.table, number);
  const positions = found.find(({ planeClass }) => planeClass === POSITION);
  /** @type {[number, number][]} */
  const wanted = [
    [COLOR, k],
    [OPACITY, 1],
    [SCALE, 3],
    [ROTATION, 3],
  ];
  const names = wanted.flatMap(([planeClass, targets]) =>
    Array.from({ length: targets }, (_, target) => channelName({ planeClass, target })),
  );
  const channels = names.map((name) => /** @type {Channel} */ (found.find((channel) => channelName(channel) === name)));
  const isWhole =
    found.length === names.length + 1 && channels.every(Boolean) && positions?.isCoded && positions.target === 0;
  if (!positions || !isWhole) {
    throw new TsplatError(
      `${found.length} channels of tier ${number}, expected ${names.length} and positions, each once`,
      "PICT[0]",
    );
  }
  requireSet(file.sets, set, channels, fields.section);
  const own = channels.map((channel, i) => ({ ...channel, centre: centres[i] }));
  return { count, levels, leaves, escapes, cell, set, positions: positions.streams[0], channels: own, growth };
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
 * @param {number} most
 */
function readFloats(fields, most) {
  const count = fields.u16();
  fields.require(count <= most, `${count} numbers, at most ${most}`);
  const values = fields.numbers("f32", count);
  fields.require(
    values.every((value) => Math.abs(value) < MAX_DECODED),
    "a number is out of range",
  );
  return values;
}

/**
 * @param {Cursor} fields
 * @param {List} scene
 */
function checkListRanges(fields, scene) {
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
