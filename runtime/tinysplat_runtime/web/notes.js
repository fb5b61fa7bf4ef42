/** What a scene's maker says about it: docs/FORMAT.md, NOTE, REFI, ANTI and THIN. */
import { TsplatError } from "./errors.js";
import { cursor, only } from "./sections.js";

/** @typedef {import("./sections.js").Section} Section */

/** Longest text in bytes. */
const NOTES = [["unit", 32], ["attribution", 1024], ["licence", 128]];
const TEXTS = [["REFI", "refined", 128], ["ANTI", "antialiased", 3], ["THIN", "thinned", 128]];

/** First and last of each range of characters that do not print: FORMAT.md, "NOTE". */
const NOT_PRINTED = new RegExp(
  `[${[
    "00-1f", "7f-9f", "ad-ad", "600-605", "61c-61c", "6dd-6dd", "70f-70f", "890-891", "8e2-8e2", "180e-180e", "200b-200f",
    "2028-202e", "2060-206f", "d800-dfff", "feff-feff", "fff9-fffb", "110bd-110bd", "110cd-110cd", "13430-1343f",
    "1bca0-1bca3", "1d173-1d17a", "e0000-e007f",
  ].map((range) => range.split("-").map((code) => `\\u{${code}}`).join("-")).join("")}]`, "u",
);

/**
 * @param {Section[]} sections
 * @returns {Record<string, string>} the texts that are there, by name
 */
export function readNotes(sections) {
  /** @type {Record<string, string>} */
  const notes = {};
  const types = new Set(sections.map((section) => section.type));
  if (types.has("NOTE")) {
    const fields = cursor(only(sections, "NOTE"));
    const lengths = NOTES.map(() => fields.u16());
    NOTES.forEach(([name, most], i) => {
      fields.require(lengths[i] <= Number(most), `${name} of ${lengths[i]} bytes, at most ${most}`);
      const said = text(fields.take(lengths[i]), String(name), fields.section);
      if (said) notes[name] = said;
    });
    fields.finish();
  }
  for (const [type, name, most] of TEXTS) {
    if (!types.has(String(type))) continue;
    const fields = cursor(only(sections, String(type)));
    const length = fields.bytes.length;
    fields.require(length >= 1 && length <= Number(most), `${length} bytes, expected 1 to ${most}`);
    notes[name] = text(fields.bytes, String(name), fields.section);
    fields.require(name !== "antialiased" || notes[name] === "yes", "expected 'yes'");
  }
  return notes;
}

/**
 * @param {Uint8Array} bytes
 * @param {string} name
 * @param {string} section
 */
function text(bytes, name, section) {
  let found;
  try {
    found = new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(bytes);
  } catch {
    throw new TsplatError(`${name} is not UTF-8`, section);
  }
  if (NOT_PRINTED.test(found)) throw new TsplatError(`${name} holds characters that do not print`, section);
  return found;
}
