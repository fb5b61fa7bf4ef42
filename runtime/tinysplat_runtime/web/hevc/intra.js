/** Intra prediction of blocks: Rec. ITU-T H.265, clauses 8.4.4.2.2 to 8.4.4.2.6. */

export const PLANAR = 0;
export const DC = 1;
export const ACROSS = 10;
export const DOWN = 26;
const FIRST_DOWN = 18;

/** intraPredAngle by mode (table 8-5). */
const ANGLES = [
  0, 0, 32, 26, 21, 17, 13, 9, 5, 2, 0, -2, -5, -9, -13, -17, -21, -26, -32, -26, -21, -17, -13, -9, -5, -2, 0, 2, 5, 9,
  13, 17, 21, 26, 32,
];

/** invAngle of modes 11 to 25 (table 8-6). */
const INVERSES = [-4096, -1638, -910, -630, -482, -390, -315, -256, -315, -390, -482, -630, -910, -1638, -4096];

/** intraHorVerDistThres by log2 of the side (table 8-4). */
const FILTER_ABOVE = [99, 99, 99, 7, 1, 0];

/** Neighbouring samples p[−1][2N − 1] up to p[−1][−1], which is number 2N, then p[0][−1] to p[2N − 1][−1]. */
const border = new Int32Array(129);
const smooth = new Int32Array(129);
/** `ref` of 8.4.4.2.6, whose index 0 is here 32. */
const reference = new Int32Array(97);

/** A plane of the picture under way, and which of its parts are there. */
export class Plane {
  /**
   * @param {number} width
   * @param {number} height
   * @param {number} unitLog2 log2 of the side of a unit of `done`
   * @param {number} bits of a sample
   * @param {boolean} isChroma
   */
  constructor(width, height, unitLog2, bits, isChroma) {
    this.width = width;
    this.height = height;
    this.unitLog2 = unitLog2;
    this.bits = bits;
    this.isChroma = isChroma;
    this.samples = new Uint16Array(width * height);
    this.unitsAcross = width >> unitLog2;
    this.unitsDown = height >> unitLog2;
  }
}

/**
 * Fill `border` from what is decoded, and what is not from its neighbours (8.4.4.2.2).
 *
 * @param {Plane} plane
 * @param {Uint8Array} done by unit: decoded
 * @param {number} x0 of the block
 * @param {number} y0
 * @param {number} side
 */
function gatherBorder(plane, done, x0, y0, side) {
  const { samples, width, unitLog2, unitsAcross, unitsDown } = plane;
  const unit = 1 << unitLog2;
  const column = (x0 >> unitLog2) - 1;
  const row = (y0 >> unitLog2) - 1;
  const units = side >> unitLog2;
  let first = -1; // number of the first sample that is decoded
  if (column >= 0) {
    for (let u = 2 * units - 1; u >= 0; u--) {
      const at = row + 1 + u;
      const to = (2 * units - 1 - u) << unitLog2;
      if (at < unitsDown && done[at * unitsAcross + column]) {
        let from = (y0 + (u << unitLog2) + unit - 1) * width + x0 - 1;
        for (let i = 0; i < unit; i++, from -= width) border[to + i] = samples[from];
        if (first < 0) first = to;
      } else if (first >= 0) {
        border.fill(border[to - 1], to, to + unit);
      }
    }
  }
  const corner = 2 * side;
  if (column >= 0 && row >= 0 && done[row * unitsAcross + column]) {
    border[corner] = samples[(y0 - 1) * width + x0 - 1];
    if (first < 0) first = corner;
  } else if (first >= 0) {
    border[corner] = border[corner - 1];
  }
  for (let u = 0; u < 2 * units; u++) {
    const at = column + 1 + u;
    const to = corner + 1 + (u << unitLog2);
    if (row >= 0 && at < unitsAcross && done[row * unitsAcross + at]) {
      const from = (y0 - 1) * width + x0 + (u << unitLog2);
      for (let i = 0; i < unit; i++) border[to + i] = samples[from + i];
      if (first < 0) first = to;
    } else if (first >= 0) {
      border.fill(border[to - 1], to, to + unit);
    }
  }
  if (first < 0) border.fill(1 << (plane.bits - 1), 0, 4 * side + 1);
  else border.fill(border[first], 0, first);
}

/**
 * Filtering of neighbouring samples (8.4.4.2.3): the array that holds the result.
 *
 * @param {number} side
 * @param {number} log2
 * @param {number} mode
 * @param {number} bits
 * @param {boolean} isStrong strong_intra_smoothing_enabled_flag
 */
function filtered(side, log2, mode, bits, isStrong) {
  const distance = Math.min(Math.abs(mode - DOWN), Math.abs(mode - ACROSS));
  if (mode === DC || distance <= FILTER_ABOVE[log2]) return border;
  const end = 4 * side;
  const low = border[0];
  const corner = border[2 * side];
  const high = border[end];
  const limit = 1 << (bits - 5);
  smooth[0] = low;
  smooth[end] = high;
  if (
    isStrong &&
    side === 32 &&
    Math.abs(corner + high - 2 * border[3 * side]) < limit &&
    Math.abs(corner + low - 2 * border[side]) < limit
  ) {
    for (let i = 1; i < 64; i++) {
      smooth[i] = ((64 - i) * low + i * corner + 32) >> 6;
      smooth[64 + i] = ((64 - i) * corner + i * high + 32) >> 6;
    }
    smooth[64] = corner;
  } else {
    for (let i = 1; i < end; i++) smooth[i] = (border[i - 1] + 2 * border[i] + border[i + 1] + 2) >> 2;
  }
  return smooth;
}

/**
 * Predict a block from its neighbours (8.4.4.2.1).
 *
 * @param {Plane} plane
 * @param {Uint8Array} done
 * @param {number} x0
 * @param {number} y0
 * @param {number} log2 of the side
 * @param {number} mode
 * @param {boolean} isStrong
 */
export function predict(plane, done, x0, y0, log2, mode, isStrong) {
  const side = 1 << log2;
  gatherBorder(plane, done, x0, y0, side);
  const source = plane.isChroma ? border : filtered(side, log2, mode, plane.bits, isStrong);
  const start = y0 * plane.width + x0;
  const isEdged = !plane.isChroma && log2 < 5;
  if (mode === PLANAR) planar(source, plane, start, log2);
  else if (mode === DC) flat(source, plane, start, log2, isEdged);
  else angular(source, plane, start, log2, mode, isEdged);
}

/**
 * INTRA_PLANAR (8.4.4.2.4).
 *
 * @param {Int32Array} p
 * @param {Plane} plane
 * @param {number} start
 * @param {number} log2
 */
function planar(p, { samples, width: stride }, start, log2) {
  const side = 1 << log2;
  const corner = 2 * side;
  const right = p[corner + side + 1];
  const below = p[side - 1];
  for (let y = 0; y < side; y++) {
    const left = p[corner - 1 - y];
    const at = start + y * stride;
    // (side − 1 − x)·left + (x + 1)·right, and what does not change with x
    let across = (side - 1) * left + right + (y + 1) * below + side;
    for (let x = 0; x < side; x++) {
      samples[at + x] = (across + (side - 1 - y) * p[corner + 1 + x]) >> (log2 + 1);
      across += right - left;
    }
  }
}

/**
 * INTRA_DC (8.4.4.2.5).
 *
 * @param {Int32Array} p
 * @param {Plane} plane
 * @param {number} start
 * @param {number} log2
 * @param {boolean} isEdged
 */
function flat(p, { samples, width: stride }, start, log2, isEdged) {
  const side = 1 << log2;
  const corner = 2 * side;
  let sum = side;
  for (let i = 1; i <= side; i++) sum += p[corner - i] + p[corner + i];
  const mean = sum >> (log2 + 1);
  for (let y = 0; y < side; y++) samples.fill(mean, start + y * stride, start + y * stride + side);
  if (!isEdged) return;
  samples[start] = (p[corner - 1] + 2 * mean + p[corner + 1] + 2) >> 2;
  for (let i = 1; i < side; i++) {
    samples[start + i] = (p[corner + 1 + i] + 3 * mean + 2) >> 2;
    samples[start + i * stride] = (p[corner - 1 - i] + 3 * mean + 2) >> 2;
  }
}

/**
 * INTRA_ANGULAR2 to 34 (8.4.4.2.6). Modes below 18 are those above, mirrored at the diagonal.
 *
 * @param {Int32Array} p
 * @param {Plane} plane
 * @param {number} start
 * @param {number} log2
 * @param {number} mode
 * @param {boolean} isEdged disableIntraBoundaryFilter is 0
 */
function angular(p, plane, start, log2, mode, isEdged) {
  const { samples, width: stride } = plane;
  const side = 1 << log2;
  const corner = 2 * side;
  const isDown = mode >= FIRST_DOWN;
  const angle = ANGLES[mode];
  const way = isDown ? 1 : -1; // through p, from the corner along the main side
  const [along, across] = isDown ? [1, stride] : [stride, 1];
  for (let i = 0; i <= side; i++) reference[32 + i] = p[corner + way * i];
  if (angle < 0) {
    const inverse = INVERSES[mode - 11];
    for (let i = (side * angle) >> 5; i < 0; i++) {
      reference[32 + i] = p[corner - way * ((i * inverse + 128) >> 8)];
    }
  } else {
    for (let i = side + 1; i <= 2 * side; i++) reference[32 + i] = p[corner + way * i];
  }
  let position = angle;
  for (let y = 0; y < side; y++, position += angle) {
    const base = 33 + (position >> 5);
    const fact = position & 31;
    let at = start + y * across;
    if (fact === 0) {
      for (let x = 0; x < side; x++, at += along) samples[at] = reference[base + x];
    } else {
      let value = reference[base];
      for (let x = 1; x <= side; x++, at += along) {
        const next = reference[base + x];
        samples[at] = (value * (32 - fact) + next * fact + 16) >> 5;
        value = next;
      }
    }
  }
  if (angle === 0 && isEdged) {
    const most = (1 << plane.bits) - 1;
    const base = p[corner + way];
    for (let y = 0, at = start; y < side; y++, at += across) {
      const value = base + ((p[corner - way * (1 + y)] - p[corner]) >> 1);
      samples[at] = value < 0 ? 0 : value > most ? most : value;
    }
  }
}
