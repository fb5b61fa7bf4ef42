/** Raw LZMA2 with lc = lp = pb = 0, as the streams of positions are: the format of xz, "LZMA2", and of the LZMA SDK, "lzma-specification". */
import { TsplatError } from "./errors.js";

/** Where errors are. */
export const POSITIONS = "positions";
const DICTIONARY = 1 << 16;
const STATES = 12;
const HALF = 1024;
const TOP = 2 ** 24;

/** Where each array of probabilities begins. With pb = 0 there is one position state, with lc = lp = 0 one literal coder. */
const IS_MATCH = 0;
const IS_REP = IS_MATCH + STATES;
const IS_REP0 = IS_REP + STATES;
const IS_REP1 = IS_REP0 + STATES;
const IS_REP2 = IS_REP1 + STATES;
const IS_REP0_LONG = IS_REP2 + STATES;
const SLOTS = IS_REP0_LONG + STATES;
const SPECIAL = SLOTS + 4 * 64;
const ALIGN = SPECIAL + 115;
const LENGTHS = ALIGN + 16;
const REP_LENGTHS = LENGTHS + 2 + 8 + 8 + 256;
const LITERALS = REP_LENGTHS + 2 + 8 + 8 + 256;
const COUNT = LITERALS + 0x300;

/** @returns {never} */
function refuse(message = "LZMA: the stream is damaged") {
  throw new TsplatError(message, POSITIONS);
}

class Lzma2 {
  /**
   * @param {Uint8Array} bytes
   * @param {number} most bytes that may come out
   */
  constructor(bytes, most) {
    this.bytes = bytes;
    this.at = 0;
    this.out = new Uint8Array(most);
    this.length = 0;
    /** Where the dictionary begins: matches reach no farther back. */
    this.start = 0;
    this.probabilities = new Uint16Array(COUNT).fill(HALF);
    this.range = 0;
    this.code = 0;
    this.state = 0;
    this.reps = [0, 0, 0, 0];
  }

  byte() {
    if (this.at >= this.bytes.length) refuse("LZMA: the stream is cut short");
    return this.bytes[this.at++];
  }

  /** Chunk after chunk, until a control byte of 0, which must be the stream's last. */
  run() {
    let needsDictionary = true;
    let needsProperties = true;
    for (;;) {
      const control = this.byte();
      if (control === 0) break;
      if (control >= 0xe0 || control === 1) {
        needsDictionary = false;
        needsProperties = true;
        this.start = this.length;
      } else if (needsDictionary) {
        refuse();
      }
      if (control < 0x80) {
        if (control > 2) refuse();
        this.copyChunk();
        continue;
      }
      const size = ((control & 0x1f) << 16) + (this.byte() << 8) + this.byte() + 1;
      const packed = (this.byte() << 8) + this.byte() + 1;
      if (control >= 0xc0) {
        if (this.byte() !== 0) refuse("LZMA: other properties than lc = lp = pb = 0");
        needsProperties = false;
      } else if (needsProperties) {
        refuse();
      }
      if (control >= 0xa0) {
        this.probabilities.fill(HALF);
        this.state = 0;
        this.reps.fill(0);
      }
      this.chunk(size, packed);
    }
    if (this.at !== this.bytes.length) refuse("LZMA: bytes behind the stream's end");
    return this.out.subarray(0, this.length);
  }

  copyChunk() {
    const size = (this.byte() << 8) + this.byte() + 1;
    if (size > this.bytes.length - this.at || size > this.out.length - this.length) refuse();
    this.out.set(this.bytes.subarray(this.at, this.at + size), this.length);
    this.at += size;
    this.length += size;
  }

  /**
   * @param {number} size bytes that come out
   * @param {number} packed bytes that go in
   */
  chunk(size, packed) {
    const end = this.at + packed;
    if (end > this.bytes.length || packed < 5 || size > this.out.length - this.length) refuse();
    this.range = 0xffffffff;
    if (this.byte() !== 0) refuse();
    this.code = 0;
    for (let i = 0; i < 4; i++) this.code = ((this.code << 8) | this.byte()) >>> 0;
    const target = this.length + size;
    while (this.length < target) this.symbol(target);
    this.normalize();
    if (this.at !== end || this.code !== 0) refuse();
  }

  normalize() {
    if (this.range < TOP) {
      this.range = (this.range << 8) >>> 0;
      this.code = ((this.code << 8) | this.byte()) >>> 0;
    }
  }

  /** @param {number} index of a probability */
  bit(index) {
    this.normalize();
    const probability = this.probabilities[index];
    const bound = (this.range >>> 11) * probability;
    if (this.code < bound) {
      this.range = bound;
      this.probabilities[index] = probability + ((2048 - probability) >> 5);
      return 0;
    }
    this.range -= bound;
    this.code -= bound;
    this.probabilities[index] = probability - (probability >> 5);
    return 1;
  }

  /** @param {number} count */
  direct(count) {
    let found = 0;
    for (let i = 0; i < count; i++) {
      this.normalize();
      this.range >>>= 1;
      const isSet = this.code >= this.range;
      if (isSet) this.code -= this.range;
      found = found * 2 + (isSet ? 1 : 0);
    }
    return found;
  }

  /**
   * @param {number} first probability of a tree
   * @param {number} count of bits
   */
  tree(first, count) {
    let node = 1;
    for (let i = 0; i < count; i++) node = (node << 1) | this.bit(first + node);
    return node - (1 << count);
  }

  /**
   * @param {number} first
   * @param {number} count
   */
  reverseTree(first, count) {
    let [node, found] = [1, 0];
    for (let i = 0; i < count; i++) {
      const bit = this.bit(first + node);
      node = (node << 1) | bit;
      found |= bit << i;
    }
    return found;
  }

  /** @param {number} first of a length's probabilities */
  matchLength(first) {
    if (!this.bit(first)) return 2 + this.tree(first + 2, 3);
    if (!this.bit(first + 1)) return 10 + this.tree(first + 10, 3);
    return 18 + this.tree(first + 18, 8);
  }

  /** @param {number} length */
  distance(length) {
    const slot = this.tree(SLOTS + 64 * Math.min(length - 2, 3), 6);
    if (slot < 4) return slot;
    const count = (slot >> 1) - 1;
    const base = (2 | (slot & 1)) * 2 ** count;
    if (slot < 14) return base + this.reverseTree(SPECIAL + base - slot, count);
    return base + this.direct(count - 4) * 16 + this.reverseTree(ALIGN, 4);
  }

  literal() {
    let node = 1;
    if (this.state >= 7) {
      let match = this.out[this.length - this.reps[0] - 1];
      while (node < 0x100) {
        const matched = (match >> 7) & 1;
        match <<= 1;
        const bit = this.bit(LITERALS + ((1 + matched) << 8) + node);
        node = (node << 1) | bit;
        if (bit !== matched) break;
      }
    }
    while (node < 0x100) node = (node << 1) | this.bit(LITERALS + node);
    this.out[this.length++] = node & 255;
    this.state = this.state < 4 ? 0 : this.state - (this.state < 10 ? 3 : 6);
  }

  /**
   * A literal or a match, which may not go beyond the chunk.
   *
   * @param {number} target
   */
  symbol(target) {
    const { reps, state } = this;
    if (!this.bit(IS_MATCH + state)) {
      if (state >= 7 && this.length - this.start <= reps[0]) refuse();
      this.literal();
      return;
    }
    let length = 1;
    if (!this.bit(IS_REP + state)) {
      length = this.matchLength(LENGTHS);
      reps.unshift(this.distance(length));
      reps.pop();
      this.state = state < 7 ? 7 : 10;
    } else {
      let which = 0;
      if (this.bit(IS_REP0 + state)) which = this.bit(IS_REP1 + state) ? 2 + this.bit(IS_REP2 + state) : 1;
      else if (!this.bit(IS_REP0_LONG + state)) which = -1;
      if (which > 0) reps.unshift(...reps.splice(which, 1));
      if (which >= 0) length = this.matchLength(REP_LENGTHS);
      this.state = which < 0 ? (state < 7 ? 9 : 11) : state < 7 ? 8 : 11;
    }
    const distance = reps[0] + 1;
    const reach = Math.min(this.length - this.start, DICTIONARY);
    if (distance > reach || length > target - this.length) refuse();
    for (let i = 0; i < length; i++, this.length++) this.out[this.length] = this.out[this.length - distance];
  }
}

/**
 * What a stream comes to.
 *
 * @param {Uint8Array} bytes
 * @param {number} most bytes that are accepted
 */
export function unpackLzma2(bytes, most) {
  return new Lzma2(bytes, most).run();
}
