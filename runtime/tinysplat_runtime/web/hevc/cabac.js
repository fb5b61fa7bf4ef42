/** Context-adaptive binary arithmetic decoding: Rec. ITU-T H.265, clauses 9.3.2 and 9.3.4.3. */
import { TsplatError } from "../errors.js";

/** rangeTabLps by pStateIdx and qRangeIdx (table 9-52). */
const LPS_RANGES = Uint8Array.from([
  128, 176, 208, 240, 128, 167, 197, 227, 128, 158, 187, 216, 123, 150, 178, 205, 116, 142, 169, 195, 111, 135, 160,
  185, 105, 128, 152, 175, 100, 122, 144, 166, 95, 116, 137, 158, 90, 110, 130, 150, 85, 104, 123, 142, 81, 99, 117,
  135, 77, 94, 111, 128, 73, 89, 105, 122, 69, 85, 100, 116, 66, 80, 95, 110, 62, 76, 90, 104, 59, 72, 86, 99, 56, 69,
  81, 94, 53, 65, 77, 89, 51, 62, 73, 85, 48, 59, 69, 80, 46, 56, 66, 76, 43, 53, 63, 72, 41, 50, 59, 69, 39, 48, 56,
  65, 37, 45, 54, 62, 35, 43, 51, 59, 33, 41, 48, 56, 32, 39, 46, 53, 30, 37, 43, 50, 29, 35, 41, 48, 27, 33, 39, 45,
  26, 31, 37, 43, 24, 30, 35, 41, 23, 28, 33, 39, 22, 27, 32, 37, 21, 26, 30, 35, 20, 24, 29, 33, 19, 23, 27, 31, 18,
  22, 26, 30, 17, 21, 25, 28, 16, 20, 23, 27, 15, 19, 22, 25, 14, 18, 21, 24, 14, 17, 20, 23, 13, 16, 19, 22, 12, 15,
  18, 21, 12, 14, 17, 20, 11, 14, 16, 19, 11, 13, 15, 18, 10, 12, 15, 17, 10, 12, 14, 16, 9, 11, 13, 15, 9, 11, 12, 14,
  8, 10, 12, 14, 8, 9, 11, 13, 7, 9, 11, 12, 7, 9, 10, 12, 7, 8, 10, 11, 6, 8, 9, 11, 6, 7, 9, 10, 6, 7, 8, 9,
]);

/** transIdxLps by pStateIdx (table 9-53). */
const AFTER_LPS = [
  0, 0, 1, 2, 2, 4, 4, 5, 6, 7, 8, 9, 9, 11, 11, 12, 13, 13, 15, 15, 16, 16, 18, 18, 19, 19, 21, 21, 22, 22, 23, 24, 24,
  25, 26, 26, 27, 27, 28, 29, 29, 30, 30, 30, 31, 32, 32, 33, 33, 33, 34, 34, 35, 35, 35, 36, 36, 36, 37, 37, 37, 38,
  38,
];

/** States are 2 · pStateIdx + valMps, pStateIdx at most 62; what follows the more and the less probable symbol. */
const NEXT_MPS = new Uint8Array(126);
const NEXT_LPS = new Uint8Array(126);
for (let state = 0; state < 126; state++) {
  const [index, mps] = [state >> 1, state & 1];
  NEXT_MPS[state] = 2 * Math.min(index + 1, 62) + mps;
  NEXT_LPS[state] = 2 * AFTER_LPS[index] + (index === 0 ? 1 - mps : mps);
}

/** The decoder may look ahead so many bytes beyond a slice's last. */
const AHEAD = 2;

/**
 * ivlCurrRange is `range`; ivlOffset, with seven more bits of the stream behind it, is `value`. `wanted` counts from −8
 * the bits that `value` was shifted by since it last got a byte.
 */
export class Cabac {
  constructor() {
    /** @type {Uint8Array} */
    this.bytes = new Uint8Array(0);
    this.at = 0;
    this.range = 0;
    this.value = 0;
    this.wanted = 0;
    this.states = new Uint8Array(0);
  }

  /**
   * Initialise (9.3.2.2, 9.3.2.5).
   *
   * @param {Uint8Array} bytes
   * @param {Uint8Array} initial initValue of every context
   * @param {number} qp SliceQpY
   */
  start(bytes, initial, qp) {
    if (this.states.length !== initial.length) this.states = new Uint8Array(initial.length);
    const bounded = Math.min(Math.max(qp, 0), 51);
    for (let i = 0; i < initial.length; i++) {
      const slope = (initial[i] >> 4) * 5 - 45;
      const offset = ((initial[i] & 15) << 3) - 16;
      const pre = Math.min(Math.max(((slope * bounded) >> 4) + offset, 1), 126);
      this.states[i] = pre <= 63 ? 2 * (63 - pre) : 2 * (pre - 64) + 1;
    }
    this.bytes = bytes;
    this.at = 0;
    this.range = 510;
    this.value = (this.next() << 8) | this.next();
    this.wanted = -8;
    if (this.value >> 7 >= this.range)
      throw new TsplatError("a slice begins with what no encoder writes", "picture", 0);
  }

  /** The next byte of the stream; a few zeros behind its end, which decoding never depends on in a valid one. */
  next() {
    const at = this.at++;
    if (at < this.bytes.length) return this.bytes[at];
    if (at >= this.bytes.length + AHEAD) throw new TsplatError("a slice is cut short", "picture", at);
    return 0;
  }

  /**
   * A bin of context `index` (9.3.4.3.2).
   *
   * @param {number} index
   */
  bin(index) {
    const state = this.states[index];
    const lps = LPS_RANGES[((state & 126) << 1) | ((this.range >> 6) & 3)];
    const range = this.range - lps;
    const scaled = range << 7;
    if (this.value < scaled) {
      this.states[index] = NEXT_MPS[state];
      if (range >= 256) {
        this.range = range;
      } else {
        this.range = range << 1;
        this.value <<= 1;
        if (++this.wanted === 0) {
          this.value |= this.next();
          this.wanted = -8;
        }
      }
      return state & 1;
    }
    const shift = Math.clz32(lps) - 23;
    this.value = (this.value - scaled) << shift;
    this.range = lps << shift;
    this.states[index] = NEXT_LPS[state];
    this.wanted += shift;
    if (this.wanted >= 0) {
      this.value |= this.next() << this.wanted;
      this.wanted -= 8;
    }
    return (state & 1) ^ 1;
  }

  /** A bin of equal probabilities (9.3.4.3.4). */
  bypass() {
    this.value <<= 1;
    if (++this.wanted === 0) {
      this.value |= this.next();
      this.wanted = -8;
    }
    const scaled = this.range << 7;
    if (this.value < scaled) return 0;
    this.value -= scaled;
    return 1;
  }

  /**
   * A number of so many bypass bins; up to eight at once are a division's quotient.
   *
   * @param {number} count at most 24
   */
  bypasses(count) {
    let found = 0;
    while (count > 0) {
      const now = count < 8 ? count : 8;
      this.value <<= now;
      this.wanted += now;
      if (this.wanted >= 0) {
        this.value |= this.next() << this.wanted;
        this.wanted -= 8;
      }
      const scaled = this.range << 7;
      const quotient = (this.value / scaled) | 0;
      this.value -= quotient * scaled;
      found = (found << now) | quotient;
      count -= now;
    }
    return found;
  }

  /** The bin that ends a slice (9.3.4.3.5). */
  terminate() {
    this.range -= 2;
    const scaled = this.range << 7;
    if (this.value >= scaled) return 1;
    if (scaled < 256 << 7) {
      this.range <<= 1;
      this.value <<= 1;
      if (++this.wanted === 0) {
        this.value |= this.next();
        this.wanted = -8;
      }
    }
    return 0;
  }
}
