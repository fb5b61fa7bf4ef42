/** Files to Gaussians: which pictures are at hand, and what each mode does with them. */
import { breathe, crew } from "./crew.js";
import { crc32 } from "./cursor.js";
import { TsplatError, require } from "./errors.js";
import { decodeExact } from "./exact.js";
import { checkPrediction, codedSide, joinGroups, photoPixels } from "./photos.js";
import { Synthesis, hidingRecord, newArrays, standInCode } from "./synthesis.js";
import { channelName, held, intact } from "./table.js";
import { decodeTier, listShape, tiersShown } from "./tiers.js";

/** @typedef {import("./cameras.js").Camera} Camera */
/** @typedef {import("./container.js").Container} Container */
/** @typedef {import("./table.js").Channel} Channel */
/** @typedef {import("./tsplat.js").Prediction} Prediction */
/** @typedef {import("./synthesis.js").Arrays} Arrays */

const PLANE_BITS = 12;
const PHOTO_BITS = 10;

/** @typedef {import("./tsplat.js").NetworkRequest} NetworkRequest */
/** @typedef {import("./tsplat.js").LayerShape} LayerShape */
/** @typedef {Arrays & { origin: ArrayLike<number>, cameras: Camera[], viewpoints?: Camera[], layers: LayerShape[], missing: string[] }} Decoded */

/** Decodes a container's pictures, each once. */
export class Pictures {
  /**
   * @param {Container} file
   * @param {AbortSignal} signal
   * @param {boolean} recovers whether a picture whose CRC differs counts as absent
   * @param {Map<string, Uint16Array>} [known] pictures that were decoded before, and take what is decoded
   */
  constructor(file, signal, recovers, known) {
    this.file = file;
    this.signal = signal;
    this.recovers = recovers;
    this.known = known;
    /** Names of the pictures that are not at hand. @type {string[]} */
    this.missing = [];
    /** Called with every picture that is decoded. @type {((name: string) => void) | undefined} */
    this.tell = undefined;
  }

  /**
   * Whether a picture is at hand, and intact where what is damaged counts as absent.
   *
   * @param {import("./table.js").Stream} stream
   */
  has(stream) {
    const data = held(stream);
    return data !== undefined && !(this.recovers && crc32(data) !== stream.crc);
  }

  /**
   * A picture's bytes, their CRC checked; undefined where they are not at hand.
   *
   * @param {import("./table.js").Stream} stream
   * @param {string} name
   */
  checked(stream, name) {
    if (this.has(stream)) return intact(stream, name);
    this.missing.push(name);
    return undefined;
  }

  /**
   * Codes of a picture of a plane; undefined where it is absent.
   *
   * @param {string} name
   * @param {import("./table.js").Stream} stream
   * @param {{ height: number, width: number }} size
   * @param {number} set
   * @returns {Promise<Uint16Array | undefined>}
   */
  async plane(name, stream, { height, width }, set) {
    const before = this.known?.get(name);
    if (before) return before;
    const data = this.checked(stream, name);
    if (!data) return undefined;
    const { file } = this;
    const [planes] = await crew.run(
      {
        sets: /** @type {Uint8Array} */ (file.sets.get(set)),
        data,
        width,
        height,
        codedWidth: Math.max(16, 8 * Math.ceil(width / 8)),
        codedHeight: Math.max(16, 8 * Math.ceil(height / 8)),
        chroma: 0,
        bits: PLANE_BITS,
        where: name,
      },
      this.signal,
    );
    this.known?.set(name, planes);
    this.tell?.(name);
    return planes;
  }

  /**
   * A photo's pixels.
   *
   * @param {number} view
   */
  async photo(view) {
    const { sets, photos } = this.file;
    if (!photos) throw new TsplatError("no photos", "file");
    const { height, width, streams, set } = photos;
    const where = `photo ${view}`;
    const planes = await crew.run(
      {
        sets: /** @type {Uint8Array} */ (sets.get(set)),
        data: intact(streams[view], where),
        width,
        height,
        codedWidth: codedSide(width),
        codedHeight: codedSide(height),
        chroma: 1,
        bits: PHOTO_BITS,
        where,
      },
      this.signal,
    );
    return photoPixels(planes, height, width);
  }
}

/**
 * Decode a file.
 *
 * @param {Pictures} pictures
 * @param {((request: NetworkRequest) => Promise<Prediction>) | undefined} network
 * @param {() => Promise<void>} pause between pieces of work
 * @returns {Promise<Decoded>}
 */
export async function decodeFile(pictures, network, pause) {
  const { file } = pictures;
  if (file.mode === "list") return decodeTiers(pictures);
  if (file.mode === "lossless") return decodeLossless(file, pause);
  if (file.mode === "gaussians") {
    requireDepth(pictures);
    return decodeLayers(pictures);
  }
  return joinedPrediction(file, await predicted(pictures, network));
}

/** @param {number} tier @param {Channel} channel */
function tierName(tier, channel) {
  return `${tier ? `tier ${tier} ` : ""}${channelName(channel)}`;
}

/** @param {Pictures} pictures @returns {Promise<Decoded>} */
async function decodeTiers(pictures) {
  const { list, origin, places, table } = pictures.file;
  if (!list) throw new TsplatError("no list", "file");
  const { degree } = list;
  const { count, shown, growth } = tiersShown(list, (stream) => pictures.has(stream));
  for (const channel of table.rows) {
    if (channel.layer >= shown.length && channel.isCoded)
      pictures.checked(channel.streams[0], tierName(channel.layer, channel));
  }
  const out = newArrays(count, degree);
  let first = 0;
  for (const [number, tier] of shown.entries()) {
    const shape = listShape(tier.count);
    await decodeTier(
      list,
      tier,
      growth,
      (channel) => pictures.plane(tierName(number, channel), channel.streams[0], shape, tier.set),
      out,
      first,
    );
    first += tier.count;
  }
  const layer = { views: 0, height: 0, width: 0, count, offset: 0, degree, cameras: [] };
  return { ...out, origin, cameras: [], viewpoints: places, layers: [layer], missing: pictures.missing };
}

/**
 * Shapes of layers, one behind the other, and arrays for all of them.
 *
 * @param {{ height: number, width: number, degree: number, cameras: Camera[] }[]} layers
 */
function shapesOf(layers) {
  /** @type {LayerShape[]} */
  const shapes = [];
  let offset = 0;
  for (const { height, width, degree, cameras } of layers) {
    const count = cameras.length * height * width;
    shapes.push({ views: cameras.length, height, width, count, offset, degree, cameras });
    offset += count;
  }
  return { shapes, out: newArrays(offset, Math.max(...layers.map((layer) => layer.degree))) };
}

/** @param {Container} file @param {() => Promise<void>} pause @returns {Promise<Decoded>} */
async function decodeLossless(file, pause) {
  const { shapes, out } = shapesOf(file.exact);
  for (let i = 0; i < shapes.length; i++)
    await decodeExact(file.exact[i], i, file.origin, out, shapes[i].offset, pause);
  return { ...out, origin: file.origin, cameras: file.cameras, layers: shapes, missing: [] };
}

/** Refuse a file none of whose views of layer 0 has its depth. @param {Pictures} pictures */
function requireDepth(pictures) {
  const {
    layers: [layer],
  } = pictures.file;
  const channel = layer.channels[hidingRecord(layer)];
  const isThere = !channel?.isCoded || channel.streams.some((stream) => pictures.has(stream));
  require(isThere, "holds no intact depth picture", "file");
}

/**
 * Whether Gaussians were made before on this page. Its first ones are few: by then it is clear what is worth compiling,
 * which happens while further pictures are decoded. Until it has, Gaussians take ten times as long and leave garbage.
 */
let isCompiled = false;
const FIRST_ROWS = 24;
const PAUSES = 3;

/** @param {Pictures} pictures @returns {Promise<Decoded>} */
async function decodeLayers(pictures) {
  const { file } = pictures;
  const { shapes, out } = shapesOf(file.layers);
  const views = file.layers.flatMap((layer, index) => {
    const synthesis = new Synthesis(layer, file.origin, out, shapes[index].offset);
    const hiding = hidingRecord(layer);
    return layer.cameras.map(async (_, view) => {
      const codes = await Promise.all(
        layer.channels.map(async (channel, record) => {
          if (!channel.isCoded) return undefined;
          const name = `layer ${index} ${channelName(channel)} view ${file.views[view]}`;
          return (await pictures.plane(name, channel.streams[view], layer, layer.set)) ?? standInCode(layer, record);
        }),
      );
      if (!isCompiled) {
        isCompiled = true;
        synthesis.run(view, codes, undefined, FIRST_ROWS);
        for (let pause = 0; pause < PAUSES; pause++) await breathe();
      }
      synthesis.run(view, codes);
      if (hiding >= 0 && typeof codes[hiding] === "number") synthesis.hide(view);
    });
  });
  await Promise.all(views);
  return { ...out, origin: file.origin, cameras: file.cameras, layers: shapes, missing: pictures.missing };
}

/**
 * What the network makes of a file's photos.
 *
 * @param {Pictures} pictures
 * @param {((request: NetworkRequest) => Promise<Prediction>) | undefined} network
 */
async function predicted(pictures, network) {
  const { file } = pictures;
  if (!file.photos) throw new TsplatError("no photos", "file");
  const { height, width, network: needed, groups } = file.photos;
  if (!network) throw new TsplatError(`needs the network ${needed.name}, and none was given`, "PHOT[0]");
  const found = [];
  for (const { views } of groups) {
    const photos = await Promise.all(views.map((view) => pictures.photo(view)));
    const cameras = views.map((view) => file.cameras[view]);
    const prediction = await network({ photos, width, height, cameras, ...needed });
    pictures.signal.throwIfAborted();
    checkPrediction(prediction, views.length);
    found.push(prediction);
  }
  return joinGroups(found, groups, file.viewCount);
}

/** @param {Container} file @param {Prediction} prediction @returns {Decoded} */
function joinedPrediction(file, prediction) {
  const { shapes, out } = shapesOf(prediction.layers);
  const stride = 3 * (out.degree + 1) ** 2;
  prediction.layers.forEach((layer, i) => {
    const { offset, count } = shapes[i];
    out.means.set(layer.means, 3 * offset);
    out.quats.set(layer.quats, 4 * offset);
    out.scales.set(layer.scales, 3 * offset);
    out.opacities.set(layer.opacities, offset);
    const own = 3 * (layer.degree + 1) ** 2;
    for (let g = 0; g < count; g++) out.sh.set(layer.sh.subarray(g * own, (g + 1) * own), (offset + g) * stride);
  });
  return { ...out, origin: prediction.origin, cameras: file.cameras, layers: shapes, missing: [] };
}
