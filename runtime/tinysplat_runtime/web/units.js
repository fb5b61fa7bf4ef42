/** Files whose views are units: docs/FORMAT.md, UNIT and VIEW. */
import { readIntrinsics } from "./cameras.js";
import { Cursor, crc32 } from "./cursor.js";
import { require } from "./errors.js";
import { readReference, readStream } from "./layers.js";
import { cursor, label, only } from "./sections.js";

/** @typedef {import("./cameras.js").Camera} Camera */
/** @typedef {import("./container.js").Container} Container */
/** @typedef {import("./sections.js").Section} Section */

/**
 * Fill the layers with the views that are wanted and at hand, and leave the others out.
 *
 * @param {Container} file whose layers have no views yet
 * @param {Camera[]} poses of all views
 * @param {import("./container.js").Reading} reading
 */
export function readUnits(file, poses, reading) {
  const { sections, layers } = file;
  const order = readOrder(file);
  const first = sections.findIndex((section) => section.type === "VIEW");
  const units = first < 0 ? [] : sections.slice(first);
  const isOrdered = units.every((section, view) => section.type === "VIEW" && section.index === view);
  require(isOrdered && units.length === file.viewCount, "its sections VIEW are not each there once and last", "UNIT[0]");
  const sizes = layers.map((layer) => (layer.isOwn ? 40 : 0) + (layer.isRelative ? 16 : 0));
  const headBytes = 4 + sizes.reduce((sum, size) => sum + size, 0) + 8 * order.length;
  const atHand = [];
  for (const view of file.views) {
    const section = units[view];
    const data = reading.fetched?.get(view) ?? section.data;
    require(section.length >= headBytes, `${section.length} bytes, its head has ${headBytes}`, label(section));
    if (data.length < headBytes) continue;
    const head = new Cursor(data.subarray(0, headBytes), label(section));
    const isIntact = head.u32() === crc32(head.bytes.subarray(4));
    require(isIntact || reading.recovers, "CRC of its head differs: the bytes were altered", label(section));
    if (!isIntact) {
      file.lost.push(`view ${view}`);
      continue;
    }
    for (const layer of layers) {
      const { height, width } = layer;
      layer.cameras.push({ ...poses[view], ...(layer.isOwn ? readIntrinsics(head) : {}), width, height });
      if (layer.isRelative) layer.references?.push(readReference(head));
    }
    let end = headBytes;
    for (const channel of order) {
      const stream = readStream(head, end);
      stream.data = data;
      channel.streams.push(stream);
      end = stream.end;
    }
    require(end === section.length, `${section.length} bytes, head and pictures have ${end}`, label(section));
    atHand.push(view);
  }
  file.views = atHand;
}

/** The channels in the order of a view's pictures. @param {Container} file */
function readOrder(file) {
  const fields = cursor(only(file.sections, "UNIT"));
  const count = fields.u16();
  fields.u16();
  const coded = file.layers.flatMap((layer) => layer.channels.filter((channel) => channel.isCoded));
  fields.require(count === coded.length, `${count} pictures of a view, its layers have ${coded.length}`);
  /** @type {Set<import("./layers.js").Channel>} */
  const order = new Set();
  for (let i = 0; i < count; i++) {
    const [layer, record] = [fields.u8(), fields.u8()];
    const channel = file.layers[layer]?.channels[record];
    fields.require(channel?.isCoded === true, `record ${record} of layer ${layer} has no pictures`);
    fields.require(!order.has(channel), `record ${record} of layer ${layer} stands twice`);
    order.add(channel);
  }
  fields.finish();
  return [...order];
}
