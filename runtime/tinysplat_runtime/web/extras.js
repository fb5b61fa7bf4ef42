/** Sections of the modes with photos or exact planes, checked: docs/FORMAT.md, NETW, GRPS, PHOT and EXAC. */
import { readIntrinsics } from "./cameras.js";
import { MAX_QP, MAX_SIDE, readStream } from "./layers.js";
import { cursor, only } from "./sections.js";

/** @typedef {import("./cameras.js").Camera} Camera */
/** @typedef {import("./cursor.js").Cursor} Cursor */
/** @typedef {import("./layers.js").Stream} Stream */
/** @typedef {import("./sections.js").Section} Section */

const MAX_DEPTH = 1e30;
const KEPT = 0x8000;

/** @typedef {{ name: string, sha256: string, near: number, far: number }} Network */
/** @typedef {{ height: number, width: number, qp: number, set: number, streams: Stream[] }} Photos */
/** Photos that a network is given together, and of which of them its Gaussians are taken. @typedef {{ views: number[], kept: number[] }} Group */

/**
 * @typedef {object} ExactLayer
 * @property {number} height
 * @property {number} width
 * @property {number} degree
 * @property {number} zMin
 * @property {number} zMax
 * @property {Uint8Array} sha256
 * @property {Camera[]} cameras of the views that are wanted
 * @property {number[]} views that are wanted
 * @property {Stream[]} streams of all views
 */

/**
 * The table at a section's end: lengths that add up to that of `data`, with CRCs.
 *
 * @param {Cursor} fields
 * @param {number} count
 * @param {Uint8Array} data
 */
function readStreams(fields, count, data) {
  fields.require(8 * count <= fields.bytes.length - fields.at, `a table of ${count} pictures does not fit`);
  const streams = [];
  let end = 0;
  for (let i = 0; i < count; i++) {
    const stream = readStream(fields, end);
    stream.data = data;
    streams.push(stream);
    end = stream.end;
  }
  fields.finish();
  fields.require(end === data.length, `${data.length} bytes behind it, ${end} announced`);
  return streams;
}

/** @param {Cursor} fields @returns {Network} */
export function readNetwork(fields) {
  const sha256 = Array.from(fields.take(32), (byte) => byte.toString(16).padStart(2, "0")).join("");
  const name = fields.ascii(64);
  fields.require(/^[ -~]*$/.test(name), "the network's name is not printable ASCII");
  const [near, far] = fields.numbers("f64", 2);
  fields.finish();
  fields.require(1 / MAX_DEPTH < near && near < far && far < MAX_DEPTH, `near ${near} and far ${far}`);
  return { name, sha256, near, far };
}

/**
 * In which groups a network is given the photos; all at once without the section.
 *
 * @param {Cursor | undefined} fields
 * @param {number} count of views
 * @returns {Group[]}
 */
export function readGroups(fields, count) {
  const all = Array.from({ length: count }, (_, view) => view);
  if (!fields) return [{ views: all, kept: all }];
  /** @type {Set<number>} */
  const keptOnce = new Set();
  const groups = Array.from({ length: fields.u16() }, (_, number) => {
    const words = Array.from({ length: fields.u8() }, () => fields.u16());
    const views = words.map((word) => word & ~KEPT);
    const kept = views.filter((_, i) => words[i] & KEPT);
    const isRising = views.every((view, i) => view < count && (i === 0 || views[i - 1] < view));
    fields.require(isRising, `group ${number} has views ${views.slice(0, 8)}, expected rising ones below ${count}`);
    const isNew = kept.length > 0 && kept.every((view) => !keptOnce.has(view));
    fields.require(isNew, `group ${number} keeps no view, or one that another does`);
    for (const view of kept) keptOnce.add(view);
    return { views, kept };
  });
  fields.finish();
  fields.require(keptOnce.size === count, `${keptOnce.size} of ${count} views are kept in a group`);
  return groups;
}

/** @param {Cursor} fields @param {number} views @param {Uint8Array} data @returns {Photos} */
export function readPhotos(fields, views, data) {
  const [height, width, format, qp, set] = [fields.u32(), fields.u32(), fields.u8(), fields.u8(), fields.u8()];
  fields.u8();
  fields.require(isSide(height) && isSide(width), `photos of ${width}x${height}, sides are 1 to ${MAX_SIDE}`);
  fields.require(format === 0, `photo format ${format} is unknown`);
  fields.require(qp <= MAX_QP, `QP ${qp}, accepted are 0 to ${MAX_QP}`);
  return { height, width, qp, set, streams: readStreams(fields, views, data) };
}

/** @param {number} side */
function isSide(side) {
  return side >= 1 && side <= MAX_SIDE;
}

/**
 * @param {Section[]} sections
 * @param {number} count
 * @param {Camera[]} poses
 * @param {(pixels: number, memory: number, where: string) => void} requireLimits
 * @returns {ExactLayer[]}
 */
export function readExactLayers(sections, count, poses, requireLimits) {
  let [pixels, memory] = [0, 0];
  /** @type {ExactLayer[]} */
  const layers = [];
  for (let index = 0; index < count; index++) {
    const { data } = only(sections, "EXAP", index);
    const layer = readExact(cursor(only(sections, "EXAC", index)), poses, data);
    const gaussians = poses.length * layer.height * layer.width;
    pixels += gaussians;
    memory += 12 * gaussians * exactPlanes(layer.degree);
    requireLimits(pixels, memory, `EXAC[${index}]`);
    layers.push(layer);
  }
  return layers;
}

/** Planes of a view. @param {number} degree */
export function exactPlanes(degree) {
  return 12 + 3 * (degree + 1) ** 2;
}

/** @param {Cursor} fields @param {Camera[]} poses @param {Uint8Array} data @returns {ExactLayer} */
function readExact(fields, poses, data) {
  const [height, width, degree] = [fields.u32(), fields.u32(), fields.u8()];
  fields.take(3);
  const [zMin, zMax] = fields.numbers("f32", 2);
  const sha256 = fields.take(32);
  fields.require(isSide(height) && isSide(width), `grid ${width}x${height}, sides are 1 to ${MAX_SIDE}`);
  fields.require(degree <= 4, `SH degree ${degree}, accepted are 0 to 4`);
  fields.require(1 / MAX_DEPTH < zMin && zMin <= zMax && zMax < MAX_DEPTH, `depth limits ${zMin} to ${zMax}`);
  const cameras = poses.map(({ c2w }) => ({ ...readIntrinsics(fields), c2w, width, height }));
  const streams = readStreams(fields, poses.length * exactPlanes(degree), data);
  return { height, width, degree, zMin, zMax, sha256, cameras, views: poses.map((_, view) => view), streams };
}
