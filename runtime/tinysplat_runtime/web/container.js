/** A file's metadata, checked: docs/FORMAT.md, section 2. What passes here may be indexed freely. */
import { checkRanges, decodingBytes } from "./bounds.js";
import { readIntrinsics, readPose, requirePosition } from "./cameras.js";
import { crc32 } from "./cursor.js";
import { TsplatError, require } from "./errors.js";
import { readExactLayers, readGroups, readNetwork, readPhotos } from "./extras.js";
import { readLayer } from "./layers.js";
import { readNotes } from "./notes.js";
import { readFree, readViewpoints } from "./points.js";
import { PLANES, cursor, label, only, readTable } from "./sections.js";
import { readUnits } from "./units.js";

/** @typedef {import("./cameras.js").Camera} Camera */
/** @typedef {import("./layers.js").Channel} Channel */
/** @typedef {import("./layers.js").Layer} Layer */
/** @typedef {import("./layers.js").Stream} Stream */
/** @typedef {import("./sections.js").Section} Section */

const PART = 256;
const MAX_VIEWS = 4096;
const FEW_GAUSSIANS = 1 << 20;
/** Of a picture's size and how it is coded: some 80 bytes say it. */
const MAX_SET_BYTES = 1024;

/**
 * What a reader accepts before it takes memory.
 *
 * @typedef {object} Limits
 * @property {number} maxPixels Gaussians over all views and layers that are decoded
 * @property {number} maxMemory bytes that decoding takes
 * @property {number} maxViews that are decoded
 * @property {number} maxLayers
 * @property {number} maxPerByte Gaussians that are decoded for each byte at hand, beyond the first million
 */

/** @type {Limits} */
export const LIMITS = { maxPixels: 2 ** 26, maxMemory: 2 ** 32, maxViews: MAX_VIEWS, maxLayers: 16, maxPerByte: Infinity };

/** Sections that a file of a mode may have beside those of all. */
const SHARED = ["SCEN", "NOTE", "REFI", "ANTI", "THIN"];
const OF_PLANES = ["CAMS", "LAYR", "HEVC", "UNIT", "VIEW", ...PLANES];
const OF_PHOTOS = ["CAMS", "HEVC", "NETW", "GRPS", "PHOT", "PICS"];

/** @typedef {"gaussians" | "photos" | "lossless" | "free"} Mode */

/** @type {Record<Mode, string[]>} */
const SECTIONS = {
  gaussians: OF_PLANES,
  photos: OF_PHOTOS,
  lossless: ["CAMS", "EXAC", "EXAP"],
  free: ["FREE", "TIER", "FREP", "SEEN", "HEVC", ...PLANES],
};

/**
 * @typedef {object} Container
 * @property {number[]} version
 * @property {number} total bytes of the whole file
 * @property {string} profile
 * @property {number} qp Q_g
 * @property {Float64Array} origin
 * @property {Mode} mode
 * @property {number} viewCount of the whole file
 * @property {number[]} views numbers of those that are wanted and at hand
 * @property {Camera[]} cameras of these views
 * @property {Camera[]} places cameras of all views
 * @property {Layer[]} layers of these views
 * @property {import("./extras.js").ExactLayer[]} exact
 * @property {import("./points.js").FreeScene | undefined} free
 * @property {Camera[]} viewpoints cameras of the photos that a list was made from
 * @property {import("./extras.js").Network | undefined} network
 * @property {import("./extras.js").Group[]} groups in which the network is given the photos
 * @property {import("./extras.js").Photos | undefined} photos
 * @property {Map<number, Uint8Array>} sets parameter sets by index
 * @property {Record<string, string>} notes
 * @property {Section[]} sections
 * @property {string[]} lost names of views that are left out as their heads are damaged
 */

/**
 * How a file is to be read.
 *
 * @typedef {object} Reading
 * @property {Limits} limits
 * @property {boolean} isPrefix whether it may end early
 * @property {boolean} recovers whether views with a damaged head are left out
 * @property {number[]} [views] that are wanted; all if none are given
 * @property {Map<number, Uint8Array>} [fetched] sections `VIEW`, where `bytes` end before them
 */

/**
 * Parse and check a file.
 *
 * @param {Uint8Array} bytes
 * @param {Reading} reading
 * @returns {Container}
 */
export function readContainer(bytes, reading) {
  const { limits } = reading;
  const { version, total, sections } = readTable(bytes, reading.isPrefix);
  const scene = cursor(only(sections, "SCEN"));
  const [viewCount, count, qp] = [scene.u16(), scene.u16(), scene.f32()];
  const origin = scene.numbers("f64", 3);
  const profile = scene.ascii(16);
  scene.finish();
  scene.require(Number.isFinite(qp), "Q_g is not finite");
  requirePosition(scene, origin);
  const mode = modeOf(sections);
  for (const section of sections) {
    const belongs = SHARED.includes(section.type) || SECTIONS[mode].includes(section.type);
    require(belongs, `does not belong in a file of mode ${mode}`, label(section));
  }
  /** @type {Container} */
  const file = {
    version, total, profile, qp, origin, mode, viewCount, views: [], cameras: [], places: [], layers: [], exact: [],
    free: undefined, viewpoints: [], network: undefined, groups: [], photos: undefined, sets: new Map(), notes: readNotes(sections), sections,
    lost: [],
  };
  for (const section of sections) {
    if (section.type !== "HEVC") continue;
    require(section.length <= MAX_SET_BYTES, `${section.length} bytes, accepted are at most ${MAX_SET_BYTES}`, label(section));
    file.sets.set(section.index, section.data);
  }
  if (mode === "free") {
    scene.require(viewCount === 0 && count === 0, "views or layers of a list");
    file.free = readFree(sections, limits);
    file.viewpoints = readViewpoints(sections, origin);
    joinStreams(file, file.free.tiers.map((tier) => tier.channels));
    file.free.tiers.forEach(({ channels }, number) => {
      if (channels.some((channel) => channel.isCoded)) only(sections, "HEVC", number);
    });
    return file;
  }
  scene.require(viewCount >= 1 && viewCount <= MAX_VIEWS, `${viewCount} views, accepted are 1 to ${MAX_VIEWS}`);
  const [fewest, most] = mode === "photos" ? [0, 0] : [1, limits.maxLayers];
  scene.require(count >= fewest && count <= most, `${count} layers, accepted are ${fewest} to ${most}`);
  readViews(file, count, reading);
  let atHand = bytes.length;
  reading.fetched?.forEach((part) => (atHand += part.length));
  require(isWorth(file, atHand, limits), `more than ${limits.maxPerByte} Gaussians for each of its ${atHand} bytes`, "file");
  return file;
}

/**
 * Whether so many bytes of a file are enough for what it makes of them: a few can announce a grid that fills memory.
 *
 * @param {Container} file
 * @param {number} atHand bytes
 * @param {Limits} limits
 */
export function isWorth({ layers, exact, photos, views }, atHand, limits) {
  const grids = exact.length ? exact : layers.length ? layers : photos ? [photos] : [];
  const count = grids.reduce((sum, { height, width }) => sum + views.length * height * width, 0);
  return count <= FEW_GAUSSIANS || count <= limits.maxPerByte * atHand;
}

/** @param {Section[]} sections @returns {Mode} */
function modeOf(sections) {
  const types = new Set(sections.map((section) => section.type));
  if (types.has("FREE")) return "free";
  if (types.has("EXAC") || types.has("EXAP")) return "lossless";
  if (["NETW", "GRPS", "PHOT", "PICS"].some((type) => types.has(type))) return "photos";
  return "gaussians";
}

/**
 * All that has views.
 *
 * @param {Container} file
 * @param {number} count of layers
 * @param {Reading} reading
 */
function readViews(file, count, reading) {
  const { limits } = reading;
  const { sections, mode } = file;
  const poses = readCameras(only(sections, "CAMS"), file.viewCount);
  const isInParts = sections.some((section) => section.type === "UNIT");
  file.views = chosenViews(file, reading.views);
  if (!isInParts) requireViews(file, limits);
  /** @param {number} pixels @param {number} memory @param {string} where */
  const requireLimits = (pixels, memory, where) => {
    require(pixels <= limits.maxPixels, `${pixels} Gaussians, the limit is ${limits.maxPixels}`, where);
    require(memory <= limits.maxMemory, `${memory} bytes to decode, the limit is ${limits.maxMemory}`, where);
  };
  if (mode === "lossless") {
    file.exact = readExactLayers(sections, count, poses, requireLimits);
  } else if (mode !== "gaussians") {
    file.network = readNetwork(cursor(only(sections, "NETW")));
    const groups = sections.some((section) => section.type === "GRPS") ? cursor(only(sections, "GRPS")) : undefined;
    file.groups = readGroups(groups, file.viewCount);
    file.photos = readPhotos(cursor(only(sections, "PHOT")), file.viewCount, only(sections, "PICS").data);
    const { height, width, set } = file.photos;
    requireLimits(file.viewCount * height * width, 0, "PHOT[0]");
    require(file.sets.has(set), "its parameter set is missing", "PHOT[0]");
  }
  if (mode === "gaussians") {
    for (let i = 0; i < count; i++) file.layers.push(readLayer(only(sections, "LAYR", i), poses, isInParts));
    if (isInParts) readUnits(file, poses, reading);
    else requireNone(sections, "VIEW");
    joinStreams(file, isInParts ? [] : file.layers.map((layer) => layer.channels));
  }
  requireViews(file, limits);
  const { height, width } = gridOf(file);
  file.places = poses.map((pose) => ({ ...pose, width, height }));
  file.cameras = file.views.map((view) => file.places[view]);
  for (const layer of file.exact) [layer.views, layer.cameras] = [file.views, file.views.map((view) => layer.cameras[view])];
  if (!isInParts) file.layers.forEach((layer) => keepViews(layer, file.views));
  checkLayers(file, requireLimits);
}

/** @param {Section[]} sections @param {string} type */
function requireNone(sections, type) {
  const found = sections.find((section) => section.type === type);
  require(!found, "stands in a file without UNIT", found && label(found));
}

/** @param {Container} file @param {Limits} limits */
function requireViews(file, limits) {
  require(file.views.length <= limits.maxViews, `${file.views.length} views, the limit is ${limits.maxViews}`, "SCEN[0]");
}

/** @param {Container} file @param {number[] | undefined} wanted */
function chosenViews(file, wanted) {
  const all = Array.from({ length: file.viewCount }, (_, view) => view);
  if (!wanted) return all;
  require(file.mode === "gaussians" || file.mode === "lossless", `views of a file of mode ${file.mode}`, "views");
  const isFine = wanted.every((view, i) => all.includes(view) && wanted.indexOf(view) === i);
  require(isFine, `${wanted}, expected different numbers below ${file.viewCount}`, "views");
  return wanted;
}

/** @param {Layer} layer @param {number[]} views */
function keepViews(layer, views) {
  layer.cameras = views.map((view) => layer.cameras[view]);
  const { references } = layer;
  if (references) layer.references = views.map((view) => references[view]);
  for (const channel of layer.channels) {
    if (channel.isCoded) channel.streams = views.map((view) => channel.streams[view]);
  }
}

/**
 * Totals, bounds and parameter sets of layers.
 *
 * @param {Container} file
 * @param {(pixels: number, memory: number, where: string) => void} requireLimits
 */
function checkLayers(file, requireLimits) {
  let [pixels, memory] = [0, 0];
  file.layers.forEach((layer, index) => {
    const where = `LAYR[${index}]`;
    pixels += layer.cameras.length * layer.height * layer.width;
    memory += decodingBytes(layer);
    requireLimits(pixels, memory, where);
    checkRanges(layer, file.origin, where);
    const isThere = !layer.channels.some((channel) => channel.isCoded) || file.sets.has(layer.set);
    require(isThere, `parameter set ${layer.set} is missing`, where);
  });
}

/** @param {Section} section @param {number} views */
function readCameras(section, views) {
  const fields = cursor(section);
  fields.require(fields.bytes.length === 136 * views, `${fields.bytes.length} bytes of ${views} cameras`);
  const poses = [];
  for (let view = 0; view < views; view++) {
    poses.push({ ...readIntrinsics(fields), c2w: readPose(fields), width: 1, height: 1 });
  }
  return poses;
}

/** Height and width of layer 0, which the photos share where there are any. @param {Container} file */
function gridOf({ exact, layers, photos }) {
  const first = exact[0] ?? layers[0];
  const fits = !photos || !first || (first.height === photos.height && first.width === photos.width);
  require(fits, "photos of another size than layer 0", "PHOT[0]");
  return photos ?? first;
}

/**
 * Give the streams of channels their bytes: those of a class's sections, parts 0, 1, 2 … in this order, joined.
 *
 * @param {Container} file
 * @param {Channel[][]} channels by layer
 */
function joinStreams(file, channels) {
  let used = 0;
  channels.forEach((records, index) => {
    PLANES.forEach((type, number) => {
      const coded = records.filter((channel) => channel.planeClass === number && channel.isCoded);
      if (!coded.length) return;
      const parts = file.sections.filter((section) => section.type === type && section.index % PART === index);
      const where = `${type}[${index}]`;
      require(parts.length > 0, "missing", where);
      const isOrdered = parts.every((part, i) => (part.index - index) / PART === i);
      require(isOrdered, "its parts are not each there once and in order", where);
      used += parts.length;
      const stated = parts.reduce((sum, part) => sum + part.length, 0);
      const last = coded[coded.length - 1].streams.at(-1);
      require(last?.end === stated, `${stated} bytes, its pictures need ${last?.end}`, where);
      const data = parts.length === 1 ? parts[0].data : joined(parts.map((part) => part.data));
      for (const channel of coded) for (const stream of channel.streams) stream.data = data;
    });
  });
  const found = file.sections.filter((section) => PLANES.includes(section.type)).length;
  require(found === used, `${found - used} sections hold pictures of no channel`, "table");
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
 * A picture's bytes; undefined where a prefix does not hold them to their end.
 *
 * @param {Stream} stream
 */
export function held(stream) {
  return stream.end <= stream.data.length ? stream.data.subarray(stream.end - stream.length, stream.end) : undefined;
}

/** @param {Uint8Array} data @param {Stream} stream @param {string} what */
export function checkCrc(data, stream, what) {
  if (crc32(data) !== stream.crc) throw new TsplatError("CRC differs: the bytes were altered", what, stream.end);
}
