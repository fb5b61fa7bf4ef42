/** Codes of a view to its Gaussians: docs/FORMAT.md, section 4, steps 1 to 7. */
import { exactRotation, multiplied, quaternionOf } from "./cameras.js";
import { COLOR, DEPTH } from "./table.js";

/** @typedef {import("./layers.js").Layer} Layer */

/** Channels of geometry: depth, offset 2, scale 3, rotation 4, opacity. */
const CHANNELS = 11;
/** First of them by class; colour has none. */
const FIRST_OF = [0, -1, 10, 3, 6, 1];
const SCALES = 3;
/** Least w² of a rotation that is rebuilt from a vector part. */
const MIN_W2 = 0.01;

/**
 * Gaussians of all layers, one after the other.
 *
 * @typedef {object} Arrays
 * @property {number} count
 * @property {number} degree of the SH coefficients
 * @property {Float32Array} means 3 each, relative to the origin
 * @property {Float32Array} quats wxyz
 * @property {Float32Array} scales 3 each, linear
 * @property {Float32Array} opacities linear
 * @property {Float32Array} sh 3(degree + 1)² each: RGB of every function
 */

/**
 * @param {number} count
 * @param {number} degree
 * @returns {Arrays}
 */
export function newArrays(count, degree) {
  return {
    count,
    degree,
    means: new Float32Array(3 * count),
    quats: new Float32Array(4 * count),
    scales: new Float32Array(3 * count),
    opacities: new Float32Array(count),
    sh: new Float32Array(3 * (degree + 1) ** 2 * count),
  };
}

/**
 * What turns a view's channels into Gaussians, the same for all of its pixels.
 *
 * @param {Layer} layer
 * @param {number} view
 * @param {Float64Array} origin
 */
function frameOf({ cameras, references }, view, origin) {
  const camera = cameras[view];
  const rotation = exactRotation(camera);
  const { c2w } = camera;
  const own = quaternionOf(rotation);
  const centre = [c2w[3] - origin[0], c2w[7] - origin[1], c2w[11] - origin[2]];
  const quat = references ? multiplied(own, references[view]) : own;
  return { camera, rotation, centre, quat, focal: Math.sqrt(camera.fx * camera.fy) };
}

/**
 * Weights of every coded record in the channels, and what is added: with the scale mix folded in.
 *
 * @param {Layer} layer
 */
function geometryWeights(layer) {
  const { channels, mix } = layer;
  const weights = channels.map(() => new Float64Array(CHANNELS));
  const added = new Float64Array(CHANNELS);
  channels.forEach((channel, i) => {
    if (channel.planeClass === COLOR) return;
    const row = FIRST_OF[channel.planeClass] + channel.target;
    added[row] += channel.offset;
    if (channel.isCoded) weights[i][row] = channel.scale;
  });
  if (mix) for (const numbers of [...weights, added]) mixScales(mix, numbers, numbers === added);
  return { weights, added };
}

/**
 * @param {Float64Array} mix
 * @param {Float64Array} numbers
 * @param {boolean} isConstant
 */
function mixScales(mix, numbers, isConstant) {
  const [a, b, c] = numbers.subarray(SCALES, SCALES + 3);
  for (let i = 0; i < 3; i++) {
    numbers[SCALES + i] = mix[3 * i] * a + mix[3 * i + 1] * b + mix[3 * i + 2] * c + (isConstant ? mix[9 + i] : 0);
  }
}

/**
 * SH coefficients of a code of every coded record of colour, and what is added.
 *
 * @param {Layer} layer
 */
function colourWeights(layer) {
  const d = 3 * (layer.degree + 1) ** 2;
  const { basis, k } = layer;
  /** @param {number} target @param {number} row */
  const entry = (target, row) => (basis ? basis[row * k + target] : target === row ? 1 : 0);
  const added = new Float64Array(d);
  const weights = layer.channels.map((channel) => {
    const column = new Float64Array(d);
    if (channel.planeClass !== COLOR) return column;
    for (let row = 0; row < d; row++) {
      added[row] += entry(channel.target, row) * channel.offset;
      if (channel.isCoded) column[row] = entry(channel.target, row) * channel.scale;
    }
    return column;
  });
  return { weights, added };
}

/** Makes the Gaussians of a layer, a view at a time in any order. */
export class Synthesis {
  /**
   * @param {Layer} layer
   * @param {Float64Array} origin
   * @param {Arrays} out
   * @param {number} first Gaussian of the layer
   */
  constructor(layer, origin, out, first) {
    this.layer = layer;
    this.origin = origin;
    this.out = out;
    this.first = first;
    this.geometry = geometryWeights(layer);
    this.colours = colourWeights(layer);
  }

  /**
   * @param {number} view
   * @param {(Uint16Array | number | undefined)[]} codes by record: a picture's, one for all pixels, or none of a constant
   * @param {Float64Array[]} [base] eleven channels that codes are added to
   * @param {number} [height] rows that are made, the first ones
   */
  run(view, codes, base, height = this.layer.height) {
    const { layer } = this;
    const frame = frameOf(layer, view, this.origin);
    const rows = Array.from({ length: CHANNELS }, () => new Float64Array(layer.width));
    for (let row = 0; row < height; row++) {
      this.gather(codes, base, rows, row * layer.width);
      this.place(frame, rows, row, this.first + (view * layer.height + row) * layer.width);
    }
    this.paint(view, codes, height);
  }

  /**
   * The channels of a row of pixels.
   *
   * @param {(Uint16Array | number | undefined)[]} codes
   * @param {Float64Array[] | undefined} base
   * @param {Float64Array[]} rows
   * @param {number} start
   */
  gather(codes, base, rows, start) {
    const { weights, added } = this.geometry;
    for (let channel = 0; channel < CHANNELS; channel++) {
      const row = rows[channel];
      row.fill(added[channel]);
      if (base) for (let x = 0; x < row.length; x++) row[x] += base[channel][start + x];
      for (let i = 0; i < codes.length; i++) {
        const weight = weights[i][channel];
        const picture = codes[i];
        if (weight === 0 || picture === undefined) continue;
        if (typeof picture === "number") for (let x = 0; x < row.length; x++) row[x] += weight * picture;
        else for (let x = 0; x < row.length; x++) row[x] += weight * picture[start + x];
      }
    }
  }

  /**
   * Steps 2 to 6 of a row of pixels.
   *
   * @param {ReturnType<typeof frameOf>} frame
   * @param {Float64Array[]} rows
   * @param {number} y
   * @param {number} first Gaussian of the row
   */
  place(frame, rows, y, first) {
    const { isInverse, zMin, zMax, width, references } = this.layer;
    const { means, quats, scales, opacities } = this.out;
    const { fx, fy, cx, cy, skew } = frame.camera;
    const [depth, across, down, s0, s1, s2, r0, r1, r2, r3, opacity] = rows;
    const [m0, m1, m2, m3, m4, m5, m6, m7, m8] = frame.rotation;
    const [c0, c1, c2] = frame.centre;
    const [qw, qx, qy, qz] = frame.quat;
    const [least, most] = [-1 / zMin, -1 / zMax];
    for (let x = 0; x < width; x++) {
      let z = depth[x];
      if (isInverse) z = -1 / (z < least ? least : z > most ? most : z);
      z = z < zMin ? zMin : z > zMax ? zMax : z;
      const v = (down[x] + y + 0.5 - cy) / fy;
      const u = (across[x] + x + 0.5 - cx - skew * v) / fx;
      const g = first + x;
      means[3 * g] = z * (m0 * u + m1 * v + m2) + c0;
      means[3 * g + 1] = z * (m3 * u + m4 * v + m5) + c1;
      means[3 * g + 2] = z * (m6 * u + m7 * v + m8) + c2;
      const size = z / frame.focal;
      scales[3 * g] = s0[x] > 0 ? s0[x] * size : 0;
      scales[3 * g + 1] = s1[x] > 0 ? s1[x] * size : 0;
      scales[3 * g + 2] = s2[x] > 0 ? s2[x] * size : 0;
      opacities[g] = opacity[x] < 0 ? 0 : opacity[x] > 1 ? 1 : opacity[x];
      let w = r0[x];
      let i = r1[x];
      let j = r2[x];
      let k = r3[x];
      const squared = i * i + j * j + k * k;
      if (references) w = Math.sqrt(1 - squared > MIN_W2 ? 1 - squared : MIN_W2);
      let length = Math.sqrt(squared + w * w);
      if (length === 0) w = length = 1;
      w /= length;
      i /= length;
      j /= length;
      k /= length;
      quats[4 * g] = qw * w - qx * i - qy * j - qz * k;
      quats[4 * g + 1] = qw * i + qx * w + qy * k - qz * j;
      quats[4 * g + 2] = qw * j - qx * k + qy * w + qz * i;
      quats[4 * g + 3] = qw * k + qx * j - qy * i + qz * w;
    }
  }

  /**
   * SH coefficients of a view (step 7).
   *
   * @param {number} view
   * @param {(Uint16Array | number | undefined)[]} codes
   * @param {number} height rows that are made
   */
  paint(view, codes, height) {
    const { layer, out } = this;
    const pixels = height * layer.width;
    const stride = 3 * (out.degree + 1) ** 2;
    const added = this.colours.added.slice();
    /** @type {Uint16Array[]} */
    const pictures = [];
    /** @type {Float64Array[]} */
    const columns = [];
    codes.forEach((picture, i) => {
      if (layer.channels[i].planeClass !== COLOR || picture === undefined) return;
      const column = this.colours.weights[i];
      if (typeof picture === "number") {
        column.forEach((weight, row) => (added[row] += weight * picture));
      } else {
        pictures.push(picture);
        columns.push(column);
      }
    });
    const d = added.length;
    const count = pictures.length;
    const mix = new Float64Array(d * count);
    columns.forEach((column, i) => column.forEach((weight, row) => (mix[row * count + i] = weight)));
    const values = new Float64Array(count);
    const { sh } = out;
    let to = (this.first + view * layer.height * layer.width) * stride;
    for (let pixel = 0; pixel < pixels; pixel++, to += stride) {
      for (let i = 0; i < count; i++) values[i] = pictures[i][pixel];
      for (let row = 0, at = 0; row < d; row++) {
        let sum = added[row];
        for (let i = 0; i < count; i++) sum += mix[at++] * values[i];
        sh[to + row] = sum;
      }
    }
  }

  /**
   * Make a view's Gaussians invisible.
   *
   * @param {number} view
   */
  hide(view) {
    const pixels = this.layer.height * this.layer.width;
    this.out.opacities.fill(0, this.first + view * pixels, this.first + (view + 1) * pixels);
  }
}

/**
 * The code that stands for all samples of an absent picture: FORMAT.md, "Prefixes".
 *
 * @param {Layer} layer
 * @param {number} index of the record
 */
export function standInCode(layer, index) {
  const { planeClass, target, scale, offset } = layer.channels[index];
  const isFurther = layer.channels.slice(0, index).some((c) => c.planeClass === planeClass && c.target === target);
  if (!isFurther || scale === 0) return 2048;
  const nearest = -offset / scale;
  const down = Math.floor(nearest);
  const isUp = nearest - down > 0.5 || (nearest - down === 0.5 && down % 2 !== 0);
  return Math.min(Math.max(down + (isUp ? 1 : 0), 0), 4095);
}

/**
 * Index of the record whose absence hides a view; −1 if none.
 *
 * @param {Layer} layer
 */
export function hidingRecord(layer) {
  return layer.channels.findIndex((channel) => channel.planeClass === DEPTH);
}
