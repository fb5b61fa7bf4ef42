/**
 * Reads `.tsplat` files, as docs/FORMAT.md has them.
 *
 *     const scene = await decode(await (await fetch("scene.tsplat")).arrayBuffer());
 *
 * No dependency, no WebAssembly. Works in pages, workers, node and deno.
 */
import { LIMITS, isWorth, readContainer } from "./container.js";
import { breathe, crew, processors, serve } from "./crew.js";
import { Pictures, decodeFile } from "./decoder.js";
import { TsplatError } from "./errors.js";
import { chunksOf } from "./chunks.js";
import { label, neededBytes } from "./sections.js";
import { COLOR, ROTATION, channelName, channelsOf } from "./table.js";

export { TsplatError };

/** @typedef {import("./container.js").Container} Container */
/** What callers see is declared in tsplat.d.ts. @typedef {import("./tsplat.js").Options} Options */
/** @typedef {import("./tsplat.js").Scene} Scene */

/** @param {ArrayBuffer | ArrayBufferView} bytes */
function bytesOf(bytes) {
  if (ArrayBuffer.isView(bytes)) return new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  return new Uint8Array(bytes);
}

/**
 * Decode a file.
 *
 * @param {ArrayBuffer | ArrayBufferView} bytes the whole file, or with `maxBytes` its first ones
 * @param {Options} [options]
 * @returns {Promise<Scene>}
 */
export async function decode(bytes, options = {}) {
  const { maxBytes, recover } = options;
  const data = bytesOf(bytes).subarray(0, maxBytes);
  const file = readContainer(data, reading(options, maxBytes !== undefined || recover === true));
  return decodeContainer(file, options, undefined);
}

/**
 * @param {Options} options
 * @param {boolean} isPrefix
 * @returns {import("./container.js").Reading}
 */
function reading({ limits, views }, isPrefix) {
  return { limits: { ...LIMITS, ...limits }, isPrefix, views };
}

/**
 * @param {Container} file
 * @param {Options} options
 * @param {Map<string, Uint16Array> | undefined} known
 * @returns {Promise<Scene>}
 */
async function decodeContainer(file, options, known) {
  options.signal?.throwIfAborted();
  const failed = new AbortController();
  const signal = AbortSignal.any([failed.signal, ...(options.signal ? [options.signal] : [])]);
  crew.wanted = options.threads ?? processors();
  const pictures = new Pictures(file, signal, options.recover ?? false, known);
  pictures.tell = options.onPicture;
  const pause = async () => {
    await breathe();
    signal.throwIfAborted();
  };
  try {
    const decoded = await decodeFile(pictures, options.network, pause);
    signal.throwIfAborted();
    return { ...decoded, notes: file.notes, mode: file.mode, bytes: file.total };
  } catch (error) {
    failed.abort(error); // what is still queued is not decoded
    throw error;
  }
}

/** Passes of a class's first rows and of the others, and how many are first: FORMAT.md, section 1. */
const PASSES = [
  [0, 2, 1],
  [0, 3, 3],
  [1, 1, 1],
  [1, 1, 3],
  [2, 2, 4],
  [2, 2, 2],
];

/**
 * Where a file's picture gets better: ends of its passes, in bytes from its beginning.
 *
 * @param {Container} file
 */
function stepsOf({ table, mode, total }) {
  const steps = [];
  /** @type {Map<string, number>} */
  const counts = new Map();
  let [ending, isDyed] = ["", false];
  for (const { layer, planeClass, isCoded, streams } of table.rows) {
    const number = counts.get(`${layer} ${planeClass}`) ?? 0;
    counts.set(`${layer} ${planeClass}`, number + 1);
    if (!isCoded || !streams.length || (mode !== "list" && mode !== "gaussians")) continue;
    const [first, later, base] = PASSES[planeClass] ?? [1, 1, 1];
    const pass =
      mode === "gaussians"
        ? number < base
          ? first
          : later
        : planeClass === ROTATION
          ? 2
          : layer || planeClass !== COLOR
            ? 0
            : 1;
    const end = streams[streams.length - 1].end;
    if (`${layer} ${pass}` === ending) steps.pop();
    if (mode === "gaussians" && planeClass === COLOR && !layer && !isDyed) {
      steps.push(streams[0].end); // the first view is then seen in its own light
      isDyed = true;
    }
    steps.push(end);
    ending = `${layer} ${pass}`;
  }
  return steps.length ? steps : [total];
}

/**
 * Decode a file while it arrives: a scene whenever the picture has got better since the last one was taken, and at last
 * that of the whole file. No picture is decoded twice.
 *
 * @param {AsyncIterable<Uint8Array> | ReadableStream<Uint8Array>} chunks
 * @param {Options} [options]
 * @returns {AsyncGenerator<Scene & { received: number }>}
 */
export async function* decodeStream(chunks, options = {}) {
  const start = reading(options, true);
  const { maxPerByte } = start.limits;
  start.limits.maxPerByte = Infinity; // of what is read before its bytes have come
  const arriving = new Arriving(chunks, start.limits.maxMemory);
  /** @type {Map<string, Uint16Array>} */
  const known = new Map();
  /** @type {number[] | undefined} */
  let steps;
  let shown = 0;
  try {
    for (;;) {
      options.signal?.throwIfAborted();
      const bytes = arriving.bytes();
      if (arriving.isWhole) {
        const file = readContainer(bytes, reading(options, options.recover === true));
        yield { ...(await decodeContainer(file, options, known)), received: bytes.length };
        return;
      }
      if (neededBytes(bytes) <= bytes.length) {
        steps ??= stepsOf(readContainer(bytes, start));
        const reached = steps.filter((step) => step <= bytes.length).at(-1) ?? 0;
        if (reached > shown && reached < steps[steps.length - 1]) {
          shown = reached;
          const held = readContainer(bytes.subarray(0, reached), start);
          const isShown = isWorth(held, reached, { ...start.limits, maxPerByte });
          const scene = isShown ? await prefix(held, options, known) : undefined;
          if (scene) yield { ...scene, received: bytes.length };
          continue;
        }
      }
      await arriving.more(bytes.length);
    }
  } finally {
    arriving.stop();
  }
}

/**
 * A prefix's scene; undefined where it does not hold one yet.
 *
 * @param {Container} file
 * @param {Options} options
 * @param {Map<string, Uint16Array>} known
 */
async function prefix(file, options, known) {
  if (file.mode !== "gaussians" && file.mode !== "list") return undefined;
  try {
    return await decodeContainer(file, options, known);
  } catch (error) {
    if (error instanceof TsplatError && error.section === "file") return undefined; // too short for any picture
    throw error;
  }
}

/** Bytes as they come in, read on as fast as they do. */
class Arriving {
  /**
   * @param {AsyncIterable<Uint8Array> | ReadableStream<Uint8Array>} chunks
   * @param {number} most bytes
   */
  constructor(chunks, most) {
    this.most = most;
    this.held = new Uint8Array(1 << 16);
    this.length = 0;
    this.isWhole = false;
    this.isStopped = false;
    /** @type {unknown} */
    this.failure = undefined;
    /** @type {(() => void) | undefined} */
    this.wake = undefined;
    void this.read("getReader" in chunks ? chunksOf(chunks) : chunks);
  }

  /** @param {AsyncIterable<Uint8Array>} chunks */
  async read(chunks) {
    try {
      for await (const chunk of chunks) {
        if (this.isStopped) return;
        const end = this.length + chunk.length;
        if (end > this.most) throw new TsplatError(`more than ${this.most} bytes`, "file");
        if (end > this.held.length) {
          const grown = new Uint8Array(Math.max(end, 2 * this.held.length));
          grown.set(this.bytes());
          this.held = grown;
        }
        this.held.set(chunk, this.length);
        this.length = end;
        this.wake?.();
      }
      this.isWhole = true;
    } catch (error) {
      this.failure = error ?? new Error("the stream failed");
    }
    this.wake?.();
  }

  bytes() {
    return this.held.subarray(0, this.length);
  }

  /**
   * Wait until there are more bytes than so many, or all.
   *
   * @param {number} length
   */
  async more(length) {
    while (this.length === length && !this.isWhole && !this.failure) {
      await new Promise((resolve) => (this.wake = () => resolve(undefined)));
    }
    if (this.failure) throw this.failure;
  }

  stop() {
    this.isStopped = true;
  }
}

/**
 * What a file holds, from its metadata alone.
 *
 * @param {ArrayBuffer | ArrayBufferView} bytes the file, or its first ones with all metadata
 * @param {Partial<import("./container.js").Limits>} [limits]
 */
export function inspect(bytes, limits = {}) {
  const file = readContainer(bytesOf(bytes), { ...reading({ limits }, true) });
  const { version, mode, profile, qp, total, origin, places, notes, list, table } = file;
  const cameras = list ? [] : places;
  const grids = file.exact.length ? file.exact : file.layers;
  const layers = grids.map(({ height, width, degree }) => ({ views: cameras.length, height, width, degree }));
  const counted = layers.reduce((sum, layer) => sum + layer.views * layer.height * layer.width, 0);
  const channels = Array.from({ length: Math.max(0, ...table.rows.map(({ layer }) => layer + 1)) }, (_, layer) =>
    channelsOf(table, layer).map((channel) => ({
      name: channelName(channel),
      bytes: channel.streams.map(({ length }) => length),
    })),
  );
  return {
    version: version.join("."),
    mode,
    profile,
    qp,
    bytes: total,
    origin,
    cameras,
    notes,
    network: file.photos?.network,
    layers,
    channels,
    count: list ? list.count : grids.length ? counted : undefined,
    degree: list ? list.degree : Math.max(0, ...layers.map((layer) => layer.degree)),
    sections: file.sections.map((section) => ({ name: label(section), offset: section.start, bytes: section.length })),
    steps: stepsOf(file),
  };
}

serve();
