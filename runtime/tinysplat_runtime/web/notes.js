/** What is said about a scene: docs/FORMAT.md, NOTE. */
import { TsplatError } from "./errors.js";
import { cursor, only } from "./sections.js";

/** @typedef {import("./sections.js").Section} Section */

const MAX_FIELDS = 64;

/** Longest text in bytes. @type {Record<string, number>} */
const TEXTS = { unit: 32, attribution: 1024, licence: 128, refined: 128, antialiased: 3, pruned: 128 };

/** First and last of each range of characters that do not print: FORMAT.md, "NOTE". */
const NOT_PRINTED = new RegExp(
  `[${[
    "00-1f",
    "7f-9f",
    "ad-ad",
    "600-605",
    "61c-61c",
    "6dd-6dd",
    "70f-70f",
    "890-891",
    "8e2-8e2",
    "180e-180e",
    "200b-200f",
    "2028-202e",
    "2060-206f",
    "d800-dfff",
    "feff-feff",
    "fff9-fffb",
    "110bd-110bd",
    "110cd-110cd",
    "13430-1343f",
    "1bca0-1bca3",
    "1d173-1d17a",
    "e0000-e007f",
  ]
    .map((range) =>
      range
        .split("-")
        .map((code) => `\\u{${code}}`)
        .join("-"),
    )
    .join("")}]`,
  "u",
);

/**
 * @param {Section[]} sections
 * @returns {Record<string, string>} the texts that are there, by name; of names that are not known, none
 */
export function readNotes(sections) {
  /** @type {Record<string, string>} */
  const notes = {};
  if (!sections.some(({ type }) => type === "NOTE")) return notes;
  const fields = cursor(only(sections, "NOTE"));
  const seen = new Set();
  while (fields.at < fields.bytes.length) {
    const [nameBytes, textBytes] = [fields.u8(), fields.u16()];
    const name = String.fromCharCode(...fields.take(nameBytes));
    const text = utf8(fields.take(textBytes), fields.section);
    fields.require(/^[a-z]+$/.test(name) && !seen.has(name) && seen.size < MAX_FIELDS, `a field '${name}'`);
    seen.add(name);
    if (!Object.hasOwn(TEXTS, name) || !text) continue;
    fields.require(textBytes <= TEXTS[name], `${name} of ${textBytes} bytes, at most ${TEXTS[name]}`);
    fields.require(!NOT_PRINTED.test(text), `${name} holds characters that do not print`);
    fields.require(name !== "antialiased" || text === "yes", "antialiased: expected 'yes'");
    notes[name] = text;
  }
  return notes;
}

/** @param {Uint8Array} bytes @param {string} section */
function utf8(bytes, section) {
  try {
    return new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(bytes);
  } catch {
    throw new TsplatError("a text that is not UTF-8", section);
  }
}
