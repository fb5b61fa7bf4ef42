/** Inverse transforms, added to the prediction: Rec. ITU-T H.265, clauses 8.6.4.2 and 8.6.7. */

/** @typedef {import("./residual.js").Coefficients} Coefficients */

/** Column 0 of transMatrix by row, from which all its other entries follow (8.6.4.2). */
const FIRST = [
  64, 90, 90, 90, 89, 88, 87, 85, 83, 82, 80, 78, 75, 73, 70, 67, 64, 61, 57, 54, 50, 46, 43, 38, 36, 31, 25, 22, 18,
  13, 9, 4,
];

/**
 * cos(πm/64): ± an entry of column 0, by the symmetries of the cosine.
 *
 * @param {number} m
 */
function cosine(m) {
  const angle = m % 128 > 64 ? 128 - (m % 128) : m % 128;
  return angle === 32 ? 0 : angle < 32 ? FIRST[angle] : -FIRST[64 - angle];
}

/** By log2 of the side less 2: transMatrix of that size, transposed, of the samples of its first half. */
const MATRICES = [2, 3, 4, 5].map((log2) => {
  const side = 1 << log2;
  return Int8Array.from({ length: (side * side) / 2 }, (_, i) =>
    cosine(((2 * (i >> log2) + 1) * (i & (side - 1))) << (5 - log2)),
  );
});

/** The matrix of 4 × 4 luma blocks (8.6.4.2, trType 1), by sample and coefficient. */
const SINES = Int8Array.from([29, 74, 84, 55, 55, 74, -29, -84, 74, 0, -74, 74, 84, -74, 55, -29]);

const middle = new Int32Array(32 * 32);

/** @param {number} value */
function to16(value) {
  return value > 32767 ? 32767 : value < -32768 ? -32768 : value;
}

/**
 * The columns of a block's coefficients, transformed: into `middle`, rows of 32, clipped to 16 bits.
 *
 * @param {Coefficients} block
 * @param {number} log2
 */
function transformColumns(block, log2) {
  const { values, columns, rows } = block;
  const side = 1 << log2;
  const half = 1 << (log2 - 1);
  const matrix = MATRICES[log2 - 2];
  for (let x = 0; x < columns; x++) {
    for (let k = 0; k < half; k++) {
      let even = 64;
      let odd = 0;
      const at = k << log2;
      for (let n = 0; n < rows; n += 2) {
        even += values[(n << 5) + x] * matrix[at + n];
        odd += values[(n << 5) + 32 + x] * matrix[at + n + 1];
      }
      middle[(k << 5) + x] = to16((even + odd) >> 7);
      middle[((side - 1 - k) << 5) + x] = to16((even - odd) >> 7);
    }
  }
}

/**
 * The inverse DCT of a block, added to samples.
 *
 * @param {Coefficients} block
 * @param {number} log2 of the block's side
 * @param {Uint16Array} plane
 * @param {number} start of the block in the plane
 * @param {number} stride
 */
export function addCosines(block, log2, plane, start, stride) {
  const shift = 20 - block.bits;
  const most = (1 << block.bits) - 1;
  const side = 1 << log2;
  const round = 1 << (shift - 1);
  if (block.columns === 4 && block.rows === 4 && isFlat(block.values)) {
    const rest = (to16((64 * block.values[0] + 64) >> 7) * 64 + round) >> shift;
    for (let y = 0; y < side; y++) {
      const at = start + y * stride;
      for (let x = at; x < at + side; x++) {
        const value = plane[x] + rest;
        plane[x] = value < 0 ? 0 : value > most ? most : value;
      }
    }
    return;
  }
  transformColumns(block, log2);
  const columns = block.columns;
  const half = side >> 1;
  const matrix = MATRICES[log2 - 2];
  for (let y = 0; y < side; y++) {
    const line = y << 5;
    const at = start + y * stride;
    for (let k = 0; k < half; k++) {
      let even = round;
      let odd = 0;
      const row = k << log2;
      for (let n = 0; n < columns; n += 2) {
        even += middle[line + n] * matrix[row + n];
        odd += middle[line + n + 1] * matrix[row + n + 1];
      }
      const left = plane[at + k] + ((even + odd) >> shift);
      const right = plane[at + side - 1 - k] + ((even - odd) >> shift);
      plane[at + k] = left < 0 ? 0 : left > most ? most : left;
      plane[at + side - 1 - k] = right < 0 ? 0 : right > most ? most : right;
    }
  }
}

/** @param {Int32Array} values whether of the first 4 × 4 only the first is not 0 */
function isFlat(values) {
  return (
    (values[1] |
      values[2] |
      values[3] |
      values[32] |
      values[33] |
      values[34] |
      values[35] |
      values[64] |
      values[65] |
      values[66] |
      values[67] |
      values[96] |
      values[97] |
      values[98] |
      values[99]) ===
    0
  );
}

/**
 * The inverse DST of a block of 4 × 4, added to samples.
 *
 * @param {Coefficients} block
 * @param {Uint16Array} plane
 * @param {number} start
 * @param {number} stride
 */
export function addSines(block, plane, start, stride) {
  const { values, bits } = block;
  const shift = 20 - bits;
  const most = (1 << bits) - 1;
  const round = 1 << (shift - 1);
  for (let x = 0; x < 4; x++) {
    const a = values[x];
    const b = values[32 + x];
    const c = values[64 + x];
    const d = values[96 + x];
    for (let k = 0; k < 4; k++) {
      const at = 4 * k;
      middle[32 * k + x] = to16((a * SINES[at] + b * SINES[at + 1] + c * SINES[at + 2] + d * SINES[at + 3] + 64) >> 7);
    }
  }
  for (let y = 0; y < 4; y++) {
    const line = 32 * y;
    const a = middle[line];
    const b = middle[line + 1];
    const c = middle[line + 2];
    const d = middle[line + 3];
    for (let k = 0; k < 4; k++) {
      const at = 4 * k;
      const sum = a * SINES[at] + b * SINES[at + 1] + c * SINES[at + 2] + d * SINES[at + 3];
      const value = plane[start + y * stride + k] + ((sum + round) >> shift);
      plane[start + y * stride + k] = value < 0 ? 0 : value > most ? most : value;
    }
  }
}
