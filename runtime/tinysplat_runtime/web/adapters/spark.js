/** `.tsplat` in Spark 2, as `ExtSplats`: its `PackedSplats` keep positions in float16. */
import { ExtSplats, SplatMesh, utils } from "@sparkjsdev/spark";
import { decode } from "../tsplat.js";

const SH_C0 = 0.28209479177387814;

/**
 * Three numbers in Spark's 32 bits: a byte each and a common exponent. Spark's own `encodeExtRgb` (2.2.0) rounds the
 * exponent down, which cuts the largest of the three to the power of two below.
 *
 * @param {number} r
 * @param {number} g
 * @param {number} b
 */
function encoded(r, g, b) {
  const exponent = Math.ceil(Math.log2(Math.max(Math.abs(r), Math.abs(g), Math.abs(b), 2 ** -15)));
  const base = Math.min(exponent + 15, 31);
  const [x, y, z] = [r, g, b].map((value) => Math.min(Math.round((Math.abs(value) * 255) / 2 ** (base - 15)), 255));
  return (
    (x | (y << 8) | (z << 16) | ((Number(r < 0) | (Number(g < 0) << 1) | (Number(b < 0) << 2) | (base << 3)) << 24)) >>>
    0
  );
}

/**
 * A scene as a mesh of Spark: y is up as in three.js, and the origin is the mesh's place.
 *
 * @param {import("../tsplat.js").Scene} scene as `decode` gives it
 */
export function splatsOf({ count, degree, means, quats, scales, opacities, sh, origin }) {
  const stride = 3 * (degree + 1) ** 2;
  const { maxSplats } = utils.getTextureSize(count);
  /** @type {() => Uint32Array} */
  const words = () => new Uint32Array(4 * maxSplats);
  /** @type {[Uint32Array, Uint32Array]} */
  const extArrays = [words(), words()];
  // Fifteen coefficients: three of degree 1 and one of degree 2, four of it, four of degree 3, three of it.
  const names = ["sh1", "sh2", "sh3a", "sh3b"].slice(0, [0, 1, 2, 4, 4][degree]);
  const extra = Object.fromEntries(names.map((name) => [name, words()]));
  const functions = Math.min((degree + 1) ** 2, 16) - 1;
  for (let i = 0; i < count; i++) {
    const at = i * stride;
    const [r, g, b] = [0, 1, 2].map((c) => 0.5 + SH_C0 * sh[at + c]);
    const [w, x, y, z] = quats.subarray(4 * i, 4 * i + 4);
    const [mean, scale] = [means, scales].map((array) => array.subarray(3 * i, 3 * i + 3));
    utils.encodeExtSplat(
      extArrays,
      i,
      mean[0],
      mean[1],
      mean[2],
      scale[0],
      scale[1],
      scale[2],
      x,
      y,
      z,
      w,
      opacities[i],
      r,
      g,
      b,
    );
    for (let n = 0; n < functions; n++) {
      const from = at + 3 * (n + 1);
      extra[names[n >> 2]][4 * i + (n & 3)] = encoded(sh[from], sh[from + 1], sh[from + 2]);
    }
  }
  const mesh = new SplatMesh({ splats: new ExtSplats({ extArrays, numSplats: count, extra }) });
  mesh.rotation.x = Math.PI;
  mesh.position.set(origin[0], -origin[1], -origin[2]);
  return mesh;
}

/**
 * @param {string} url
 * @param {import("../tsplat.js").Options} [options]
 */
export async function loadTsplat(url, options) {
  const response = await fetch(url, { signal: options?.signal });
  if (!response.ok) throw new Error(`${url} answers ${response.status}`);
  return splatsOf(await decode(await response.arrayBuffer(), options));
}
