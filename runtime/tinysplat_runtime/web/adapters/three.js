/** `.tsplat` in three.js (r187 and later, `WebGPURenderer`, whose fallback is WebGL). */
import { GaussianSplat } from "three/addons/objects/GaussianSplat.js";
import {
  SH_BAND_COMPONENTS,
  createGaussianSplatGeometry,
  createPackedSphericalHarmonicsBand,
  writeColorBytesFromSH0,
  writeCovariance,
} from "three/addons/utils/GaussianSplatUtils.js";
import { decode } from "../tsplat.js";

const MOST_DEGREE = 3;

/**
 * A scene as an object of three.js: y is up as there, and the origin is the object's place.
 *
 * @param {import("../tsplat.js").Scene} scene as `decode` gives it
 */
export function splatsOf({ count, degree, means, quats, scales, opacities, sh, origin }) {
  const stride = 3 * (degree + 1) ** 2;
  const covariances = new Float32Array(6 * count);
  const colors = new Uint8ClampedArray(4 * count);
  const bands = Array.from({ length: Math.min(degree, MOST_DEGREE) }, (_, n) =>
    createPackedSphericalHarmonicsBand(count, n + 1),
  );
  for (let i = 0; i < count; i++) {
    const [w, x, y, z] = quats.subarray(4 * i, 4 * i + 4);
    writeCovariance(covariances, 6 * i, scales[3 * i], scales[3 * i + 1], scales[3 * i + 2], x, y, z, w);
    const at = i * stride;
    writeColorBytesFromSH0(colors, 4 * i, sh[at], sh[at + 1], sh[at + 2], opacities[i]);
    bands.forEach(({ bytes }, n) => {
      const [first, size] = [at + 3 * (n + 1) ** 2, bytes.length / count];
      for (let j = 0; j < SH_BAND_COMPONENTS[n + 1]; j++) bytes[i * size + j] = 128 * sh[first + j] + 128;
    });
  }
  const packed = Object.fromEntries(bands.map((band, n) => [`sh${n + 1}`, band.packed]));
  const splats = new GaussianSplat(createGaussianSplatGeometry(means, covariances, colors, packed));
  splats.rotation.x = Math.PI;
  splats.position.set(origin[0], -origin[1], -origin[2]);
  return splats;
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
