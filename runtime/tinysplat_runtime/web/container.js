/** A file's metadata, checked: docs/FORMAT.md, section 2. What passes here may be indexed freely. */
import { checkRanges, decodingBytes } from "./bounds.js";
import { readCameras, requirePosition } from "./cameras.js";
import { require } from "./errors.js";
import { readExact, readPhotos } from "./extras.js";
import { readLayer } from "./layers.js";
import { readList } from "./list.js";
import { readNotes } from "./notes.js";
import { cursor, label, only, readTable } from "./sections.js";
import {
  COLOR,
  DEPTH,
  EXACT,
  MAX_VIEWS,
  OFFSET,
  OPACITY,
  PHOTO,
  POSITION,
  ROTATION,
  SCALE,
  channelName,
  readPictures,
  requireSet,
} from "./table.js";

/** @typedef {import("./cameras.js").Camera} Camera */
/** @typedef {import("./layers.js").Layer} Layer */
/** @typedef {import("./sections.js").Section} Section */

const MAX_SETS = 256;
const FEW_GAUSSIANS = 1 << 20;
/** Of a picture's size and how it is coded: some 80 bytes say it. */
const MAX_SET_BYTES = 1024;

/** @typedef {import("./tsplat.js").Limits} Limits */
/** @typedef {import("./tsplat.js").Scene["mode"]} Mode */

/** @type {Limits} */
export const LIMITS = {
  maxPixels: 2 ** 26,
  maxMemory: 2 ** 32,
  maxViews: MAX_VIEWS,
  maxLayers: 16,
  maxPerByte: Infinity,
};

/** Sections that a file of any mode may have. */
const SHARED = ["SCEN", "NOTE", "PICT", "DATA", "CAMS"];
/** Sections whose index is that of a layer or a tier. */
const BY_LAYER = ["LAYR", "EXAC", "TIER"];

/**
 * By mode, the section that tells it and others that it may have, and the classes of its pictures.
 *
 * @type {Record<Mode, { sections: string[], classes: number[] }>}
 */
const MODES = {
  gaussians: { sections: ["LAYR", "HEVC"], classes: [DEPTH, COLOR, OPACITY, SCALE, ROTATION, OFFSET] },
  photos: { sections: ["PHOT", "HEVC"], classes: [PHOTO] },
  lossless: { sections: ["EXAC"], classes: [EXACT] },
  list: { sections: ["LIST", "TIER", "HEVC"], classes: [COLOR, OPACITY, SCALE, ROTATION, POSITION] },
};

/**
 * @typedef {object} Container
 * @property {number[]} version
 * @property {number} total bytes of the whole file
 * @property {string} profile
 * @property {number} qp Q_g
 * @property {Float64Array} origin
 * @property {Mode} mode
 * @property {number} viewCount of the whole file; of a list, cameras of the photos that it was made from
 * @property {import("./table.js").Table} table pictures
 * @property {number[]} views numbers of those that are wanted
 * @property {Camera[]} cameras of these views
 * @property {Camera[]} places cameras of all views; of a list, of its photos
 * @property {Layer[]} layers of these views
 * @property {import("./extras.js").ExactLayer[]} exact
 * @property {import("./list.js").List | undefined} list
 * @property {import("./extras.js").Photos | undefined} photos
 * @property {Map<number, Uint8Array>} sets parameter sets by index
 * @property {Record<string, string>} notes
 * @property {Section[]} sections
 */

/**
 * How a file is to be read.
 *
 * @typedef {object} Reading
 * @property {Limits} limits
 * @property {boolean} isPrefix whether it may end early
 * @property {number[]} [views] that are wanted; all if none are given
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
  const isList = mode === "list";
  for (const section of sections) {
    const { type, index } = section;
    const belongs = SHARED.includes(type) || MODES[mode].sections.includes(type);
    require(belongs, `does not belong in a file of mode ${mode}`, label(section));
    const most = BY_LAYER.includes(type) ? count : type === "HEVC" ? MAX_SETS : 1;
    require(index < most, `index ${index}, accepted are ${most} from 0`, label(section));
    require(type !== "HEVC" ||
      section.length <= MAX_SET_BYTES, `${section.length} bytes, accepted are at most ${MAX_SET_BYTES}`, label(
      section,
    ));
  }
  const [fewest, most] = mode === "photos" ? [0, 0] : [1, limits.maxLayers];
  scene.require(count >= fewest && count <= most, `${count} layers, accepted are ${fewest} to ${most}`);
  scene.require(
    viewCount >= (isList ? 0 : 1) && viewCount <= MAX_VIEWS,
    `${viewCount} views, accepted are 1 to ${MAX_VIEWS}`,
  );
  const places = viewCount ? readCameras(cursor(only(sections, "CAMS")), viewCount) : [];
  const wanted = chosenViews(mode, viewCount, reading.views);
  const table = readPictures(sections, mode === "gaussians" ? wanted : undefined);
  scene.require(table.count === (isList ? 1 : viewCount), `pictures of ${table.count} views of ${viewCount}`);
  for (const channel of table.rows) {
    const belongs = MODES[mode].classes.includes(channel.planeClass) && channel.layer < Math.max(count, 1);
    require(belongs, `a row ${channelName(channel)} of layer ${channel.layer} in a file of mode ${mode}`, "PICT[0]");
  }
  const sets = new Map(sections.filter(({ type }) => type === "HEVC").map(({ index, data }) => [index, data]));
  const views = isList ? [] : mode === "gaussians" ? table.views : (wanted ?? table.views);
  require(views.length <= limits.maxViews, `${views.length} views, the limit is ${limits.maxViews}`, "SCEN[0]");
  /** @type {Container} */
  const file = {
    version,
    total,
    profile,
    qp,
    origin,
    mode,
    viewCount,
    table,
    views,
    cameras: views.map((view) => places[view]),
    places,
    layers: [],
    exact: [],
    list: undefined,
    photos: undefined,
    sets,
    notes: readNotes(sections),
    sections,
  };
  if (isList) file.list = readList(file, count, limits);
  else readViews(file, count, limits);
  require(isWorth(
    file,
    bytes.length,
    limits,
  ), `more than ${limits.maxPerByte} Gaussians for each of its ${bytes.length} bytes`, "file");
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
  const modes = /** @type {Mode[]} */ (Object.keys(MODES));
  const found = modes.filter((mode) => sections.some(({ type }) => type === MODES[mode].sections[0]));
  require(found.length === 1, `has sections of ${found.length} modes, expected one`, "file");
  return found[0];
}

/**
 * @param {Mode} mode
 * @param {number} count
 * @param {number[] | undefined} wanted
 */
function chosenViews(mode, count, wanted) {
  if (!wanted) return undefined;
  require(mode === "gaussians" || mode === "lossless", `views of a file of mode ${mode}`, "views");
  const isFine = wanted.every(
    (view, i) => Number.isInteger(view) && view >= 0 && view < count && wanted.indexOf(view) === i,
  );
  require(isFine, `${wanted}, expected different numbers below ${count}`, "views");
  return wanted;
}

/**
 * All that has views: layers, exact layers or photos, and the limits and bounds that they are held to.
 *
 * @param {Container} file
 * @param {number} count of layers
 * @param {Limits} limits
 */
function readViews(file, count, limits) {
  /** @param {number} pixels @param {number} memory @param {string} where */
  const requireLimits = (pixels, memory, where) => {
    require(pixels <= limits.maxPixels, `${pixels} Gaussians, the limit is ${limits.maxPixels}`, where);
    require(memory <= limits.maxMemory, `${memory} bytes to decode, the limit is ${limits.maxMemory}`, where);
  };
  if (file.mode === "photos") {
    const photos = (file.photos = readPhotos(file));
    requireLimits(file.viewCount * photos.height * photos.width, 0, "PHOT[0]");
    requireSet(file.sets, photos.set, file.table.rows, "PHOT[0]");
    requireSizes(file, photos, "PHOT[0]");
    return;
  }
  let [pixels, memory] = [0, 0];
  for (let index = 0; index < count; index++) {
    const isExact = file.mode === "lossless";
    const where = `${isExact ? "EXAC" : "LAYR"}[${index}]`;
    const layer = isExact ? readExact(file, index) : readLayer(file, index);
    if (!index) requireSizes(file, layer, where);
    pixels += file.views.length * layer.height * layer.width;
    if ("planes" in layer) {
      memory += 12 * file.views.length * layer.height * layer.width * layer.planes.length;
      file.exact.push(layer);
    } else {
      memory += decodingBytes(layer);
      file.layers.push(layer);
    }
    requireLimits(pixels, memory, where);
    if ("planes" in layer) continue;
    checkRanges(layer, file.origin, where);
    requireSet(file.sets, layer.set, layer.channels, where);
  }
}

/** @param {Container} file @param {{ height: number, width: number }} grid @param {string} where */
function requireSizes({ cameras }, { height, width }, where) {
  const fits = cameras.every((camera) => camera.height === height && camera.width === width);
  require(fits, `${width}x${height}, its cameras have other sizes`, where);
}
