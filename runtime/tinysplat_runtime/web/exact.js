/** Mode lossless: docs/FORMAT.md, "Exact planes". */
import { widened } from "./cursor.js";
import { TsplatError, require } from "./errors.js";
import { chunksOf } from "./chunks.js";
import { Synthesis } from "./synthesis.js";
import { intact } from "./table.js";

/** @typedef {import("./extras.js").ExactLayer} ExactLayer */
/** @typedef {import("./layers.js").Layer} Layer */

/** Planes of geometry: −1/z in two parts, then offset, scale, rotation and opacity. */
const GEOMETRY = 12;

/** Numbers of all halves. */
let halves = new Float32Array(0);

/**
 * What a zlib stream comes to, which must be `length` bytes.
 *
 * @param {Uint8Array} bytes
 * @param {number} length
 * @param {string} where
 */
async function inflated(bytes, length, where) {
  const stream = new Blob([/** @type {any} */ (bytes)]).stream().pipeThrough(new DecompressionStream("deflate"));
  const out = new Uint8Array(length);
  let at = 0;
  try {
    for await (const part of chunksOf(stream)) {
      if (at + part.length > length) throw new RangeError(`more than ${length} bytes`);
      out.set(part, at);
      at += part.length;
    }
  } catch (error) {
    throw new TsplatError(`zlib: ${/** @type {Error} */ (error).message || "the stream is damaged"}`, where);
  }
  require(at === length, `zlib: ${at} bytes, expected ${length}`, where);
  return out;
}

/**
 * The samples of one plane, as bits of halves.
 *
 * @param {Uint8Array} bytes its zlib stream
 * @param {number} height
 * @param {number} width
 * @param {string} where
 */
async function unpackPlane(bytes, height, width, where) {
  const count = height * width;
  const raw = await inflated(bytes, 2 * count, where);
  const samples = new Uint16Array(count);
  for (let y = 0, at = 0; y < height; y++) {
    for (let x = 0; x < width; x++, at++) {
      const folded = raw[at] | (raw[count + at] << 8);
      const rest = (folded >> 1) ^ -(folded & 1);
      samples[at] = neighbourhood(samples, at, x, y, width) + rest;
    }
  }
  for (let i = 0; i < count; i++) samples[i] = samples[i] >= 0x8000 ? samples[i] - 0x8000 : ~samples[i];
  return samples;
}

/**
 * The middle one of left, above and left + above − corner (ITU-T T.87, A.4.1).
 *
 * @param {Uint16Array} samples
 * @param {number} at
 * @param {number} x
 * @param {number} y
 * @param {number} width
 */
function neighbourhood(samples, at, x, y, width) {
  if (x === 0 && y === 0) return 0;
  if (y === 0) return samples[at - 1];
  if (x === 0) return samples[at - width];
  const [left, above] = [samples[at - 1], samples[at - width]];
  const [low, high] = left < above ? [left, above] : [above, left];
  const sum = left + above - samples[at - width - 1];
  return sum < low ? low : sum > high ? high : sum;
}

/**
 * A layer's Gaussians.
 *
 * @param {ExactLayer} exact
 * @param {number} index of the layer
 * @param {Float64Array} origin
 * @param {import("./synthesis.js").Arrays} out
 * @param {number} first Gaussian of the layer
 * @param {() => Promise<void>} breathe between planes
 */
export async function decodeExact(exact, index, origin, out, first, breathe) {
  const { height, width, cameras, views, planes } = exact;
  const pixels = height * width;
  const all = new Uint16Array(planes.length * planes[0].length * pixels);
  for (let view = 0, at = 0; view < planes[0].length; view++) {
    for (let plane = 0; plane < planes.length; plane++, at += pixels) {
      const [stream, where] = [planes[plane][view], `exact plane ${plane}, view ${view}`];
      all.set(await unpackPlane(intact(stream, where), height, width, where), at);
      await breathe();
    }
  }
  if (globalThis.crypto?.subtle) {
    // pages that came by plain HTTP have none: CRCs of all planes are right
    const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", littleEndian(all)));
    require(digest.every((byte, i) => byte === exact.sha256[i]), "SHA-256 of the planes differs", `EXAC[${index}]`);
  }
  require(all.every((bits) => (bits & 0x7c00) !== 0x7c00), "holds NaN or infinity", `EXAC[${index}]`);
  if (!halves.length) halves = Float32Array.from({ length: 65536 }, (_, bits) => widened(bits));
  /** @type {Layer} */
  const layer = {
    height,
    width,
    degree: 0,
    isInverse: true,
    set: 0,
    k: 0,
    zMin: exact.zMin,
    zMax: exact.zMax,
    cameras,
    references: undefined,
    mix: undefined,
    basis: undefined,
    channels: [],
  };
  const synthesis = new Synthesis(layer, origin, out, first);
  const coefficients = planes.length - GEOMETRY;
  const stride = 3 * (out.degree + 1) ** 2;
  for (let view = 0; view < cameras.length; view++) {
    /** @param {number} plane */
    const numbers = (plane) => {
      const start = (views[view] * planes.length + plane) * pixels;
      return Float64Array.from(all.subarray(start, start + pixels), (bits) => halves[bits]);
    };
    const [coarse, fine] = [numbers(0), numbers(1)];
    const rest = Array.from({ length: GEOMETRY - 2 }, (_, i) => numbers(i + 2));
    synthesis.run(view, [], [coarse.map((value, i) => value + fine[i]), ...rest]);
    for (let i = 0; i < coefficients; i++) {
      const plane = numbers(GEOMETRY + i);
      const to = (first + view * pixels) * stride + i;
      for (let pixel = 0; pixel < pixels; pixel++) out.sh[to + pixel * stride] = plane[pixel];
    }
    await breathe();
  }
  const end = first + cameras.length * pixels;
  const isFinite = [out.means.subarray(3 * first, 3 * end), out.scales.subarray(3 * first, 3 * end)];
  require(isFinite.every((array) =>
    array.every(Number.isFinite),
  ), "decodes to numbers beyond float32", `EXAC[${index}]`);
}

/** @param {Uint16Array<ArrayBuffer>} numbers */
function littleEndian(numbers) {
  const bytes = new Uint8Array(numbers.buffer);
  if (new Uint8Array(Uint16Array.of(1).buffer)[0] === 1) return bytes;
  return bytes.map((_, i) => bytes[i ^ 1]);
}
