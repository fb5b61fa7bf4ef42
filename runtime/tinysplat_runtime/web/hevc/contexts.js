/** Context variables of I slices (initType 0) and their initial values: Rec. ITU-T H.265, tables 9-5 to 9-37. */

/** Index of the first context of each syntax element. */
export const SAO_MERGE = 0;
export const SAO_TYPE = 1;
export const SPLIT_CU = 2;
export const PART_MODE = 5;
export const PREV_INTRA = 6;
export const CHROMA_MODE = 7;
export const SPLIT_TRANSFORM = 8;
export const CBF_LUMA = 11;
export const CBF_CHROMA = 13;
export const QP_DELTA = 17;
export const LAST_X = 19;
export const LAST_Y = 37;
export const SUB_BLOCK = 55;
export const SIGNIFICANT = 59;
export const GREATER1 = 101;
export const GREATER2 = 125;

/** What of `GREATER1`, `GREATER2`, `SIGNIFICANT` and `SUB_BLOCK` belongs to chroma comes behind so many of luma. */
export const GREATER1_CHROMA = 16;
export const GREATER2_CHROMA = 4;
export const SIGNIFICANT_CHROMA = 27;
export const SUB_BLOCK_CHROMA = 2;

const LAST = [110, 110, 124, 125, 140, 153, 125, 127, 140, 109, 111, 143, 127, 111, 79, 108, 123, 63];

/** initValue by context. */
// prettier-ignore
export const INITIAL = Uint8Array.of(
  153, 200, 139, 141, 157, 184, 184, 63, 153, 138, 138, 111, 141, 94, 138, 182, 154, 154, 154, ...LAST, ...LAST,
  91, 171, 134, 141, 111, 111, 125, 110, 110, 94, 124, 108, 124, 107, 125, 141, 179, 153, 125, 107, 125, 141, 179, 153,
  125, 107, 125, 141, 179, 153, 125, 140, 139, 182, 182, 152, 136, 152, 136, 153, 136, 139, 111, 136, 139, 111,
  140, 92, 137, 138, 140, 152, 138, 139, 153, 74, 149, 92, 139, 107, 122, 152, 140, 179, 166, 182, 140, 227, 122, 197,
  138, 153, 136, 167, 152, 152,
);
