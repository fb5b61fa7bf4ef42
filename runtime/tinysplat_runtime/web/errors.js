/** What is wrong with a file: the section and the byte in it where that was seen. */
export class TsplatError extends Error {
  /**
   * @param {string} message one line: what was found, and what is accepted
   * @param {string} [section] such as `LAYR[0]`
   * @param {number} [offset] in bytes, in the section
   */
  constructor(message, section, offset) {
    super(section ? `${section}: ${message}` : message);
    this.name = "TsplatError";
    /** @type {string | undefined} */
    this.section = section;
    /** @type {number | undefined} */
    this.offset = offset;
  }
}

/**
 * @param {boolean} condition
 * @param {string} message
 * @param {string} [section]
 * @param {number} [offset]
 * @returns {asserts condition}
 */
export function require(condition, message, section, offset) {
  if (!condition) throw new TsplatError(message, section, offset);
}
