/** The table of pictures: docs/FORMAT.md, PICT. */
import { Cursor, crc32 } from "./cursor.js";
import { TsplatError, require } from "./errors.js";
import { cursor, only } from "./sections.js";

/** @typedef {import("./sections.js").Section} Section */

/** Numbers of the classes of what the table lists. */
export const DEPTH = 0;
export const COLOR = 1;
export const OPACITY = 2;
export const SCALE = 3;
export const ROTATION = 4;
export const OFFSET = 5;
export const POSITION = 6;
export const EXACT = 7;
export const PHOTO = 8;
export const CLASS_NAMES = ["depth", "color", "opacity", "scale", "rotation", "offset", "position", "exact", "photo"];

export const MAX_VIEWS = 4096;
const MAX_QP = 51;
const CONSTANT = 255;
const STREAM_BYTES = 8;

/**
 * A picture, of whose `length` bytes `data` are those at hand; `end` is where it ends in the file.
 *
 * @typedef {{ end: number, length: number, crc: number, data: Uint8Array }} Stream
 */

/**
 * @typedef {object} Channel
 * @property {number} layer or tier
 * @property {number} planeClass
 * @property {number} target which channel of the class it adds to
 * @property {number} qp of its pictures
 * @property {number} scale units per code
 * @property {number} offset value of code 0, or of a constant channel
 * @property {boolean} isCoded whether it has pictures; else it is constant
 * @property {Stream[]} streams one per view, of a coded channel
 */

/**
 * @typedef {object} Table
 * @property {Channel[]} rows in the order of their bytes
 * @property {number} count views of the file
 * @property {number[]} views whose pictures these are
 */

/** @param {Pick<Channel, "planeClass" | "target">} channel */
export function channelName(channel) {
  return `${CLASS_NAMES[channel.planeClass]}${channel.target}`;
}

/**
 * The pictures of the views that are wanted.
 *
 * @param {Section[]} sections
 * @param {number[] | undefined} wanted all where none are given
 * @returns {Table}
 */
export function readPictures(sections, wanted) {
  const [fields, data] = [cursor(only(sections, "PICT")), only(sections, "DATA")];
  const [rowCount, count, order] = [fields.u16(), fields.u16(), fields.u16()];
  fields.require(count >= 1 && count <= MAX_VIEWS, `${count} views, accepted are 1 to ${MAX_VIEWS}`);
  fields.require(order === 0, `order ${order} is unknown`);
  const rows = Array.from({ length: rowCount }, () => readRow(fields));
  const coded = rows.filter((channel) => channel.isCoded);
  const views = wanted ?? Array.from({ length: count }, (_, view) => view);
  const streams = readStreams(fields, count * coded.length, data.data, data.start);
  fields.finish();
  const total = streams.reduce((sum, { length }) => sum + length, 0);
  require(total === data.length, `${data.length} bytes, its pictures need ${total}`, "DATA[0]");
  coded.forEach((channel, i) => (channel.streams = views.map((view) => streams[i * count + view])));
  return { rows, count, views };
}

/** @param {Cursor} fields @returns {Channel} */
function readRow(fields) {
  const [layer, planeClass, target, qp] = fields.take(4);
  const [scale, offset] = fields.numbers("f32", 2);
  fields.require(planeClass < CLASS_NAMES.length, `plane class ${planeClass}`);
  fields.require(qp <= MAX_QP || qp === CONSTANT, `QP ${qp}, accepted are 0 to ${MAX_QP}`);
  fields.require(Math.abs(scale) < 1e30 && Math.abs(offset) < 1e30, "scale or offset out of range");
  return { layer, planeClass, target, qp, scale, offset, isCoded: qp !== CONSTANT, streams: [] };
}

/**
 * Pictures one behind the other: lengths and CRCs.
 *
 * @param {Cursor} fields
 * @param {number} count
 * @param {Uint8Array} data their bytes, as far as they are at hand
 * @param {number} start of the first in the file
 */
function readStreams(fields, count, data, start) {
  fields.require(STREAM_BYTES * count <= fields.bytes.length - fields.at, `a table of ${count} pictures does not fit`);
  let at = 0;
  return Array.from({ length: count }, () => {
    const [length, crc] = [fields.u32(), fields.u32()];
    at += length;
    return { end: start + at, length, crc, data: data.subarray(at - length, at) };
  });
}

/**
 * A layer's or a tier's channels, by class and target.
 *
 * @param {Table} table
 * @param {number} layer
 */
export function channelsOf({ rows }, layer) {
  return rows
    .filter((channel) => channel.layer === layer)
    .sort((a, b) => a.planeClass - b.planeClass || a.target - b.target);
}

/**
 * A picture's bytes; undefined where a prefix does not hold them to their end.
 *
 * @param {Stream} stream
 */
export function held(stream) {
  return stream.data.length === stream.length ? stream.data : undefined;
}

/**
 * A picture's bytes, which have to be there and intact.
 *
 * @param {Stream} stream
 * @param {string} where
 */
export function intact(stream, where) {
  const data = held(stream);
  if (!data) throw new TsplatError("cut short", where);
  if (crc32(data) !== stream.crc) throw new TsplatError("CRC differs: the bytes were altered", where, stream.end);
  return data;
}

/**
 * Refuse channels with pictures whose parameter set is missing.
 *
 * @param {Map<number, Uint8Array>} sets
 * @param {number} set
 * @param {Channel[]} channels
 * @param {string} where
 */
export function requireSet(sets, set, channels, where) {
  const isThere = sets.has(set) || channels.every(({ streams }) => !streams.length);
  require(isThere, `parameter set ${set} is missing`, where);
}
