/** A picture of one I slice: Rec. ITU-T H.265, clauses 7.3.8.1 to 7.3.8.10, 8.4.2, 8.4.3 and 8.6.1. */
import { TsplatError, require } from "../errors.js";
import { Cabac } from "./cabac.js";
import {
  CBF_CHROMA,
  CBF_LUMA,
  CHROMA_MODE,
  INITIAL,
  PART_MODE,
  PREV_INTRA,
  QP_DELTA,
  SAO_MERGE,
  SAO_TYPE,
  SPLIT_CU,
  SPLIT_TRANSFORM,
} from "./contexts.js";
import { BAND, EDGE, SAO_FIELDS, chromaQp, deblock, offsetSamples } from "./filters.js";
import { ACROSS, DC, DOWN, PLANAR, Plane, predict } from "./intra.js";
import { readParameterSets, readSlice } from "./parameters.js";
import { Coefficients } from "./residual.js";
import { addCosines, addSines } from "./transform.js";

const LAST_MODE = 34;

/** Decodes pictures of one size and format, one at a time. */
export class PictureDecoder {
  /**
   * @param {Uint8Array} parameterSets with start codes
   * @param {number} width of the coded picture
   * @param {number} height
   * @param {number} chroma 0: luma alone, 1: 4:2:0
   * @param {number} bits of a sample
   */
  constructor(parameterSets, width, height, chroma, bits) {
    const { sps, pps } = readParameterSets(parameterSets);
    const found = `${sps.width - sps.left - sps.right}x${sps.height - sps.top - sps.bottom}`;
    require(found === `${width}x${height}`, `pictures of ${found}, expected ${width}x${height}`, "HEVC");
    require(sps.chroma === chroma && sps.bits === bits, "pictures of another format than FORMAT.md has", "HEVC");
    this.sps = sps;
    this.pps = pps;
    this.cabac = new Cabac();
    this.block = new Coefficients(bits);
    this.planes = [new Plane(sps.width, sps.height, 2, bits, false)];
    if (chroma) for (let i = 0; i < 2; i++) this.planes.push(new Plane(sps.width / 2, sps.height / 2, 1, bits, true));
    const [across4, down4] = [sps.width >> 2, sps.height >> 2];
    const [across8, down8] = [sps.width >> 3, sps.height >> 3];
    this.across4 = across4;
    this.across8 = across8;
    this.done = new Uint8Array(across4 * down4);
    this.modes = new Uint8Array(across4 * down4);
    this.depths = new Uint8Array(across8 * down8);
    this.edges = {
      vertical: new Uint8Array(across8 * down4),
      horizontal: new Uint8Array(across4 * down8),
      qps: new Int8Array(across8 * down8),
      betaOffset: 0,
      tcOffset: 0,
    };
    this.ctbsAcross = Math.ceil(sps.width / 2 ** sps.log2Ctb);
    this.ctbsDown = Math.ceil(sps.height / 2 ** sps.log2Ctb);
    this.sao = this.planes.map(() => new Int8Array(this.ctbsAcross * this.ctbsDown * SAO_FIELDS));
    this.qp = 0;
    /** Of the last coding unit, and what the quantisation group under way is predicted to have. */
    this.lastQp = 0;
    this.predictedQp = 0;
    this.isDeltaRead = false;
    this.chromaOffsets = [0, 0];
    /** Of the coding unit under way: IntraPredModeC, and whether it has four parts. */
    this.chromaMode = 0;
    this.isSplit = false;
  }

  /**
   * Decode one picture.
   *
   * @param {Uint8Array} unit its slice NAL unit, without start code
   * @returns {Plane[]} good until the next call
   */
  decode(unit) {
    const slice = readSlice(unit, this.sps, this.pps);
    this.cabac.start(slice.data, INITIAL, slice.qp);
    this.block.clear();
    this.done.fill(0);
    this.depths.fill(0);
    this.edges.vertical.fill(0);
    this.edges.horizontal.fill(0);
    this.qp = this.lastQp = this.predictedQp = slice.qp;
    this.chromaOffsets = [slice.cbOffset, slice.crOffset];
    this.decodeTrees(slice);
    this.filter(slice);
    return this.planes;
  }

  /**
   * slice_segment_data() (7.3.8.1).
   *
   * @param {import("./parameters.js").Slice} slice
   */
  decodeTrees(slice) {
    const { log2Ctb } = this.sps;
    const count = this.ctbsAcross * this.ctbsDown;
    for (let ctb = 0; ctb < count; ctb++) {
      const column = ctb % this.ctbsAcross;
      const row = (ctb - column) / this.ctbsAcross;
      if (slice.saoLuma || slice.saoChroma) this.readSao(slice, ctb, column, row);
      this.codingQuadtree(column << log2Ctb, row << log2Ctb, log2Ctb, 0);
      const isEnd = this.cabac.terminate() === 1;
      require(isEnd === (ctb === count - 1), "a slice ends before or behind its picture", "picture", this.cabac.at);
    }
  }

  /** @param {import("./parameters.js").Slice} slice */
  filter(slice) {
    const { planes, edges, sps } = this;
    if (slice.deblock) {
      edges.betaOffset = slice.betaOffset;
      edges.tcOffset = slice.tcOffset;
      planes.forEach((plane, i) => deblock(plane, edges, [0, this.pps.cbOffset, this.pps.crOffset][i]));
    }
    planes.forEach((plane, i) => {
      if (i === 0 ? slice.saoLuma : slice.saoChroma) offsetSamples(plane, this.sao[i], sps.log2Ctb - (i === 0 ? 0 : 1));
    });
  }

  /**
   * sao() of a coding tree unit (7.3.8.3).
   *
   * @param {import("./parameters.js").Slice} slice
   * @param {number} ctb
   * @param {number} column
   * @param {number} row
   */
  readSao(slice, ctb, column, row) {
    const { cabac, sao } = this;
    const at = ctb * SAO_FIELDS;
    let from = -1;
    if (column > 0 && cabac.bin(SAO_MERGE)) from = at - SAO_FIELDS;
    else if (row > 0 && cabac.bin(SAO_MERGE)) from = at - SAO_FIELDS * this.ctbsAcross;
    for (let i = 0; i < this.planes.length; i++) {
      const fields = sao[i];
      if (from >= 0) {
        fields.copyWithin(at, from, from + SAO_FIELDS);
        continue;
      }
      fields.fill(0, at, at + SAO_FIELDS);
      if (!(i === 0 ? slice.saoLuma : slice.saoChroma)) continue;
      if (i < 2) fields[at] = cabac.bin(SAO_TYPE) ? (cabac.bypass() ? EDGE : BAND) : 0;
      else fields[at] = sao[1][at];
      if (fields[at]) this.readOffsets(fields, at, i);
    }
  }

  /**
   * @param {Int8Array} fields
   * @param {number} at
   * @param {number} component
   */
  readOffsets(fields, at, component) {
    const { cabac } = this;
    const most = (1 << (Math.min(this.sps.bits, 10) - 5)) - 1;
    for (let k = 2; k < SAO_FIELDS; k++) {
      let value = 0;
      while (value < most && cabac.bypass()) value++;
      fields[at + k] = value;
    }
    if (fields[at] === BAND) {
      for (let k = 2; k < SAO_FIELDS; k++) if (fields[at + k] && cabac.bypass()) fields[at + k] *= -1;
      fields[at + 1] = cabac.bypasses(5);
    } else {
      fields[at + 1] = component === 2 ? this.sao[1][at + 1] : cabac.bypasses(2);
      fields[at + 4] *= -1;
      fields[at + 5] *= -1;
    }
  }

  /**
   * coding_quadtree() (7.3.8.4).
   *
   * @param {number} x0
   * @param {number} y0
   * @param {number} log2
   * @param {number} depth cqtDepth
   */
  codingQuadtree(x0, y0, log2, depth) {
    const { sps, pps, depths, across8 } = this;
    const side = 1 << log2;
    let isSplit = log2 > sps.log2MinCb;
    if (isSplit && x0 + side <= sps.width && y0 + side <= sps.height) {
      const at = (y0 >> 3) * across8 + (x0 >> 3);
      const left = x0 > 0 && depths[at - 1] > depth ? 1 : 0;
      const above = y0 > 0 && depths[at - across8] > depth ? 1 : 0;
      isSplit = this.cabac.bin(SPLIT_CU + left + above) === 1;
    }
    if (pps.qpDelta && log2 >= sps.log2Ctb - pps.qpDepth) this.startQpGroup(x0, y0);
    if (!isSplit) {
      this.codingUnit(x0, y0, log2, depth);
      return;
    }
    const half = side >> 1;
    for (let i = 0; i < 4; i++) {
      const x = x0 + (i & 1) * half;
      const y = y0 + (i >> 1) * half;
      if (x < sps.width && y < sps.height) this.codingQuadtree(x, y, log2 - 1, depth + 1);
    }
  }

  /**
   * A new quantisation group, and the QP that is predicted for it (8.6.1).
   *
   * @param {number} x
   * @param {number} y
   */
  startQpGroup(x, y) {
    const inside = (1 << this.sps.log2Ctb) - 1;
    const at = (y >> 3) * this.across8 + (x >> 3);
    const { qps } = this.edges;
    const left = x & inside ? qps[at - 1] : this.lastQp;
    const above = y & inside ? qps[at - this.across8] : this.lastQp;
    this.predictedQp = (left + above + 1) >> 1;
    this.qp = this.predictedQp;
    this.isDeltaRead = false;
  }

  /**
   * coding_unit() of an intra unit (7.3.8.5).
   *
   * @param {number} x0
   * @param {number} y0
   * @param {number} log2
   * @param {number} depth
   */
  codingUnit(x0, y0, log2, depth) {
    const { cabac, sps, modes, across4 } = this;
    this.isSplit = log2 === sps.log2MinCb && cabac.bin(PART_MODE) === 0;
    const parts = this.isSplit ? 4 : 1;
    const side = 1 << (this.isSplit ? log2 - 1 : log2);
    let flags = 0;
    for (let i = 0; i < parts; i++) flags |= cabac.bin(PREV_INTRA) << i;
    for (let i = 0; i < parts; i++) {
      const x = x0 + (i & 1) * side;
      const y = y0 + (i >> 1) * side;
      const mode = this.lumaMode(x, y, (flags >> i) & 1);
      const units = side >> 2;
      const first = (y >> 2) * across4 + (x >> 2);
      for (let row = 0; row < units; row++) modes.fill(mode, first + row * across4, first + row * across4 + units);
    }
    if (sps.chroma) this.chromaMode = this.readChromaMode(modes[(y0 >> 2) * across4 + (x0 >> 2)]);
    this.transformTree(x0, y0, x0, y0, log2, 0, 0, 3);
    this.lastQp = this.qp;
    const units = 1 << (log2 - 3);
    for (let row = 0; row < units; row++) {
      const at = ((y0 >> 3) + row) * this.across8 + (x0 >> 3);
      this.depths.fill(depth, at, at + units);
      this.edges.qps.fill(this.qp, at, at + units);
    }
  }

  /**
   * IntraPredModeY of a part (8.4.2).
   *
   * @param {number} x
   * @param {number} y
   * @param {number} isPredicted prev_intra_luma_pred_flag
   */
  lumaMode(x, y, isPredicted) {
    const { cabac, modes, across4 } = this;
    const at = (y >> 2) * across4 + (x >> 2);
    const a = x > 0 ? modes[at - 1] : DC;
    const b = y & ((1 << this.sps.log2Ctb) - 1) ? modes[at - across4] : DC;
    let first = a;
    let second = b;
    let third = PLANAR;
    if (a === b) {
      first = a < 2 ? PLANAR : a;
      second = a < 2 ? DC : 2 + ((a + 29) & 31);
      third = a < 2 ? DOWN : 2 + ((a - 1) & 31);
    } else if (a === PLANAR || b === PLANAR) {
      third = a === DC || b === DC ? DOWN : DC;
    }
    if (isPredicted) return cabac.bypass() ? (cabac.bypass() ? third : second) : first;
    const low = Math.min(first, second, third);
    const high = Math.max(first, second, third);
    let mode = cabac.bypasses(5);
    if (mode >= low) mode++;
    if (mode >= first + second + third - low - high) mode++;
    if (mode >= high) mode++;
    return mode;
  }

  /**
   * IntraPredModeC (8.4.3, table 8-2).
   *
   * @param {number} luma
   */
  readChromaMode(luma) {
    const { cabac } = this;
    if (!cabac.bin(CHROMA_MODE)) return luma;
    const mode = [PLANAR, DOWN, ACROSS, DC][cabac.bypasses(2)];
    return mode === luma ? LAST_MODE : mode;
  }

  /**
   * transform_tree() (7.3.8.8).
   *
   * @param {number} x0
   * @param {number} y0
   * @param {number} xBase of the parent
   * @param {number} yBase
   * @param {number} log2
   * @param {number} depth trafoDepth
   * @param {number} part blkIdx
   * @param {number} parentCbf 1: Cb, 2: Cr has coefficients in the parent
   */
  transformTree(x0, y0, xBase, yBase, log2, depth, part, parentCbf) {
    const { cabac, sps } = this;
    const mustSplit = log2 > sps.log2MaxTb || (this.isSplit && depth === 0);
    let isSplit = mustSplit;
    const most = sps.maxDepth + (this.isSplit ? 1 : 0);
    if (!mustSplit && log2 > sps.log2MinTb && depth < most) isSplit = cabac.bin(SPLIT_TRANSFORM + 5 - log2) === 1;
    let cbf = 0;
    if (sps.chroma) {
      cbf = parentCbf;
      if (log2 > 2) {
        if (parentCbf & 1) cbf = cabac.bin(CBF_CHROMA + depth) | (cbf & 2);
        if (parentCbf & 2) cbf = (cbf & 1) | (cabac.bin(CBF_CHROMA + depth) << 1);
      }
    }
    if (!isSplit) {
      this.transformUnit(x0, y0, xBase, yBase, log2, depth, part, cbf);
      return;
    }
    const half = 1 << (log2 - 1);
    for (let i = 0; i < 4; i++) {
      this.transformTree(x0 + (i & 1) * half, y0 + (i >> 1) * half, x0, y0, log2 - 1, depth + 1, i, cbf);
    }
  }

  /**
   * transform_unit() (7.3.8.10), with prediction and reconstruction of its blocks.
   *
   * @param {number} x0
   * @param {number} y0
   * @param {number} xBase
   * @param {number} yBase
   * @param {number} log2
   * @param {number} depth
   * @param {number} part
   * @param {number} cbfChroma
   */
  transformUnit(x0, y0, xBase, yBase, log2, depth, part, cbfChroma) {
    const cbf = this.cabac.bin(CBF_LUMA + (depth === 0 ? 1 : 0));
    if ((cbf || cbfChroma) && this.pps.qpDelta && !this.isDeltaRead) this.readQpDelta();
    this.markEdges(x0, y0, log2);
    const mode = this.modes[(y0 >> 2) * this.across4 + (x0 >> 2)];
    predict(this.planes[0], this.done, x0, y0, log2, mode, this.sps.strongSmoothing);
    if (cbf) this.addResidual(0, x0, y0, log2, mode);
    const units = 1 << (log2 - 2);
    for (let row = 0; row < units; row++) {
      const at = ((y0 >> 2) + row) * this.across4 + (x0 >> 2);
      this.done.fill(1, at, at + units);
    }
    if (!this.sps.chroma || (log2 === 2 && part < 3)) return;
    const isLeast = log2 === 2; // four blocks of luma have one of chroma
    const x = (isLeast ? xBase : x0) >> 1;
    const y = (isLeast ? yBase : y0) >> 1;
    const size = isLeast ? 2 : log2 - 1;
    for (let i = 1; i < 3; i++) {
      predict(this.planes[i], this.done, x, y, size, this.chromaMode, false);
      if (cbfChroma & i) this.addResidual(i, x, y, size, this.chromaMode);
    }
  }

  /**
   * @param {number} x0
   * @param {number} y0
   * @param {number} log2
   */
  markEdges(x0, y0, log2) {
    const { vertical, horizontal } = this.edges;
    const units = 1 << (log2 - 2);
    if ((x0 & 7) === 0) {
      for (let i = 0; i < units; i++) vertical[((y0 >> 2) + i) * this.across8 + (x0 >> 3)] = 1;
    }
    if ((y0 & 7) === 0) {
      const at = (y0 >> 3) * this.across4 + (x0 >> 2);
      horizontal.fill(1, at, at + units);
    }
  }

  /** cu_qp_delta_abs, its sign, and QpY (7.3.8.14, 9.3.3.10, 8.6.1). */
  readQpDelta() {
    const { cabac } = this;
    let value = 0;
    while (value < 5 && cabac.bin(QP_DELTA + (value > 0 ? 1 : 0))) value++;
    if (value === 5) {
      let k = 0;
      while (cabac.bypass()) {
        value += 1 << k;
        if (++k > 6) throw new TsplatError("a QP delta is out of range", "picture", cabac.at);
      }
      value += cabac.bypasses(k);
    }
    if (value && cabac.bypass()) value = -value;
    this.isDeltaRead = true;
    const offset = 6 * (this.sps.bits - 8);
    const isInRange = value >= -(26 + offset / 2) && value <= 25 + offset / 2;
    require(isInRange, "a QP delta is out of range", "picture", cabac.at);
    this.qp = ((this.predictedQp + value + 52 + 2 * offset) % (52 + offset)) - offset;
  }

  /**
   * Coefficients of a block, transformed and added (8.6.2).
   *
   * @param {number} component
   * @param {number} x
   * @param {number} y
   * @param {number} log2
   * @param {number} mode
   */
  addResidual(component, x, y, log2, mode) {
    const { block, sps } = this;
    const plane = this.planes[component];
    const isChroma = component > 0;
    const offset = 6 * (sps.bits - 8);
    let scan = 0;
    if (log2 === 2 || (log2 === 3 && !isChroma)) scan = mode >= 6 && mode <= 14 ? 2 : mode >= 22 && mode <= 30 ? 1 : 0;
    let qp = this.qp;
    if (isChroma) qp = chromaQp(Math.min(Math.max(qp + this.chromaOffsets[component - 1], -offset), 57));
    block.read(this.cabac, log2, isChroma, scan, qp + offset, this.pps.signHiding);
    const start = y * plane.width + x;
    if (log2 === 2 && !isChroma) addSines(block, plane.samples, start, plane.width);
    else addCosines(block, log2, plane.samples, start, plane.width);
    block.clear();
  }
}
