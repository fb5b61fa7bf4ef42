/** A file's metadata, checked: docs/FORMAT.md, section 2. What passes here may be indexed freely. */
import { checkRanges, decodingBytes } from "./bounds.js";
import { readIntrinsics, readPose, requirePosition } from "./cameras.js";
import { crc32 } from "./cursor.js";
import { TsplatError, require } from "./errors.js";
import { readFree } from "./points.js";
import { MAX_QP, MAX_SIDE, readLayer } from "./layers.js";
import { readNotes } from "./notes.js";
import { PLANES, cursor, only, readTable, verified } from "./sections.js";

/** @typedef {import("./cameras.js").Camera} Camera */
/** @typedef {import("./cursor.js").Cursor} Cursor */
/** @typedef {import("./layers.js").Channel} Channel */
/** @typedef {import("./layers.js").Layer} Layer */
/** @typedef {import("./layers.js").Stream} Stream */
/** @typedef {import("./sections.js").Section} Section */

const PART = 256;
const MAX_DEPTH = 1e30;

/**
 * What a reader accepts before it takes memory.
 *
 * @typedef {object} Limits
 * @property {number} maxPixels Gaussians over all views and layers
 * @property {number} maxMemory bytes that decoding takes
 * @property {number} maxViews
 * @property {number} maxLayers
 */

/** @type {Limits} */
export const LIMITS = { maxPixels: 2 ** 26, maxMemory: 2 ** 32, maxViews: 256, maxLayers: 16 };

/** @typedef {{ name: string, sha256: string, near: number, far: number }} Network */
/** @typedef {{ height: number, width: number, qp: number, set: number, streams: Stream[], data: Uint8Array }} Photos */

/**
 * @typedef {object} ExactLayer
 * @property {number} height
 * @property {number} width
 * @property {number} degree
 * @property {number} zMin
 * @property {number} zMax
 * @property {Uint8Array} sha256
 * @property {Camera[]} cameras
 * @property {Stream[]} streams
 * @property {Uint8Array} data
 */

/**
 * @typedef {object} Container
 * @property {number[]} version
 * @property {number} total bytes of the whole file
 * @property {string} profile
 * @property {number} qp Q_g
 * @property {Float64Array} origin
 * @property {"gaussians" | "photos" | "hybrid" | "lossless" | "free"} mode
 * @property {Camera[]} cameras
 * @property {Layer[]} layers
 * @property {ExactLayer[]} exact
 * @property {import("./points.js").FreeScene | undefined} free
 * @property {Network | undefined} network
 * @property {Photos | undefined} photos
 * @property {Map<number, Uint8Array>} sets parameter sets by index
 * @property {Map<string, Uint8Array>} streams pictures of a class, by `${class}.${layer}`
 * @property {Record<string, string>} notes
 * @property {Section[]} sections
 */

/**
 * Parse and check a file.
 *
 * @param {Uint8Array} bytes
 * @param {Limits} limits
 * @param {boolean} isPrefix
 * @returns {Container}
 */
export function readContainer(bytes, limits, isPrefix) {
  const { version, total, sections } = readTable(bytes, isPrefix);
  const scene = cursor(only(sections, "SCEN"));
  const [views, count, qp] = [scene.u16(), scene.u16(), scene.f32()];
  const origin = scene.numbers("f64", 3);
  const profile = scene.ascii(16);
  scene.finish();
  scene.require(Number.isFinite(qp), "Q_g is not finite");
  requirePosition(scene, origin);
  /** @type {Container} */
  const file = {
    version, total, profile, qp, origin, mode: "gaussians", cameras: [], layers: [], exact: [], free: undefined,
    network: undefined, photos: undefined, sets: new Map(), streams: new Map(), notes: {}, sections,
  };
  const types = new Set(sections.map((section) => section.type));
  if (types.has("FREE")) {
    scene.require(views === 0 && count === 0, "views or layers of Gaussians without pixels");
    file.mode = "free";
    const free = readFree(only(sections, "FREE"), only(sections, "FREP"), limits);
    file.free = free;
    joinStreams(file, free.channels, 0);
    if (file.streams.size) file.sets.set(0, only(sections, "HEVC").data);
    file.notes = readNotes(sections);
    return file;
  }
  scene.require(views >= 1 && views <= limits.maxViews, `${views} views, accepted are 1 to ${limits.maxViews}`);
  if (types.has("NETW") || types.has("PHOT") || types.has("PICS")) {
    file.network = readNetwork(cursor(only(sections, "NETW")));
    file.photos = readPhotos(cursor(only(sections, "PHOT")), views, only(sections, "PICS").data);
    file.mode = count ? "hybrid" : "photos";
  }
  const fewest = file.photos ? 0 : 1;
  scene.require(count >= fewest && count <= limits.maxLayers, `${count} layers, at most ${limits.maxLayers}`);
  const poses = readCameras(only(sections, "CAMS"), views);
  if (types.has("EXAC")) {
    file.mode = "lossless";
    file.exact = readExactLayers(sections, count, poses, limits);
  } else {
    readLayers(file, count, poses, limits);
  }
  const { height, width } = grid(file, views, limits);
  file.cameras = poses.map((pose) => ({ ...pose, width, height }));
  for (const section of sections) if (section.type === "HEVC") file.sets.set(section.index, verified(section).data);
  file.layers.forEach((layer, index) => {
    const isThere = !layer.channels.some((channel) => channel.streams.length) || file.sets.has(layer.set);
    require(isThere, `parameter set ${layer.set} is missing`, `LAYR[${index}]`);
  });
  const { photos } = file;
  require(!photos || file.sets.has(photos.set), "its parameter set is missing", "PHOT[0]");
  file.notes = readNotes(sections);
  return file;
}

/**
 * @param {Section} section
 * @param {number} views
 */
function readCameras(section, views) {
  const fields = cursor(section);
  const poses = [];
  for (let view = 0; view < views; view++) {
    poses.push({ ...readIntrinsics(fields), c2w: readPose(fields), width: 1, height: 1 });
  }
  fields.finish();
  return poses;
}

/**
 * @param {Container} file
 * @param {number} count
 * @param {Camera[]} poses
 * @param {Limits} limits
 */
function readLayers(file, count, poses, limits) {
  let [pixels, memory] = [0, 0];
  for (let index = 0; index < count; index++) {
    const layer = readLayer(only(file.sections, "LAYR", index), poses);
    pixels += poses.length * layer.height * layer.width;
    memory += decodingBytes(layer);
    requireLimits(pixels, memory, limits, `LAYR[${index}]`);
    checkRanges(layer, file.origin, `LAYR[${index}]`);
    file.layers.push(layer);
    joinStreams(file, layer.channels, index);
  }
}

/**
 * @param {number} pixels
 * @param {number} memory
 * @param {Limits} limits
 * @param {string} where
 */
function requireLimits(pixels, memory, limits, where) {
  require(pixels <= limits.maxPixels, `${pixels} Gaussians, the limit is ${limits.maxPixels}`, where);
  require(memory <= limits.maxMemory, `${memory} bytes to decode, the limit is ${limits.maxMemory}`, where);
}

/**
 * Height and width of layer 0, which the photos share where there are any.
 *
 * @param {Container} file
 * @param {number} views
 * @param {Limits} limits
 */
function grid(file, views, limits) {
  const first = file.exact[0] ?? file.layers[0];
  const { photos } = file;
  if (!photos) return first;
  const fits = !first || (first.height === photos.height && first.width === photos.width);
  require(fits, "photos of another size than layer 0", "PHOT[0]");
  const pixels = views * photos.height * photos.width;
  require(pixels <= limits.maxPixels, `${pixels} pixels of photos, the limit is ${limits.maxPixels}`, "PHOT[0]");
  return photos;
}

/**
 * Put the sections of a layer's classes together: parts 0, 1, 2 … in this order.
 *
 * @param {Container} file
 * @param {Channel[]} channels
 * @param {number} index of the layer
 */
function joinStreams(file, channels, index) {
  PLANES.forEach((type, number) => {
    const last = channels.filter((channel) => channel.planeClass === number && channel.streams.length).at(-1);
    if (!last) return;
    const parts = file.sections.filter((section) => section.type === type && section.index % PART === index);
    const where = `${type}[${index}]`;
    require(parts.length > 0, "missing", where);
    const isOrdered = parts.every((part, i) => (part.index - index) / PART === i);
    require(isOrdered, "its parts are not each there once and in order", where);
    const stated = parts.reduce((sum, part) => sum + part.length, 0);
    const { offset, length } = last.streams[last.streams.length - 1];
    require(offset + length === stated, `${stated} bytes, its pictures need ${offset + length}`, where);
    file.streams.set(`${number}.${index}`, parts.length === 1 ? parts[0].data : joined(parts.map((part) => part.data)));
  });
}

/** @param {Uint8Array[]} parts */
function joined(parts) {
  const out = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    out.set(part, at);
    at += part.length;
  }
  return out;
}

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
    const [length, crc] = [fields.u32(), fields.u32()];
    streams.push({ offset: end, length, crc });
    end += length;
  }
  fields.finish();
  fields.require(end === data.length, `${data.length} bytes behind it, ${end} announced`);
  return streams;
}

/** @param {Cursor} fields @returns {Network} */
function readNetwork(fields) {
  const sha256 = Array.from(fields.take(32), (byte) => byte.toString(16).padStart(2, "0")).join("");
  const name = fields.ascii(64);
  fields.require(/^[ -~]*$/.test(name), "the network's name is not printable ASCII");
  const [near, far] = fields.numbers("f64", 2);
  fields.finish();
  fields.require(1 / MAX_DEPTH < near && near < far && far < MAX_DEPTH, `near ${near} and far ${far}`);
  return { name, sha256, near, far };
}

/** @param {Cursor} fields @param {number} views @param {Uint8Array} data @returns {Photos} */
function readPhotos(fields, views, data) {
  const [height, width, format, qp, set] = [fields.u32(), fields.u32(), fields.u8(), fields.u8(), fields.u8()];
  fields.u8();
  fields.require(isSide(height) && isSide(width), `photos of ${width}x${height}, sides are 1 to ${MAX_SIDE}`);
  fields.require(format === 0, `photo format ${format} is unknown`);
  fields.require(qp <= MAX_QP, `QP ${qp}, accepted are 0 to ${MAX_QP}`);
  return { height, width, qp, set, streams: readStreams(fields, views, data), data };
}

/** @param {number} side */
function isSide(side) {
  return side >= 1 && side <= MAX_SIDE;
}

/**
 * @param {Section[]} sections
 * @param {number} count
 * @param {Camera[]} poses
 * @param {Limits} limits
 */
function readExactLayers(sections, count, poses, limits) {
  let [pixels, memory] = [0, 0];
  const layers = [];
  for (let index = 0; index < count; index++) {
    const { data } = only(sections, "EXAP", index);
    const layer = readExact(cursor(only(sections, "EXAC", index)), poses, data);
    const gaussians = poses.length * layer.height * layer.width;
    pixels += gaussians;
    memory += 12 * gaussians * exactPlanes(layer.degree);
    requireLimits(pixels, memory, limits, `EXAC[${index}]`);
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
  return { height, width, degree, zMin, zMax, sha256, cameras, streams, data };
}

/**
 * A picture's bytes; undefined where a prefix does not hold them to their end.
 *
 * @param {Uint8Array} data
 * @param {Stream} stream
 */
export function held(data, stream) {
  const end = stream.offset + stream.length;
  return end <= data.length ? data.subarray(stream.offset, end) : undefined;
}

/**
 * The same of a class's pictures.
 *
 * @param {Container} file
 * @param {number} layer
 * @param {Channel} channel
 * @param {number} view
 */
export function picture(file, layer, channel, view) {
  const data = file.streams.get(`${channel.planeClass}.${layer}`);
  return data && held(data, channel.streams[view]);
}

/**
 * @param {Uint8Array} data
 * @param {Stream} stream
 * @param {string} what
 */
export function checkCrc(data, stream, what) {
  if (crc32(data) !== stream.crc) throw new TsplatError("CRC differs: the bytes were altered", what, stream.offset);
}
