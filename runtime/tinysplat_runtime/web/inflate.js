/** A zlib stream of a known length: RFC 1950 and RFC 1951. */
import { TsplatError } from "./errors.js";

const LENGTH_ORDER = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];
const MAX_BITS = 15;

class Inflater {
  /**
   * @param {Uint8Array} bytes
   * @param {number} length that must come out
   * @param {string} where
   */
  constructor(bytes, length, where) {
    this.bytes = bytes;
    this.at = 0;
    this.held = 0;
    this.count = 0;
    this.out = new Uint8Array(length);
    this.length = 0;
    this.where = where;
  }

  /** @param {boolean} condition */
  require(condition, message = "zlib: the stream is damaged") {
    if (!condition) throw new TsplatError(message, this.where);
  }

  /** @param {number} count at most 16 */
  bits(count) {
    while (this.count < count) {
      this.require(this.at < this.bytes.length, "zlib: the stream is cut short");
      this.held |= this.bytes[this.at++] << this.count;
      this.count += 8;
    }
    const found = this.held & ((1 << count) - 1);
    this.held >>>= count;
    this.count -= count;
    return found;
  }

  /**
   * Counts of codes by length, and symbols in the order of their codes (RFC 1951, 3.2.2).
   *
   * @param {ArrayLike<number>} lengths
   * @param {boolean} mayLack whether a code of a single symbol may leave others out
   */
  codes(lengths, mayLack) {
    const counts = new Uint16Array(MAX_BITS + 1);
    for (let i = 0; i < lengths.length; i++) counts[lengths[i]]++;
    const used = lengths.length - counts[0];
    counts[0] = 0;
    const starts = new Uint16Array(MAX_BITS + 2);
    let left = 1;
    for (let bits = 1; bits <= MAX_BITS; bits++) {
      left = 2 * left - counts[bits];
      this.require(left >= 0);
      starts[bits + 1] = starts[bits] + counts[bits];
    }
    this.require(left === 0 || (mayLack && used <= 1 && counts[1] === used));
    const symbols = new Uint16Array(lengths.length);
    for (let i = 0; i < lengths.length; i++) if (lengths[i]) symbols[starts[lengths[i]]++] = i;
    return { counts, symbols };
  }

  /** @param {{ counts: Uint16Array, symbols: Uint16Array }} codes */
  symbol({ counts, symbols }) {
    let [code, first, index] = [0, 0, 0];
    for (let bits = 1; bits <= MAX_BITS; bits++) {
      code |= this.bits(1);
      if (code - counts[bits] < first) return symbols[index + code - first];
      index += counts[bits];
      first = (first + counts[bits]) << 1;
      code <<= 1;
    }
    throw new TsplatError("zlib: no such code", this.where);
  }

  stored() {
    this.held = this.count = 0;
    const [length, inverse] = [this.bits(16), this.bits(16)];
    this.require(length === (~inverse & 0xffff));
    this.require(length <= this.bytes.length - this.at && length <= this.out.length - this.length);
    this.out.set(this.bytes.subarray(this.at, this.at + length), this.length);
    this.at += length;
    this.length += length;
  }

  /** Codes of a block (3.2.7). */
  tables() {
    const [literals, distances, count] = [257 + this.bits(5), 1 + this.bits(5), 4 + this.bits(4)];
    this.require(literals <= 286 && distances <= 30);
    const ofLengths = new Uint8Array(19);
    for (let i = 0; i < count; i++) ofLengths[LENGTH_ORDER[i]] = this.bits(3);
    const codes = this.codes(ofLengths, false);
    const lengths = new Uint8Array(literals + distances);
    for (let i = 0; i < lengths.length; ) {
      const symbol = this.symbol(codes);
      if (symbol < 16) {
        lengths[i++] = symbol;
        continue;
      }
      this.require(symbol > 16 || i > 0);
      const value = symbol === 16 ? lengths[i - 1] : 0;
      const repeat = symbol === 16 ? 3 + this.bits(2) : symbol === 17 ? 3 + this.bits(3) : 11 + this.bits(7);
      this.require(i + repeat <= lengths.length);
      lengths.fill(value, i, i + repeat);
      i += repeat;
    }
    this.require(lengths[256] > 0);
    return [this.codes(lengths.subarray(0, literals), true), this.codes(lengths.subarray(literals), true)];
  }

  /** Codes that are fixed (3.2.6). */
  fixed() {
    const lengths = new Uint8Array(288);
    lengths.fill(8, 0, 144).fill(9, 144, 256).fill(7, 256, 280).fill(8, 280);
    return [this.codes(lengths, false), this.codes(new Uint8Array(32).fill(5), false)];
  }

  /** @param {{ counts: Uint16Array, symbols: Uint16Array }[]} tables */
  block([literals, distances]) {
    for (;;) {
      const symbol = this.symbol(literals);
      if (symbol === 256) return;
      if (symbol < 256) {
        this.require(this.length < this.out.length);
        this.out[this.length++] = symbol;
        continue;
      }
      const length = symbol === 285 ? 258 : this.extended(symbol - 257, 4);
      this.require(symbol < 286);
      const code = this.symbol(distances);
      this.require(code < 30);
      const distance = this.extended(code, 2) - 2;
      this.require(distance <= this.length && length <= this.out.length - this.length);
      for (let i = 0; i < length; i++, this.length++) this.out[this.length] = this.out[this.length - distance];
    }
  }

  /**
   * The number of a length's or distance's code: as many codes as `group` share a number of extra bits (3.2.5).
   *
   * @param {number} code
   * @param {number} group
   */
  extended(code, group) {
    const extra = Math.max(((code / group) | 0) - 1, 0);
    const base = code < 2 * group ? code + 3 : ((group + (code % group)) << extra) + 3;
    return base + this.bits(extra);
  }

  run() {
    const [method, flags] = [this.bits(8), this.bits(8)];
    this.require((method & 15) === 8 && method >> 4 <= 7 && (256 * method + flags) % 31 === 0 && !(flags & 32));
    for (let isLast = 0; !isLast; ) {
      isLast = this.bits(1);
      const type = this.bits(2);
      this.require(type < 3);
      if (type === 0) this.stored();
      else this.block(type === 1 ? this.fixed() : this.tables());
    }
    this.held = this.count = 0;
    let [a, b] = [1, 0];
    for (let i = 0; i < this.length; i++) {
      a = (a + this.out[i]) % 65521;
      b = (b + a) % 65521;
    }
    const [b1, b0, a1, a0] = [this.bits(8), this.bits(8), this.bits(8), this.bits(8)];
    this.require(b === 256 * b1 + b0 && a === 256 * a1 + a0, "zlib: the checksum differs");
    this.require(this.length === this.out.length, `does not come to ${this.out.length} bytes`);
    this.require(this.at === this.bytes.length, "zlib: bytes behind the stream's end");
    return this.out;
  }
}

/**
 * @param {Uint8Array} bytes
 * @param {number} length that must come out
 * @param {string} where
 */
export function inflate(bytes, length, where) {
  return new Inflater(bytes, length, where).run();
}
