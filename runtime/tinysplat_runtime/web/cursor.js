/** Numbers off a section, never past its end; and CRC-32 as zlib has it. */
import { TsplatError } from "./errors.js";

/** Reads little-endian numbers one after the other. */
export class Cursor {
  /**
   * @param {Uint8Array} bytes
   * @param {string} section for messages
   */
  constructor(bytes, section) {
    this.bytes = bytes;
    this.section = section;
    this.at = 0;
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  }

  /** @param {number} count */
  take(count) {
    const left = this.bytes.length - this.at;
    this.require(count <= left, `needs ${count} bytes, ${left} remain`);
    this.at += count;
    return this.bytes.subarray(this.at - count, this.at);
  }

  u8() {
    return this.take(1)[0];
  }

  u16() {
    this.take(2);
    return this.view.getUint16(this.at - 2, true);
  }

  u32() {
    this.take(4);
    return this.view.getUint32(this.at - 4, true);
  }

  f16() {
    return widened(this.u16());
  }

  f32() {
    this.take(4);
    return this.view.getFloat32(this.at - 4, true);
  }

  f64() {
    this.take(8);
    return this.view.getFloat64(this.at - 8, true);
  }

  /**
   * @param {"f16" | "f32" | "f64"} type
   * @param {number} count
   */
  numbers(type, count) {
    const size = Number(type.slice(1)) / 8;
    this.require(size * count <= this.bytes.length - this.at, `needs ${count} numbers, and ends before`);
    const found = new Float64Array(count);
    for (let i = 0; i < count; i++) found[i] = this[type]();
    return found;
  }

  /** ASCII text in a field that zeros fill up. @param {number} size */
  ascii(size) {
    const text = String.fromCharCode(...this.take(size)).replace(/\0+$/, "");
    this.require(/^[\0-\x7f]*$/.test(text), "a name that is not ASCII");
    return text;
  }

  /**
   * @param {boolean} condition
   * @param {string} message
   */
  require(condition, message) {
    if (!condition) throw new TsplatError(message, this.section, this.at);
  }

  /** Refuse bytes that are left. */
  finish() {
    this.require(this.at === this.bytes.length, `${this.bytes.length - this.at} bytes too many`);
  }
}

/**
 * The number of an IEEE half.
 *
 * @param {number} bits
 */
export function widened(bits) {
  const sign = bits & 0x8000 ? -1 : 1;
  const exponent = (bits >> 10) & 31;
  const fraction = bits & 1023;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (1024 + fraction) * 2 ** (exponent - 25);
}

const CRC_TABLE = Uint32Array.from({ length: 256 }, (_, byte) => {
  let value = byte;
  for (let i = 0; i < 8; i++) value = value & 1 ? 0xedb88320 ^ (value >>> 1) : value >>> 1;
  return value;
});

/**
 * @param {Uint8Array} bytes
 * @param {number} before CRC of what stands before them
 */
export function crc32(bytes, before = 0) {
  let value = ~before;
  for (let i = 0; i < bytes.length; i++) value = CRC_TABLE[(value ^ bytes[i]) & 255] ^ (value >>> 8);
  return ~value >>> 0;
}
