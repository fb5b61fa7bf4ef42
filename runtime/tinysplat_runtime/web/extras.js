/** Sections of the modes with photos or exact planes, checked: docs/FORMAT.md, PHOT and EXAC. */
import { layerCameras, requireSides } from "./cameras.js";
import { require } from "./errors.js";
import { OWN_INTRINSICS } from "./layers.js";
import { cursor, only } from "./sections.js";
import { channelsOf } from "./table.js";

/** @typedef {import("./cameras.js").Camera} Camera */
/** @typedef {import("./container.js").Container} Container */
/** @typedef {import("./cursor.js").Cursor} Cursor */
/** @typedef {import("./table.js").Stream} Stream */

const MAX_DEPTH = 1e30;
const KEPT = 0x8000;

/** @typedef {{ name: string, sha256: string, near: number, far: number }} Network */
/** Photos that a network is given together, and of which of them its Gaussians are taken. @typedef {{ views: number[], kept: number[] }} Group */
/** @typedef {{ height: number, width: number, set: number, streams: Stream[], network: Network, groups: Group[] }} Photos */

/**
 * @typedef {object} ExactLayer
 * @property {number} height
 * @property {number} width
 * @property {number} degree
 * @property {number} zMin
 * @property {number} zMax
 * @property {Uint8Array} sha256 of the planes of all views
 * @property {Camera[]} cameras
 * @property {number[]} views that are wanted, whose cameras these are
 * @property {Stream[][]} planes of all views
 */

/** @param {Container} file @returns {Photos} */
export function readPhotos({ sections, table, viewCount }) {
  const fields = cursor(only(sections, "PHOT"));
  const sha256 = Array.from(fields.take(32), (byte) => byte.toString(16).padStart(2, "0")).join("");
  const name = fields.ascii(64);
  fields.require(/^[ -~]*$/.test(name), "the network's name is not printable ASCII");
  const [near, far] = fields.numbers("f64", 2);
  const [height, width, format, set, groupCount] = [fields.u32(), fields.u32(), fields.u8(), fields.u8(), fields.u16()];
  fields.require(1 / MAX_DEPTH < near && near < far && far < MAX_DEPTH, `near ${near} and far ${far}`);
  requireSides(fields, height, width);
  fields.require(format === 0, `photo format ${format} is unknown`);
  const groups = readGroups(fields, groupCount, viewCount);
  fields.finish();
  const { rows } = table;
  require(rows.length === 1 && rows[0].isCoded, `${rows.length} rows of photos, expected one with pictures`, "PICT[0]");
  return { height, width, set, streams: rows[0].streams, network: { name, sha256, near, far }, groups };
}

/**
 * In which groups a network is given the photos; all at once where there are none.
 *
 * @param {Cursor} fields
 * @param {number} groupCount
 * @param {number} count of views
 * @returns {Group[]}
 */
function readGroups(fields, groupCount, count) {
  const all = Array.from({ length: count }, (_, view) => view);
  if (!groupCount) return [{ views: all, kept: all }];
  /** @type {Set<number>} */
  const keptOnce = new Set();
  const groups = Array.from({ length: groupCount }, (_, number) => {
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
  fields.require(keptOnce.size === count, `${keptOnce.size} of ${count} views are kept in a group`);
  return groups;
}

/** @param {Container} file @param {number} index of the layer @returns {ExactLayer} */
export function readExact(file, index) {
  const fields = cursor(only(file.sections, "EXAC", index));
  const [height, width, degree, flags] = [fields.u32(), fields.u32(), fields.u8(), fields.u8()];
  fields.take(2);
  const [zMin, zMax] = fields.numbers("f32", 2);
  const sha256 = fields.take(32);
  requireSides(fields, height, width);
  fields.require(degree <= 4, `SH degree ${degree}, accepted are 0 to 4`);
  fields.require(!(flags & ~OWN_INTRINSICS), `unknown flags ${flags}`);
  fields.require(1 / MAX_DEPTH < zMin && zMin <= zMax && zMax < MAX_DEPTH, `depth limits ${zMin} to ${zMax}`);
  const cameras = layerCameras(fields, file, height, width, flags !== 0);
  fields.finish();
  const [channels, count] = [channelsOf(file.table, index), 12 + 3 * (degree + 1) ** 2];
  const isWhole = channels.length === count && channels.every(({ target, isCoded }, i) => target === i && isCoded);
  require(isWhole, `${channels.length} planes of layer ${index}, expected ${count}, each with pictures and in order`, "PICT[0]");
  return {
    height,
    width,
    degree,
    zMin,
    zMax,
    sha256,
    cameras,
    views: file.views,
    planes: channels.map(({ streams }) => streams),
  };
}
