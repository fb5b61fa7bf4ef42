/** A file as its sections: docs/FORMAT.md, section 1. Nothing is believed before it is compared with the bytes. */
import { Cursor, crc32 } from "./cursor.js";
import { require } from "./errors.js";

const MAGIC = [0x89, 0x54, 0x53, 0x50, 0x4c, 0x41, 0x54, 0x0a];
const HEADER_BYTES = 20;
const ROW_BYTES = 16;
const MAX_SECTIONS = 256;
const REQUIRED = 1;

const KNOWN = new Set(["SCEN", "CAMS", "NOTE", "LAYR", "HEVC", "PHOT", "EXAC", "LIST", "TIER", "PICT", "DATA"]);

/**
 * @typedef {object} Section
 * @property {string} type
 * @property {number} index
 * @property {number} length as the table has it; `data` is shorter where a prefix ends
 * @property {number} crc
 * @property {number} start in the file
 * @property {Uint8Array} data
 */

/** @param {Section} section */
export function label(section) {
  return `${section.type}[${section.index}]`;
}

/**
 * Header and table, checked.
 *
 * @param {Uint8Array} bytes the file, or its first bytes
 * @param {boolean} isPrefix whether it may end before the table says
 */
export function readTable(bytes, isPrefix) {
  require(MAGIC.every((byte, i) => bytes[i] === byte), "not a .tsplat file", "header", 0);
  const header = new Cursor(bytes.subarray(0, HEADER_BYTES), "header");
  header.take(8);
  const [major, minor, count] = [header.u16(), header.u16(), header.u16()];
  header.u16();
  const crc = header.u32();
  require(major === 1, `format version ${major}.${minor}, this reader knows 1.x`, "header", 8);
  let end = HEADER_BYTES + ROW_BYTES * count;
  require(count <= MAX_SECTIONS && end <= bytes.length, `${count} sections do not fit: cut short?`, "table", 12);
  const table = bytes.subarray(HEADER_BYTES, end);
  require(crc32(table, crc32(bytes.subarray(0, 16))) === crc, "CRC differs: the header was altered", "header", 16);
  const rows = new Cursor(table, "table");
  /** @type {Section[]} */
  const sections = [];
  for (let row = 0; row < count; row++) {
    const type = String.fromCharCode(...rows.take(4));
    const [flags, index, length, sectionCrc] = [rows.u16(), rows.u16(), rows.u32(), rows.u32()];
    const section = { type, index, length, crc: sectionCrc, start: end, data: bytes.subarray(end, end + length) };
    require(isPrefix || section.data.length === length, `${section.data.length} bytes of ${length}`, label(section));
    end += length;
    if (KNOWN.has(type)) sections.push(section);
    else require(!(flags & REQUIRED), "unknown and required; a newer reader is needed", JSON.stringify(type));
  }
  require(bytes.length <= end, `${bytes.length - end} bytes behind the last section`, "file", end);
  const last = sections.at(-1);
  require(last?.type === "DATA" && last.start + last.length === end, "expected as the last section", "DATA[0]");
  const needed = last ? last.start : 0;
  require(needed <=
    bytes.length, `the first ${bytes.length} bytes hold no picture; the metadata alone takes ${needed}`, "file", bytes.length);
  const labels = sections.map(label);
  for (const section of sections) {
    const isIntact = section === last || crc32(section.data) === section.crc;
    require(isIntact, "CRC differs: the bytes were altered", label(section), 0);
  }
  require(new Set(labels).size === labels.length, "a section stands twice", "table");
  return { version: [major, minor], total: end, sections };
}

/**
 * How many of the file's first bytes are needed next for all of its metadata, which stand before its last section: those
 * of the header, then with the table, then all.
 *
 * @param {Uint8Array} bytes that are there
 */
export function neededBytes(bytes) {
  if (bytes.length < HEADER_BYTES) return HEADER_BYTES;
  const count = bytes[12] + 256 * bytes[13];
  require(count <= MAX_SECTIONS, `${count} sections, at most ${MAX_SECTIONS}`, "table", 12);
  let end = HEADER_BYTES + ROW_BYTES * count;
  if (bytes.length < end) return end;
  const rows = new Cursor(bytes.subarray(HEADER_BYTES, Math.max(end - ROW_BYTES, HEADER_BYTES)), "table");
  while (rows.at < rows.bytes.length) {
    rows.take(8);
    end += rows.u32();
    rows.take(4);
  }
  return end;
}

/**
 * The one section of a type and index.
 *
 * @param {Section[]} sections
 * @param {string} type
 */
export function only(sections, type, index = 0) {
  const found = sections.find((section) => section.type === type && section.index === index);
  require(found !== undefined, "missing", `${type}[${index}]`);
  return /** @type {Section} */ (found);
}

/** @param {Section} section */
export function cursor(section) {
  return new Cursor(section.data, label(section));
}
