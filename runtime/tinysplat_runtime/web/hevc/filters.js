/** Filters of whole pictures: deblocking and sample adaptive offset: Rec. ITU-T H.265, clauses 8.7.2 and 8.7.3. */

/** @typedef {import("./intra.js").Plane} Plane */

/** β′ and tC′ by Q (table 8-12). */
const BETAS = Uint8Array.from({ length: 52 }, (_, q) => (q < 16 ? 0 : q < 29 ? q - 10 : 2 * q - 38));
const TCS = Uint8Array.from([
  0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4, 5,
  5, 6, 6, 7, 8, 9, 10, 11, 13, 14, 16, 18, 20, 22, 24,
]);

/** QpC by qPi from 30 to 43, of 4:2:0 (table 8-10). */
const CHROMA_QPS = [29, 30, 31, 32, 33, 33, 34, 34, 35, 35, 36, 36, 37, 37];

/** @param {number} index qPi */
export function chromaQp(index) {
  return index < 30 ? index : index >= 43 ? index - 6 : CHROMA_QPS[index - 30];
}

/**
 * @param {number} value
 * @param {number} low
 * @param {number} high
 */
function clip(value, low, high) {
  return value < low ? low : value > high ? high : value;
}

/**
 * What deblocking has to know of a picture.
 *
 * @typedef {object} Edges
 * @property {Uint8Array} vertical 1 where a transform block begins: by rows of 4 samples and columns of 8
 * @property {Uint8Array} horizontal likewise by rows of 8 samples and columns of 4
 * @property {Int8Array} qps QpY by blocks of 8 × 8
 * @property {number} betaOffset slice_beta_offset_div2 · 2
 * @property {number} tcOffset
 */

/** pcm and lossless blocks do not occur, and every edge is intra's: bS = 2. */
const INTRA_TC = 2;

/**
 * Deblock a plane: all vertical edges, then all horizontal ones; of chroma of 4:2:0, every other one (8.7.2.5).
 *
 * @param {Plane} plane
 * @param {Edges} edges
 * @param {number} offset cQpPicOffset of chroma
 */
export function deblock(plane, edges, offset) {
  const { width, height, isChroma } = plane;
  const [log2, step, filter] = isChroma ? [2, 2, filterChroma] : [3, 1, filterLuma];
  const [across, down] = [width >> log2, height >> log2]; // blocks of 8 × 8 of luma
  for (let row = 0; row < 2 * down; row++) {
    for (let column = step; column < across; column += step) {
      if (!edges.vertical[row * across + column]) continue;
      const at = (row >> 1) * across + column;
      const qp = ((edges.qps[at] + edges.qps[at - 1] + 1) >> 1) + offset;
      filter(plane, edges, (row << (log2 - 1)) * width + (column << log2), 1, width, qp);
    }
  }
  for (let row = step; row < down; row += step) {
    for (let column = 0; column < 2 * across; column++) {
      if (!edges.horizontal[row * 2 * across + column]) continue;
      const at = row * across + (column >> 1);
      const qp = ((edges.qps[at] + edges.qps[at - across] + 1) >> 1) + offset;
      filter(plane, edges, (row << log2) * width + (column << (log2 - 1)), width, 1, qp);
    }
  }
}

/**
 * Four lines of an edge of luma: decisions (8.7.2.5.3, 8.7.2.5.6) and filtering (8.7.2.5.7).
 *
 * @param {Plane} plane
 * @param {Edges} edges
 * @param {number} start the first line's first sample behind the edge
 * @param {number} a from sample to sample across the edge
 * @param {number} b from line to line
 * @param {number} qp qPL
 */
function filterLuma(plane, edges, start, a, b, qp) {
  const { samples: s, bits } = plane;
  const beta = BETAS[clip(qp + edges.betaOffset, 0, 51)] << (bits - 8);
  const tc = TCS[clip(qp + INTRA_TC + edges.tcOffset, 0, 53)] << (bits - 8);
  const last = start + 3 * b;
  const p0 = Math.abs(s[start - 3 * a] - 2 * s[start - 2 * a] + s[start - a]);
  const p3 = Math.abs(s[last - 3 * a] - 2 * s[last - 2 * a] + s[last - a]);
  const q0 = Math.abs(s[start + 2 * a] - 2 * s[start + a] + s[start]);
  const q3 = Math.abs(s[last + 2 * a] - 2 * s[last + a] + s[last]);
  if (p0 + q0 + p3 + q3 >= beta) return;
  const most = (1 << bits) - 1;
  if (isSmooth(s, start, a, 2 * (p0 + q0), beta, tc) && isSmooth(s, last, a, 2 * (p3 + q3), beta, tc)) {
    for (let i = start; i <= last; i += b) filterStrongly(s, i, a, 2 * tc);
    return;
  }
  const side = (beta + (beta >> 1)) >> 3;
  const isP = p0 + p3 < side;
  const isQ = q0 + q3 < side;
  for (let i = start; i <= last; i += b) filterWeakly(s, i, a, tc, most, isP, isQ);
}

/**
 * dSam of a line (8.7.2.5.6).
 *
 * @param {Uint16Array} s
 * @param {number} at
 * @param {number} a
 * @param {number} curved
 * @param {number} beta
 * @param {number} tc
 */
function isSmooth(s, at, a, curved, beta, tc) {
  if (curved >= beta >> 2) return false;
  const steep = Math.abs(s[at - 4 * a] - s[at - a]) + Math.abs(s[at] - s[at + 3 * a]);
  return steep < beta >> 3 && Math.abs(s[at - a] - s[at]) < (5 * tc + 1) >> 1;
}

/**
 * @param {Uint16Array} s
 * @param {number} at
 * @param {number} a
 * @param {number} tc2 2 · tC
 */
function filterStrongly(s, at, a, tc2) {
  const p3 = s[at - 4 * a];
  const p2 = s[at - 3 * a];
  const p1 = s[at - 2 * a];
  const p0 = s[at - a];
  const q0 = s[at];
  const q1 = s[at + a];
  const q2 = s[at + 2 * a];
  const q3 = s[at + 3 * a];
  s[at - a] = clip((p2 + 2 * p1 + 2 * p0 + 2 * q0 + q1 + 4) >> 3, p0 - tc2, p0 + tc2);
  s[at - 2 * a] = clip((p2 + p1 + p0 + q0 + 2) >> 2, p1 - tc2, p1 + tc2);
  s[at - 3 * a] = clip((2 * p3 + 3 * p2 + p1 + p0 + q0 + 4) >> 3, p2 - tc2, p2 + tc2);
  s[at] = clip((p1 + 2 * p0 + 2 * q0 + 2 * q1 + q2 + 4) >> 3, q0 - tc2, q0 + tc2);
  s[at + a] = clip((p0 + q0 + q1 + q2 + 2) >> 2, q1 - tc2, q1 + tc2);
  s[at + 2 * a] = clip((p0 + q0 + q1 + 3 * q2 + 2 * q3 + 4) >> 3, q2 - tc2, q2 + tc2);
}

/**
 * @param {Uint16Array} s
 * @param {number} at
 * @param {number} a
 * @param {number} tc
 * @param {number} most
 * @param {boolean} isP whether p1 changes too
 * @param {boolean} isQ
 */
function filterWeakly(s, at, a, tc, most, isP, isQ) {
  const p1 = s[at - 2 * a];
  const p0 = s[at - a];
  const q0 = s[at];
  const q1 = s[at + a];
  let delta = (9 * (q0 - p0) - 3 * (q1 - p1) + 8) >> 4;
  if (Math.abs(delta) >= 10 * tc) return;
  delta = clip(delta, -tc, tc);
  s[at - a] = clip(p0 + delta, 0, most);
  s[at] = clip(q0 - delta, 0, most);
  const half = tc >> 1;
  if (isP) s[at - 2 * a] = clip(p1 + clip((((s[at - 3 * a] + p0 + 1) >> 1) - p1 + delta) >> 1, -half, half), 0, most);
  if (isQ) s[at + a] = clip(q1 + clip((((s[at + 2 * a] + q0 + 1) >> 1) - q1 - delta) >> 1, -half, half), 0, most);
}

/**
 * Two lines of an edge of chroma (8.7.2.5.5, 8.7.2.5.8).
 *
 * @param {Plane} plane
 * @param {Edges} edges
 * @param {number} start
 * @param {number} a
 * @param {number} b
 * @param {number} index qPi
 */
function filterChroma(plane, edges, start, a, b, index) {
  const { samples: s, bits } = plane;
  const tc = TCS[clip(chromaQp(index) + INTRA_TC + edges.tcOffset, 0, 53)] << (bits - 8);
  const most = (1 << bits) - 1;
  for (let i = start; i <= start + b; i += b) {
    const p1 = s[i - 2 * a];
    const p0 = s[i - a];
    const q0 = s[i];
    const q1 = s[i + a];
    const delta = clip((4 * (q0 - p0) + p1 - q1 + 4) >> 3, -tc, tc);
    s[i - a] = clip(p0 + delta, 0, most);
    s[i] = clip(q0 - delta, 0, most);
  }
}

/** Band or edge offsets of a coding tree block. */
export const BAND = 1;
export const EDGE = 2;

/** Bytes of `sao` per coding tree block and plane: type, class or first band, four offsets. */
export const SAO_FIELDS = 6;

/** hPos and vPos of the two neighbours by class (table 8-13). */
const DIRECTIONS = [
  [1, 0],
  [0, 1],
  [1, 1],
  [-1, 1],
];

/** edgeIdx by 2 + sign + sign (8.7.3.2), as the number of an offset; 0: none. */
const EDGE_OFFSETS = [1, 2, 0, 3, 4];

/**
 * Sample adaptive offset of a plane (8.7.3). Offsets are not scaled: log2_sao_offset_scale is 0.
 *
 * @param {Plane} plane
 * @param {Int8Array} sao `SAO_FIELDS` per coding tree block
 * @param {number} log2 of a block's side in this plane
 */
export function offsetSamples(plane, sao, log2) {
  const { width, height, samples, bits } = plane;
  const before = samples.slice();
  const side = 1 << log2;
  const most = (1 << bits) - 1;
  const bands = new Int8Array(32);
  let at = 0;
  for (let y0 = 0; y0 < height; y0 += side) {
    for (let x0 = 0; x0 < width; x0 += side, at += SAO_FIELDS) {
      const bottom = Math.min(y0 + side, height);
      const right = Math.min(x0 + side, width);
      if (sao[at] === BAND) {
        bands.fill(0);
        for (let k = 0; k < 4; k++) bands[(sao[at + 1] + k) & 31] = sao[at + 2 + k];
        for (let y = y0; y < bottom; y++) {
          for (let i = y * width + x0; i < y * width + right; i++) {
            samples[i] = clip(before[i] + bands[before[i] >> (bits - 5)], 0, most);
          }
        }
      } else if (sao[at] === EDGE) {
        const [h, v] = DIRECTIONS[sao[at + 1]];
        const step = v * width + h;
        const top = Math.max(y0, v);
        const low = Math.min(bottom, height - v);
        const left = Math.max(x0, h === 0 ? 0 : 1);
        const far = Math.min(right, width - (h === 0 ? 0 : 1));
        for (let y = top; y < low; y++) {
          for (let i = y * width + left; i < y * width + far; i++) {
            const sample = before[i];
            const k = EDGE_OFFSETS[2 + Math.sign(sample - before[i - step]) + Math.sign(sample - before[i + step])];
            if (k) samples[i] = clip(sample + sao[at + 1 + k], 0, most);
          }
        }
      }
    }
  }
}
