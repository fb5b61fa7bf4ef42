/** A file as its sections: docs/FORMAT.md, sections 1 and 2. Nothing is believed before it is compared with the bytes. */
import { Cursor, crc32 } from "./cursor.js";
import { require } from "./errors.js";

const MAGIC = [0x89, 0x54, 0x53, 0x50, 0x4c, 0x41, 0x54, 0x0a];
export const HEADER_BYTES = 20;
const ROW_BYTES = 16;
const MAX_SECTIONS = 8192;
const REQUIRED = 1;

/** Sections of pictures, by number of the class. */
export const PLANES = ["DEPT", "COLO", "OPAC", "SCAL", "ROTA", "OFFS"];

const KNOWN = new Set([
  "SCEN", "CAMS", "LAYR", "HEVC", "NOTE", "REFI", "ANTI", "THIN", "NETW", "GRPS", "PHOT", "PICS", "EXAC", "EXAP", "FREE", "TIER",
  "FREP", "SEEN", "UNIT", "VIEW", ...PLANES,
]);

/** Sections of pictures and positions, which have CRCs of their own and which a prefix may lack. */
const PICTURES = new Set(["VIEW", "FREP", ...PLANES]);

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
  let metadataEnd = 0;
  for (let row = 0; row < count; row++) {
    const type = String.fromCharCode(...rows.take(4));
    const [flags, index, length, sectionCrc] = [rows.u16(), rows.u16(), rows.u32(), rows.u32()];
    const section = { type, index, length, crc: sectionCrc, start: end, data: bytes.subarray(end, end + length) };
    require(isPrefix || section.data.length === length, `${section.data.length} bytes of ${length}`, label(section));
    end += length;
    if (KNOWN.has(type)) sections.push(section);
    else require(!(flags & REQUIRED), "unknown and required; a newer reader is needed", JSON.stringify(type));
    if (KNOWN.has(type) && !PICTURES.has(type)) metadataEnd = end;
  }
  require(bytes.length <= end, `${bytes.length - end} bytes behind the last section`, "file", end);
  const short = `the first ${bytes.length} bytes hold no picture; the metadata alone takes ${metadataEnd}`;
  require(metadataEnd <= bytes.length, short, "file", bytes.length);
  for (const section of sections) {
    const isIntact = PICTURES.has(section.type) || crc32(section.data) === section.crc;
    require(isIntact, "CRC differs: the bytes were altered", label(section), 0);
  }
  return { version: [major, minor], total: end, sections };
}

/** Bytes of header and table. @param {Uint8Array} header */
export function tableBytes(header) {
  const count = header[12] + 256 * header[13];
  require(count <= MAX_SECTIONS, `${count} sections, at most ${MAX_SECTIONS}`, "table", 12);
  return HEADER_BYTES + ROW_BYTES * count;
}

/**
 * Bytes of the file that hold all metadata; undefined where `bytes` do not even hold the table.
 *
 * @param {Uint8Array} bytes
 */
export function metadataBytes(bytes) {
  if (bytes.length < HEADER_BYTES) return undefined;
  let end = tableBytes(bytes);
  if (bytes.length < end) return undefined;
  const rows = new Cursor(bytes.subarray(HEADER_BYTES, end), "table");
  let metadataEnd = end;
  while (rows.at < rows.bytes.length) {
    const type = String.fromCharCode(...rows.take(4));
    rows.take(4);
    end += rows.u32();
    rows.take(4);
    if (KNOWN.has(type) && !PICTURES.has(type)) metadataEnd = end;
  }
  return metadataEnd;
}

/**
 * The one section of a type and index.
 *
 * @param {Section[]} sections
 * @param {string} type
 */
export function only(sections, type, index = 0) {
  const found = sections.filter((section) => section.type === type && section.index === index);
  require(found.length === 1, found.length ? `stands ${found.length} times` : "missing", `${type}[${index}]`);
  return found[0];
}

/** @param {Section} section */
export function cursor(section) {
  return new Cursor(section.data, label(section));
}
