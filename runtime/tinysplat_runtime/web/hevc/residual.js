/** Transform coefficients of a block: Rec. ITU-T H.265, clauses 7.3.8.11, 9.3.3.11, 9.3.4.2.4 to 9.3.4.2.7 and 8.6.3. */
import { TsplatError } from "../errors.js";
import {
  GREATER1,
  GREATER1_CHROMA,
  GREATER2,
  GREATER2_CHROMA,
  LAST_X,
  LAST_Y,
  SIGNIFICANT,
  SIGNIFICANT_CHROMA,
  SUB_BLOCK,
  SUB_BLOCK_CHROMA,
} from "./contexts.js";

/** @typedef {import("./cabac.js").Cabac} Cabac */

/** Scans of clause 6.5.3 to 6.5.5: up-right diagonal, horizontal, vertical. */
const DIAGONAL = 0;
const HORIZONTAL = 1;

/**
 * Places y · side + x of a square in the order of a scan.
 *
 * @param {number} side
 * @param {number} scan
 */
function scanned(side, scan) {
  const places = [];
  for (let y = 0; y < side; y++) for (let x = 0; x < side; x++) places.push([x, y]);
  if (scan === DIAGONAL) places.sort((a, b) => a[0] + a[1] - b[0] - b[1] || b[1] - a[1]);
  else if (scan !== HORIZONTAL) places.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  return Uint8Array.from(places, ([x, y]) => y * side + x);
}

/** @param {Uint8Array} order */
function inverted(order) {
  const places = new Uint8Array(order.length);
  order.forEach((place, index) => (places[place] = index));
  return places;
}

/** By scan: the places of a sub-block's coefficients; by scan and log2 of how many sub-blocks are in a row: theirs. */
const IN_BLOCK = [0, 1, 2].map((scan) => scanned(4, scan));
const PLACE_IN_BLOCK = IN_BLOCK.map(inverted);
const OF_BLOCKS = [0, 1, 2].map((scan) => [0, 1, 2, 3].map((log2) => scanned(1 << log2, scan)));
const PLACE_OF_BLOCK = OF_BLOCKS.map((orders) => orders.map(inverted));

/** ctxIdxMap of blocks of 4 × 4 (table 9-50). */
const MAP_4 = [0, 1, 4, 5, 2, 3, 4, 5, 6, 6, 8, 8, 7, 7, 8, 8];

/**
 * sigCtx within a sub-block by which neighbouring sub-blocks have coefficients, 1 right, 2 below (9.3.4.2.5).
 *
 * @param {number} neighbours
 * @param {number} x
 * @param {number} y
 */
function nearby(neighbours, x, y) {
  if (neighbours === 0) return x + y === 0 ? 2 : x + y < 3 ? 1 : 0;
  if (neighbours === 3) return 2;
  const along = neighbours === 1 ? y : x;
  return along === 0 ? 2 : along === 1 ? 1 : 0;
}

/**
 * Contexts of sig_coeff_flag: 16 by place for every kind of block (4 × 4; 8 × 8 scanned diagonally; 8 × 8; larger),
 * chroma or not, first sub-block or not, and neighbours.
 */
const SIGNIFICANT_CONTEXTS = new Uint8Array(4 * 2 * 2 * 4 * 16);
for (let row = 0; row < 64; row++) {
  const [kind, isChroma, isFirst, neighbours] = [row >> 4, (row >> 3) & 1, (row >> 2) & 1, row & 3];
  for (let place = 0; place < 16; place++) {
    let context = MAP_4[place];
    if (kind > 0) {
      const size = isChroma ? [0, 9, 9, 12][kind] : [0, 9, 15, 21][kind] + (isFirst ? 0 : 3);
      context = isFirst && place === 0 ? 0 : nearby(neighbours, place & 3, place >> 2) + size;
    }
    SIGNIFICANT_CONTEXTS[row * 16 + place] = SIGNIFICANT + context + (isChroma ? SIGNIFICANT_CHROMA : 0);
  }
}

const LEVEL_SCALE = [40, 45, 51, 57, 64, 72];
const MAX_LEVEL = 32768;
const MAX_PREFIX = 32;

/**
 * last_sig_coeff_x_prefix or _y_prefix (9.3.4.2.3).
 *
 * @param {Cabac} cabac
 * @param {number} first context of the element
 * @param {number} log2 of the block's side
 * @param {boolean} isChroma
 */
function lastPrefix(cabac, first, log2, isChroma) {
  const offset = first + (isChroma ? 15 : 3 * (log2 - 2) + ((log2 - 1) >> 2));
  const shift = isChroma ? log2 - 2 : (log2 + 1) >> 2;
  const most = 2 * log2 - 1;
  let prefix = 0;
  while (prefix < most && cabac.bin(offset + (prefix >> shift))) prefix++;
  return prefix;
}

/**
 * LastSignificantCoeffX or Y of a prefix (7.4.9.11).
 *
 * @param {Cabac} cabac
 * @param {number} prefix
 */
function lastPlace(cabac, prefix) {
  if (prefix < 4) return prefix;
  const count = (prefix >> 1) - 1;
  return ((2 + (prefix & 1)) << count) + cabac.bypasses(count);
}

/**
 * coeff_abs_level_remaining (9.3.3.11).
 *
 * @param {Cabac} cabac
 * @param {number} rice cRiceParam
 */
function remaining(cabac, rice) {
  let prefix = 0;
  while (prefix < MAX_PREFIX && cabac.bypass()) prefix++;
  if (prefix < 4) return (prefix << rice) + cabac.bypasses(rice);
  const count = prefix - 3 + rice;
  if (count > 16) throw new TsplatError("a coefficient beyond 16 bits", "picture");
  return (((1 << (prefix - 3)) + 2) << rice) + cabac.bypasses(count);
}

/** Coefficients of one block at a time, scaled, and how far from the corner they reach. */
export class Coefficients {
  /** @param {number} bits of a sample */
  constructor(bits) {
    this.bits = bits;
    /** Rows of 32; all 0 but within `columns` and `rows`. */
    this.values = new Int32Array(32 * 32);
    this.columns = 0;
    this.rows = 0;
    this.hasSub = new Uint8Array(64);
    this.places = new Uint8Array(16);
    this.levels = new Int32Array(16);
  }

  /** Make all of them 0. */
  clear() {
    for (let y = 0; y < this.rows; y++) this.values.fill(0, y * 32, y * 32 + this.columns);
    this.columns = this.rows = 0;
  }

  /**
   * Decode a block's (7.3.8.11), and scale them (8.6.3).
   *
   * @param {Cabac} cabac
   * @param {number} log2 of the block's side
   * @param {boolean} isChroma
   * @param {number} scan scanIdx
   * @param {number} qp qP, with the bit depth's offset
   * @param {boolean} signHiding
   */
  read(cabac, log2, isChroma, scan, qp, signHiding) {
    const prefixX = lastPrefix(cabac, LAST_X, log2, isChroma);
    const prefixY = lastPrefix(cabac, LAST_Y, log2, isChroma);
    const across = lastPlace(cabac, prefixX);
    const down = lastPlace(cabac, prefixY);
    const lastX = scan === 2 ? down : across;
    const lastY = scan === 2 ? across : down;
    const subLog2 = log2 - 2;
    const subs = OF_BLOCKS[scan][subLog2];
    const order = IN_BLOCK[scan];
    const lastSub = PLACE_OF_BLOCK[scan][subLog2][((lastY >> 2) << subLog2) + (lastX >> 2)];
    const lastInSub = PLACE_IN_BLOCK[scan][((lastY & 3) << 2) + (lastX & 3)];
    const kind = log2 === 2 ? 0 : log2 === 3 ? (scan === DIAGONAL ? 1 : 2) : 3;
    const contexts = ((kind << 1) | (isChroma ? 1 : 0)) << 7;
    const width = 1 << subLog2;
    const { hasSub, places, levels } = this;
    hasSub.fill(0, 0, width * width);
    const scale = LEVEL_SCALE[qp % 6] << ((qp / 6) | 0);
    const shift = this.bits + log2 - 9;
    let greater1 = 1;
    for (let i = lastSub; i >= 0; i--) {
      const sub = subs[i];
      const x = sub & (width - 1);
      const y = sub >> subLog2;
      const neighbours = (x + 1 < width ? hasSub[sub + 1] : 0) | (y + 1 < width ? hasSub[sub + width] << 1 : 0);
      let isCoded = i === lastSub || i === 0;
      let isInferred = false;
      if (!isCoded) {
        isCoded = cabac.bin(SUB_BLOCK + (neighbours ? 1 : 0) + (isChroma ? SUB_BLOCK_CHROMA : 0)) === 1;
        isInferred = true;
      }
      if (!isCoded) continue;
      hasSub[sub] = 1;
      const row = (contexts | (i === 0 ? 64 : 0) | (neighbours << 4)) >>> 0;
      let count = 0;
      let n = 15;
      if (i === lastSub) {
        places[count++] = lastInSub;
        n = lastInSub - 1;
      }
      for (; n > 0; n--) if (cabac.bin(SIGNIFICANT_CONTEXTS[row + order[n]])) places[count++] = n;
      if (n === 0) {
        if ((isInferred && count === 0) || cabac.bin(SIGNIFICANT_CONTEXTS[row])) places[count++] = 0;
      }
      if (count === 0) continue;
      greater1 = this.readLevels(
        cabac,
        count,
        (i === 0 || isChroma ? 0 : 2) + (greater1 === 0 ? 1 : 0),
        isChroma,
        signHiding,
      );
      const corner = (y << 7) | (x << 2);
      for (let k = 0; k < count; k++) {
        const place = order[places[k]];
        this.values[corner + ((place >> 2) << 5) + (place & 3)] = scaled(levels[k], scale, shift);
      }
      if (4 * x + 4 > this.columns) this.columns = 4 * x + 4;
      if (4 * y + 4 > this.rows) this.rows = 4 * y + 4;
    }
  }

  /**
   * Levels of the coefficients at `places` of a sub-block; returns the state of the flags of levels above 1, for the
   * next sub-block's contexts (9.3.4.2.6).
   *
   * @param {Cabac} cabac
   * @param {number} count
   * @param {number} set ctxSet
   * @param {boolean} isChroma
   * @param {boolean} signHiding
   */
  readLevels(cabac, count, set, isChroma, signHiding) {
    const { places, levels } = this;
    const flags = count < 8 ? count : 8;
    const contexts = GREATER1 + 4 * set + (isChroma ? GREATER1_CHROMA : 0);
    let greater1 = 1;
    let first = -1;
    for (let k = 0; k < flags; k++) {
      if (cabac.bin(contexts + greater1)) {
        levels[k] = 2;
        greater1 = 0;
        if (first < 0) first = k;
      } else {
        levels[k] = 1;
        if (greater1 > 0 && greater1 < 3) greater1++;
      }
    }
    for (let k = flags; k < count; k++) levels[k] = 1;
    if (first >= 0 && cabac.bin(GREATER2 + set + (isChroma ? GREATER2_CHROMA : 0))) levels[first] = 3;
    const isHidden = signHiding && places[0] - places[count - 1] > 3;
    const shown = isHidden ? count - 1 : count;
    let signs = cabac.bypasses(shown) << (32 - shown);
    let rice = 0;
    let sum = 0;
    for (let k = 0; k < count; k++) {
      let level = levels[k];
      // All that the flags can say: 3 of the first above 1, 2 of others, 1 of those that have no flag.
      if (level === (k === first ? 3 : k < flags ? 2 : 1)) {
        level += remaining(cabac, rice);
        if (level > 3 << rice && rice < 4) rice++;
      }
      sum += level;
      if (level > MAX_LEVEL) throw new TsplatError("a coefficient beyond 16 bits", "picture");
      levels[k] = signs < 0 ? -level : level;
      signs <<= 1;
    }
    if (isHidden && sum & 1) levels[count - 1] = -levels[count - 1];
    return greater1;
  }
}

/**
 * A coefficient of a level (8.6.3, of flat scaling factors), within 16 bits.
 *
 * @param {number} level
 * @param {number} scale
 * @param {number} shift
 */
function scaled(level, scale, shift) {
  const product = level * scale + (1 << (shift - 1)); // exact in a double
  if (product >= 0x7fffffff) return 32767;
  if (product <= -0x7fffffff) return -32768;
  const value = product >> shift;
  return value > 32767 ? 32767 : value < -32768 ? -32768 : value;
}
