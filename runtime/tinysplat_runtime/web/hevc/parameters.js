/**
 * Sequence and picture parameter sets and slice headers: Rec. ITU-T H.265, clauses 7.3.2.2, 7.3.2.3, 7.3.6.1 and E.2.1.
 *
 * The pictures of a `.tsplat` use a part of HEVC alone (FORMAT.md, section 3). What is outside of it is refused here, so
 * that the rest of the decoder need not know of it.
 */
import { require } from "../errors.js";
import { BitReader, unescaped } from "./bits.js";

const VPS_TYPE = 32;
const SPS_TYPE = 33;
const PPS_TYPE = 34;
const SLICE_TYPE_I = 2;
/** vps_base_layer_internal_flag and vps_base_layer_available_flag, and no other layer. */
const ONE_LAYER = 0xc0;

/** Syntax elements by shorter names. @typedef {ReturnType<typeof readSps>} Sps */
/** @typedef {ReturnType<typeof readPps>} Pps */
/** @typedef {ReturnType<typeof readSlice>} Slice */

/**
 * @param {BitReader} reader
 * @param {string} what
 */
function refused(reader, what) {
  require(!reader.flag(), `${what} is no part of HEVC as FORMAT.md has it`, "picture", reader.at >> 3);
}

/**
 * nal_unit_type of a unit of the base layer and lowest temporal layer (7.3.1.2).
 *
 * @param {Uint8Array} unit
 */
function nalType(unit) {
  require(unit[0] < 128 && (unit[0] & 1) === 0 && unit[1] === 1, "a NAL unit of another layer", "picture", 0);
  return unit[0] >> 1;
}

/**
 * NAL units behind start codes (B.2), by type; of several with one type the last.
 *
 * @param {Uint8Array} bytes
 */
function nalUnits(bytes) {
  /** @type {Map<number, Uint8Array>} */
  const units = new Map();
  require([0, 0, 0, 1].every((byte, i) => bytes[i] === byte), "parameter sets begin with a start code", "HEVC", 0);
  let start = -1;
  for (let i = 0; i <= bytes.length; i++) {
    const isStart = i + 2 < bytes.length && bytes[i] === 0 && bytes[i + 1] === 0 && bytes[i + 2] === 1;
    if (!isStart && i < bytes.length) continue;
    if (start >= 0) {
      let end = i;
      while (end > start && bytes[end - 1] === 0) end--; // trailing zeros belong to the next start code
      require(end >= start + 3, "an empty NAL unit among the parameter sets", "HEVC", start);
      const type = nalType(bytes.subarray(start, end));
      require(!units.has(type), `two parameter sets of type ${type}`, "HEVC", start);
      units.set(type, bytes.subarray(start, end));
    }
    start = i + 3;
    i += 2;
  }
  return units;
}

/**
 * profile_tier_level(1, maxSubLayersMinus1), of which nothing is needed (7.3.3).
 *
 * @param {BitReader} reader
 * @param {number} subLayers beyond the first
 */
function skipProfile(reader, subLayers) {
  reader.skip(96);
  const present = [];
  for (let i = 0; i < subLayers; i++) present.push(reader.bits(2));
  if (subLayers > 0) reader.skip(2 * (8 - subLayers));
  for (const flags of present) reader.skip((flags & 2 ? 88 : 0) + (flags & 1 ? 8 : 0));
}

/**
 * Sizes of the buffer of decoded pictures, of which nothing is needed (7.3.2.1, 7.3.2.2.1).
 *
 * @param {BitReader} reader
 * @param {number} subLayers beyond the first
 */
function skipOrdering(reader, subLayers) {
  for (let i = reader.flag() ? 0 : subLayers; i <= subLayers; i++) {
    reader.ue(reader.ue(15));
    reader.ue();
  }
}

/**
 * video_parameter_set_rbsp() (7.3.2.1): its number.
 *
 * @param {Uint8Array} unit
 */
function readVps(unit) {
  const reader = new BitReader(unescaped(unit).subarray(2));
  const id = reader.bits(4);
  const layers = reader.bits(8);
  const subLayers = reader.bits(3);
  reader.skip(1);
  require(layers === ONE_LAYER &&
    subLayers < 7 &&
    reader.bits(16) === 0xffff, "a video parameter set of layers", "HEVC");
  skipProfile(reader, subLayers);
  skipOrdering(reader, subLayers);
  reader.skip(6);
  require(reader.ue() === 0, "a video parameter set of layers", "HEVC");
  if (reader.flag()) {
    reader.skip(64);
    if (reader.flag()) reader.ue();
    require(reader.ue() === 0, "hrd_parameters are no part of HEVC as FORMAT.md has it", "HEVC");
  }
  refused(reader, "vps_extension");
  return id;
}

/**
 * vui_parameters(), of which nothing is needed (E.2.1).
 *
 * @param {BitReader} reader
 */
function skipVui(reader) {
  if (reader.flag() && reader.bits(8) === 255) reader.skip(32); // aspect ratio
  if (reader.flag()) reader.skip(1); // overscan
  if (reader.flag()) {
    reader.skip(4);
    if (reader.flag()) reader.skip(24);
  }
  if (reader.flag()) {
    reader.ue();
    reader.ue();
  }
  reader.skip(3);
  if (reader.flag()) for (let i = 0; i < 4; i++) reader.ue();
  if (reader.flag()) {
    reader.skip(64);
    if (reader.flag()) reader.ue();
    refused(reader, "vui_hrd_parameters");
  }
  if (reader.flag()) {
    reader.skip(3);
    for (let i = 0; i < 5; i++) reader.ue();
  }
}

/**
 * seq_parameter_set_rbsp() (7.3.2.2.1).
 *
 * @param {Uint8Array} unit
 */
function readSps(unit) {
  const reader = new BitReader(unescaped(unit).subarray(2));
  const vpsId = reader.bits(4);
  const subLayers = reader.bits(3);
  reader.skip(1);
  skipProfile(reader, subLayers);
  const id = reader.ue(15);
  const chroma = reader.ue(3); // 0: luma alone, 1: 4:2:0
  require(chroma <= 1, `chroma_format_idc ${chroma}, accepted are 0 and 1`, "HEVC");
  const width = reader.ue(1 << 17);
  const height = reader.ue(1 << 17);
  const window = [0, 0, 0, 0]; // samples cropped to the left, right, top and bottom
  if (reader.flag()) for (let i = 0; i < 4; i++) window[i] = reader.ue(1 << 16) << chroma;
  const bits = 8 + reader.ue(8);
  const chromaBits = 8 + reader.ue(8);
  require(bits === chromaBits || chroma === 0, `${bits} bits of luma and ${chromaBits} of chroma`, "HEVC");
  const log2Poc = reader.ue(12);
  skipOrdering(reader, subLayers);
  const log2MinCb = 3 + reader.ue(3);
  const log2Ctb = log2MinCb + reader.ue(3);
  const log2MinTb = 2 + reader.ue(3);
  const log2MaxTb = log2MinTb + reader.ue(3);
  const fits = log2Ctb >= 4 && log2Ctb <= 6 && log2MinTb < log2MinCb && log2MaxTb <= Math.min(log2Ctb, 5);
  require(fits, "block sizes of HEVC are out of range", "HEVC", reader.at >> 3);
  const isWhole = (width | height) % (1 << log2MinCb) === 0 && width > 0 && height > 0;
  require(isWhole, `a coded picture of ${width}x${height}`, "HEVC");
  reader.ue(4);
  const maxDepth = reader.ue(log2Ctb - log2MinTb);
  refused(reader, "scaling_list_enabled_flag");
  reader.skip(1);
  const sao = reader.flag() === 1;
  refused(reader, "pcm_enabled_flag");
  require(reader.ue(64) === 0, "short-term reference pictures are no part of HEVC as FORMAT.md has it", "HEVC");
  if (reader.flag()) {
    const count = reader.ue(32);
    reader.skip(count * (log2Poc + 4 + 1));
  }
  reader.skip(1);
  const strongSmoothing = reader.flag() === 1;
  if (reader.flag()) skipVui(reader);
  if (reader.flag()) require(reader.bits(8) === 0, "extensions of the sequence parameter set", "HEVC");
  const [left, right, top, bottom] = window;
  return {
    id,
    vpsId,
    chroma,
    width,
    height,
    left,
    right,
    top,
    bottom,
    bits,
    log2MinCb,
    log2Ctb,
    log2MinTb,
    log2MaxTb,
    maxDepth,
    sao,
    strongSmoothing,
  };
}

/**
 * pic_parameter_set_rbsp() (7.3.2.3.1); offsets of QP in steps of it.
 *
 * @param {Uint8Array} unit
 */
function readPps(unit) {
  const reader = new BitReader(unescaped(unit).subarray(2));
  const [id, spsId] = [reader.ue(63), reader.ue(15)];
  refused(reader, "dependent_slice_segments_enabled_flag");
  const outputFlag = reader.flag() === 1;
  const extraBits = reader.bits(3);
  const signHiding = reader.flag() === 1;
  reader.skip(1);
  reader.ue(14);
  reader.ue(14);
  const initQp = 26 + reader.se(26 + 24);
  reader.skip(1);
  refused(reader, "transform_skip_enabled_flag");
  const qpDelta = reader.flag() === 1;
  const qpDepth = qpDelta ? reader.ue(3) : 0;
  const cbOffset = reader.se(12);
  const crOffset = reader.se(12);
  const sliceChromaOffsets = reader.flag() === 1;
  reader.skip(2);
  refused(reader, "transquant_bypass_enabled_flag");
  refused(reader, "tiles_enabled_flag");
  refused(reader, "entropy_coding_sync_enabled_flag");
  const acrossSlices = reader.flag() === 1;
  let [deblockOverride, deblockDisabled, betaOffset, tcOffset] = [false, false, 0, 0];
  if (reader.flag()) {
    deblockOverride = reader.flag() === 1;
    deblockDisabled = reader.flag() === 1;
    if (!deblockDisabled) {
      betaOffset = 2 * reader.se(6);
      tcOffset = 2 * reader.se(6);
    }
  }
  refused(reader, "pps_scaling_list_data_present_flag");
  reader.skip(1);
  reader.ue(4);
  const headerExtension = reader.flag() === 1;
  if (reader.flag()) require(reader.bits(8) === 0, "extensions of the picture parameter set", "HEVC");
  return {
    id,
    spsId,
    extraBits,
    outputFlag,
    signHiding,
    initQp,
    qpDelta,
    qpDepth,
    cbOffset,
    crOffset,
    sliceChromaOffsets,
    acrossSlices,
    deblockOverride,
    deblockDisabled,
    betaOffset,
    tcOffset,
    headerExtension,
  };
}

/**
 * The parameter sets of a section `HEVC`.
 *
 * @param {Uint8Array} bytes with start codes
 */
export function readParameterSets(bytes) {
  const units = nalUnits(bytes);
  const [vps, spsUnit, ppsUnit] = [VPS_TYPE, SPS_TYPE, PPS_TYPE].map((type) => units.get(type));
  require(vps !== undefined && spsUnit !== undefined && ppsUnit !== undefined, "a parameter set is missing", "HEVC");
  const [sps, pps] = [readSps(spsUnit), readPps(ppsUnit)];
  require(pps.spsId === sps.id && sps.vpsId === readVps(vps), "parameter sets do not refer to each other", "HEVC");
  return { sps, pps };
}

/**
 * slice_segment_header() of an IDR picture of one I slice, and where its data begin (7.3.6.1).
 *
 * @param {Uint8Array} unit a NAL unit without start code
 * @param {Sps} sps
 * @param {Pps} pps
 */
export function readSlice(unit, sps, pps) {
  const type = unit.length > 2 ? nalType(unit) : -1;
  require(type === 19 || type === 20, "not a single HEVC intra slice", "picture");
  const bytes = unescaped(unit).subarray(2);
  const reader = new BitReader(bytes);
  require(reader.flag() === 1, "a slice that is not its picture's first", "picture");
  reader.skip(1);
  require(reader.ue(63) === pps.id, "a slice refers to another parameter set", "picture");
  reader.skip(pps.extraBits);
  require(reader.ue(2) === SLICE_TYPE_I, "a slice that is not intra", "picture");
  if (pps.outputFlag) reader.skip(1);
  const saoLuma = sps.sao && reader.flag() === 1;
  const saoChroma = sps.sao && sps.chroma > 0 && reader.flag() === 1;
  const qpOffset = 6 * (sps.bits - 8);
  const qp = pps.initQp + reader.se(51 + qpOffset);
  require(qp >= -qpOffset && qp <= 51, `QP ${qp} of a slice`, "picture");
  let [cbOffset, crOffset] = [pps.cbOffset, pps.crOffset];
  if (pps.sliceChromaOffsets) {
    cbOffset += reader.se(12);
    crOffset += reader.se(12);
    require(Math.abs(cbOffset) <= 12 && Math.abs(crOffset) <= 12, "QP offsets of chroma", "picture");
  }
  let { deblockDisabled, betaOffset, tcOffset } = pps;
  if (pps.deblockOverride && reader.flag()) {
    deblockDisabled = reader.flag() === 1;
    if (!deblockDisabled) {
      betaOffset = 2 * reader.se(6);
      tcOffset = 2 * reader.se(6);
    }
  }
  if (pps.acrossSlices && (saoLuma || saoChroma || !deblockDisabled)) reader.skip(1);
  if (pps.headerExtension) reader.skip(8 * reader.ue(256));
  require(reader.flag() === 1, "a slice header does not end as it should", "picture", reader.at >> 3);
  const data = bytes.subarray((reader.at + 7) >> 3);
  return { qp, saoLuma, saoChroma, cbOffset, crOffset, deblock: !deblockDisabled, betaOffset, tcOffset, data };
}
