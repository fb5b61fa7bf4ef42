/** Bits of parameter sets and slice headers: Rec. ITU-T H.265, clauses 7.2, 7.3.1.1 and 9.2. */
import { require } from "../errors.js";

/**
 * A NAL unit without its emulation prevention bytes (7.3.1.1).
 *
 * @param {Uint8Array} unit
 * @returns {Uint8Array}
 */
export function unescaped(unit) {
  const out = new Uint8Array(unit.length);
  let length = 0;
  let zeros = 0;
  for (let at = 0; at < unit.length; at++) {
    const byte = unit[at];
    if (zeros === 2) {
      require(byte >= 3, "a NAL unit holds a start code", "picture");
      zeros = 0;
      if (byte === 3) continue;
    }
    out[length++] = byte;
    zeros = byte === 0 ? zeros + 1 : 0;
  }
  return out.subarray(0, length);
}

/** Reads descriptors u(n), ue(v) and se(v), never past the end. */
export class BitReader {
  /** @param {Uint8Array} bytes without emulation prevention */
  constructor(bytes) {
    this.bytes = bytes;
    /** Place of the next bit. */
    this.at = 0;
  }

  /** One bit. */
  flag() {
    require(this.at < this.bytes.length * 8, "a parameter set or slice header is cut short", "picture", this.at >> 3);
    const bit = (this.bytes[this.at >> 3] >> (7 - (this.at & 7))) & 1;
    this.at++;
    return bit;
  }

  /** @param {number} count of bits, at most 32 */
  bits(count) {
    let value = 0;
    for (let i = 0; i < count; i++) value = value * 2 + this.flag();
    return value;
  }

  /** @param {number} count of bits that nothing depends on */
  skip(count) {
    for (let i = 0; i < count; i++) this.flag();
  }

  /**
   * An unsigned Exp-Golomb number (9.2).
   *
   * @param {number} most that is accepted
   */
  ue(most = 0xffffffff) {
    let zeros = 0;
    while (!this.flag()) require(++zeros < 32, "a number of more than 32 bits", "picture", this.at >> 3);
    const value = 2 ** zeros - 1 + this.bits(zeros);
    require(value <= most, `${value} in a parameter set or slice header, at most ${most}`, "picture", this.at >> 3);
    return value;
  }

  /**
   * A signed Exp-Golomb number (9.2.2).
   *
   * @param {number} most largest magnitude that is accepted
   */
  se(most) {
    const value = this.ue(2 * most);
    return value & 1 ? (value + 1) / 2 : -value / 2;
  }
}
