// A capture of which the views near the camera are held, fetched and decoded as they are needed: of the nearest all
// Gaussians, of others their coarse surfaces (near.js), so that memory does not grow with how many photos there are.
import { makeCloud } from "./cloud.js";
import { DRAWN } from "./near.js";
import { sceneOf } from "./scene.js";

const SHOWN = 2 * DRAWN; // views that are shown whole: those of the place that one is at, and of the place that one goes to
const MOST_KEPT = 4e6; // Gaussians of whole views that are held, if these are more

// Gaussians `picked` (all where none are) of a cloud of one view.
function pieceOf({ means, opacities, geometry, colours, functions, parts }, view, picked) {
  const n = picked ? picked.length : opacities.length;
  const some = (array, words) => {
    if (!picked) return array;
    const out = new array.constructor(words * n);
    picked.forEach((from, to) => out.set(array.subarray(words * from, words * (from + 1)), words * to));
    return out;
  };
  return {
    count: n, means: some(means, 3), opacities: some(opacities, 1), geometry: some(geometry, 8), colours: some(colours, 2 * functions),
    parts: picked ? [{ view, isFront: true, from: 0, to: 0, coarse: picked.map((_, i) => i) }] : parts,
  };
}

// Pieces one behind the other, with what `first` says of the scene.
function together(first, pieces) {
  const count = pieces.reduce((sum, piece) => sum + piece.count, 0), parts = [];
  const out = { means: new Float32Array(3 * count), opacities: new Float32Array(count), geometry: new Uint32Array(8 * count), colours: new Uint32Array(2 * first.functions * count) };
  let at = 0;
  for (const piece of pieces) {
    for (const name of Object.keys(out)) out[name].set(piece[name], at * (out[name].length / count));
    for (const part of piece.parts) parts.push({ ...part, from: part.from + at, to: part.to + at, coarse: part.coarse.map((i) => i + at) });
    at += piece.count;
  }
  return { ...first, ...out, count, parts };
}

export class Capture {
  cameras; decodeView; show; isComplete; failed; whole; coarse; shown; wanted; isStopped; first; scene;
  // cameras: of all views. decodeView(v): a scene of tsplat.js with that view alone. show(scene, cloud): called whenever
  // there is more to see; isComplete(whether): whether all is there that shows from here.
  constructor(cameras, { decodeView, show, isComplete, failed }) {
    Object.assign(this, {
      cameras, decodeView, show, isComplete, failed, whole: new Map(), coarse: new Map(), isStopped: false,
      shown: { held: new Set(), surfaces: new Set() }, wanted: { whole: [], coarse: [], ahead: [] },
    });
  }

  // Fetch order: views `whole`, views' `coarse` surfaces, then whole views `ahead`.
  look(wanted) {
    this.wanted = wanted;
    if (this.first) this.#tell();
    if (!this.isRunning && this.#next() !== undefined) this.#run();
  }

  stop() { this.isStopped = true; }

  get #missing() {
    const { whole, coarse } = this.wanted;
    return whole.find((v) => !this.whole.has(v)) ?? coarse.find((v) => !this.coarse.has(v));
  }

  #next() { return this.#missing ?? this.wanted.ahead.slice(0, SHOWN).find((v) => !this.whole.has(v) && !this.coarse.has(v)); }

  // Until all that shows is there.
  async #run() {
    this.isRunning = true;
    try {
      for (let v; !this.isStopped && (v = this.#next()) !== undefined;) {
        if (this.#missing !== undefined) this.isComplete(false);
        await this.#take(v);
        if (this.isStopped) return;
        this.#tell();
        if (this.#missing === undefined) this.isComplete(true);
      }
      this.isComplete(true);
    } catch (error) {
      this.failed(error);
    }
    this.isRunning = false;
  }

  async #take(v) {
    const scene = sceneOf(await this.decodeView(v), this.cameras, this.frame, [v]), cloud = makeCloud(scene);
    this.frame = scene.frame;
    const { views, up, reach, nearPlane, frame, hasCameras, functions } = scene;
    this.scene ??= { views, up, reach, nearPlane, frame, hasCameras, functions };
    // What is said of the scene is the first view's: places would be in another order with every view that comes.
    const { viewCount, logSteps, depth, spread, nearest, farthest, ground } = cloud;
    this.first ??= { functions, viewCount, logSteps, depth, spread, nearest, farthest, ground };
    if (!this.coarse.has(v)) this.coarse.set(v, pieceOf(cloud, v, cloud.parts.flatMap(({ coarse }) => coarse)));
    this.whole.set(v, pieceOf(cloud, v));
    let sum = 0;
    this.#byUse().forEach((view, at) => {
      sum += this.whole.get(view).count;
      if (at >= SHOWN && sum > MOST_KEPT) this.whole.delete(view);
    });
  }

  // Views that are held whole, those that are wanted first.
  #byUse() {
    const { whole, coarse, ahead } = this.wanted;
    return [...new Set([...whole, ...ahead, ...coarse, ...this.whole.keys()])].filter((v) => this.whole.has(v));
  }

  // Shows what is wanted and not shown yet, and when all of that is there.
  #tell() {
    const held = new Set(this.#byUse().slice(0, SHOWN)), { shown } = this, { whole, coarse } = this.wanted;
    const lacks = (views, has, is) => views.some((v) => has.has(v) && !is.has(v));
    const isNew = !shown.held.size || (whole.every((v) => this.whole.has(v)) && lacks(whole, held, shown.held));
    if (!isNew && !(this.#missing === undefined && lacks(coarse, this.coarse, shown.surfaces))) return;
    const surfaces = new Set(this.coarse.keys()), rest = [...surfaces].filter((v) => !held.has(v));
    this.shown = { held, surfaces };
    this.show(this.scene, together({ ...this.first, held, surfaces }, [...[...held].map((v) => this.whole.get(v)), ...rest.map((v) => this.coarse.get(v))]));
  }
}
