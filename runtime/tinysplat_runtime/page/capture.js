// A capture of which the views near the camera are held, fetched and decoded as they are needed: of the nearest all
// Gaussians, of others their coarse surfaces (near.js), so that memory does not grow with how many photos there are.
import { makeCloud } from "./cloud.js";
import { AROUND, DRAWN } from "./near.js";
import { sceneOf } from "./scene.js";

const KEPT = 6; // views that are held whole: the nearest, which are drawn, and those that were just left

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
  cameras; decodeView; show; isComplete; failed; whole; coarse; order; isStopped; first; scene;
  // cameras: of all views. decodeView(v): a scene of tsplat.js with that view alone. show(scene, cloud): called whenever
  // there is more to see; isComplete(whether): whether all is there that shows from here.
  constructor(cameras, { decodeView, show, isComplete, failed }) {
    Object.assign(this, { cameras, decodeView, show, isComplete, failed, whole: new Map(), coarse: new Map(), order: [], isStopped: false });
  }

  // Views, nearest first, from where the camera is.
  look(order) {
    this.order = order;
    if (!this.isRunning && this.#next() !== undefined) this.run();
  }

  stop() { this.isStopped = true; }

  #next() {
    return this.order.slice(0, DRAWN).find((v) => !this.whole.has(v)) ?? this.order.slice(0, AROUND).find((v) => !this.coarse.has(v));
  }

  // Until all that shows is there.
  async run() {
    this.isRunning = true;
    this.isComplete(false);
    try {
      for (let v; !this.isStopped && (v = this.#next()) !== undefined;) {
        const isWhole = this.order.indexOf(v) < DRAWN, isFirst = !this.first;
        await this.#take(v, isWhole);
        if (this.isStopped) return;
        const next = this.#next(), isNear = (view) => this.order.indexOf(view) < DRAWN;
        if (isFirst || next === undefined || (isWhole && !isNear(next))) this.#tell();
      }
      this.isComplete(true);
    } catch (error) {
      this.failed(error);
    }
    this.isRunning = false;
  }

  async #take(v, isWhole) {
    const scene = sceneOf(await this.decodeView(v), this.cameras, this.frame, [v]), cloud = makeCloud(scene);
    this.frame = scene.frame;
    const { views, up, reach, nearPlane, frame, hasCameras, functions } = scene;
    this.scene ??= { views, up, reach, nearPlane, frame, hasCameras, functions };
    // What is said of the scene is the first view's: places would be in another order with every view that comes.
    const { viewCount, logSteps, depth, spread, nearest, farthest, ground } = cloud;
    this.first ??= { functions, viewCount, logSteps, depth, spread, nearest, farthest, ground };
    if (!this.coarse.has(v)) this.coarse.set(v, pieceOf(cloud, v, cloud.parts.flatMap(({ coarse }) => coarse)));
    if (!isWhole) return;
    this.whole.set(v, pieceOf(cloud, v));
    const kept = this.order.filter((view) => this.whole.has(view)).slice(0, KEPT);
    for (const view of [...this.whole.keys()]) if (!kept.includes(view)) this.whole.delete(view);
  }

  #tell() {
    const rest = [...this.coarse.keys()].filter((v) => !this.whole.has(v));
    const pieces = [...[...this.whole.values()], ...rest.map((v) => this.coarse.get(v))];
    this.show(this.scene, together({ ...this.first, held: new Set(this.whole.keys()) }, pieces));
  }
}
