// Where a scene is good to look at: near the places that its photos were taken from, and between them. docs/lab/page.md
// has the curves that SIDE was chosen by.
import { add, between, clamp, dot, length, mix, scaled } from "./vectors.js";

// Of the depth, to any side of the views' hull, over the root of how far inverse depths spread beside their mean.
const SIDE = 0.035;
const LEAST_SIDE = 0.02; // of the depth
const MOST_SIDE = 0.12;
const AHEAD = 2.5; // times as far: coming closer uncovers little
const LOOK = 0.08; // of a picture's half, that the middle of the window may leave what the picture shows
const ELASTIC = 0.35; // of a bound, that a hand may pull beyond it
const NEIGHBOURS = 3; // nearest views that each of many is joined to
const ALL_JOINED = 4; // views up to which all are joined to all
const FARTHEST = 0.3; // in depths: between views farther apart surfaces fray, so that one flies there and does not stay
const TURN = 0.5; // of directions beside places (in depths), where neighbours are looked for
const ALONG = 0.3; // cosine to a pull, from which a view lies that way
const LEAST_STEP = 0.005; // in depths: views that are no nearer to the foot
const TIE = 0.02; // and where the nearest part of the hull is: they decide between equals

// Views in the order of a walk: always on to the nearest that is left.
export function walk(views, depth) {
  const left = views.map((_, v) => v);
  const order = left.splice(0, 1);
  while (left.length) {
    const last = views[order.at(-1)];
    const far = left.map((v) => apart(last, views[v], depth));
    order.push(...left.splice(far.indexOf(Math.min(...far)), 1));
  }
  return order;
}

// The way from b to a, six numbers: of places in depths, and of directions times `turn`.
const wayTo = (a, b, depth, turn) => [
  ...scaled(add(a.position, b.position, -1), 1 / depth),
  ...scaled(add(a.rotation[2], b.rotation[2], -1), turn),
];
const product = (a, b) => a.reduce((sum, value, k) => sum + value * b[k], 0);
const apart = (a, b, depth) => Math.hypot(...wayTo(a, b, depth, TURN));

function joined(views, depth) {
  if (views.length === 1) return [[0, 0]];
  const edges = [];
  views.forEach((view, i) => {
    const others = views
      .map((other, j) => [apart(view, other, depth), j])
      .filter(([, j]) => j !== i)
      .sort((a, b) => a[0] - b[0]);
    const isMany = views.length > ALL_JOINED;
    const near = isMany ? others.slice(0, NEIGHBOURS).filter(([far]) => far <= FARTHEST) : others;
    for (const [, j] of near) if (i < j || isMany) edges.push([i, j]);
    if (!near.length) edges.push([i, i]);
  });
  return edges;
}

// The view that lies where a camera has been pulled to from its foot on the hull, the nearest of those that do; -1
// where none does.
export function onward(views, depth, camera, foot) {
  const wanted = wayTo(camera, foot, depth, TURN);
  const size = Math.hypot(...wanted);
  let least = Infinity;
  let found = -1;
  views.forEach((view, v) => {
    const way = wayTo(view, foot, depth, TURN);
    const far = Math.hypot(...way);
    const along = product(way, wanted);
    if (along > ALONG * far * size && far > LEAST_STEP && (far * far) / along < least)
      [least, found] = [(far * far) / along, v];
  });
  return found;
}

// A way between two views, a share t along it.
export function poseBetween(a, b, t) {
  const view = t < 0.5 ? a : b;
  const isAlike = a.width === b.width && a.height === b.height;
  const K = isAlike ? a.K.map((value, i) => value * (1 - t) + b.K[i] * t) : view.K;
  return {
    K,
    width: view.width,
    height: view.height,
    position: mix(a.position, b.position, t),
    rotation: between(a.rotation, b.rotation, t),
  };
}

export class Bound {
  views;
  depth;
  edges;
  // views in page units; depth and spread of their surfaces (cloud.js).
  constructor(views, depth, spread) {
    this.side = depth * clamp(SIDE / Math.sqrt(spread), LEAST_SIDE, MOST_SIDE);
    Object.assign(this, { views, depth, edges: joined(views, depth) });
    this.width =
      this.side + Math.max(...this.edges.map(([i, j]) => length(add(views[i].position, views[j].position, -1)))) / 2;
  }

  // The pose on the hull, which is made of ways between views, that is nearest to a camera.
  foot(camera) {
    let least = Infinity;
    let found;
    for (const [i, j] of this.edges) {
      const [a, b] = [this.views[i], this.views[j]];
      const way = wayTo(b, a, this.depth, TIE);
      const off = wayTo(camera, a, this.depth, TIE);
      const t = clamp(product(way, off) / (product(way, way) || 1), 0, 1);
      const far = Math.hypot(...off.map((value, k) => value - t * way[k]));
      if (far < least) [least, found] = [far, [a, b, t]];
    }
    return poseBetween(...found);
  }

  // How far a camera is from its foot, 1 at the bound.
  strain(camera, foot = this.foot(camera)) {
    const off = add(camera.position, foot.position, -1);
    const ahead = dot(off, foot.rotation[2]);
    const aside = length(add(off, foot.rotation[2], -ahead));
    return Math.hypot(aside, ahead / (ahead > 0 ? AHEAD : 1)) / this.side;
  }

  // Pulls a camera back to a strain of `most` in place.
  pull(camera, most) {
    const foot = this.foot(camera);
    const strain = this.strain(camera, foot);
    if (strain > most) camera.position = mix(foot.position, camera.position, most / strain);
  }

  // How far the middle of a window has left what its foot's picture shows, in pixels of that picture, x and y.
  stray(camera, width, height) {
    const foot = this.foot(camera);
    const [fx, skew, fy, cx, cy] = foot.K;
    const point = add(
      add(camera.position, camera.ray(width / 2, height / 2, width, height), this.depth),
      foot.position,
      -1,
    );
    const z = dot(foot.rotation[2], point);
    const y = dot(foot.rotation[1], point) / z;
    const x = dot(foot.rotation[0], point) / z;
    const scale = Math.min(width / camera.width, height / camera.height) * camera.zoom;
    const beyond = (at, whole, shown) =>
      at - clamp(at, ...[-1, 1].map((s) => whole / 2 + (s * (Math.max(whole - shown / scale, 0) + LOOK * whole)) / 2));
    return [beyond(fx * x + skew * y + cx, foot.width, width) / fx, beyond(fy * y + cy, foot.height, height) / fy];
  }
}

// What is left of a pull from one strain to another: all within the bound, less and less beyond it.
export function elastic(before, after) {
  const from = Math.max(before, 1);
  if (after <= from) return after;
  const give = Math.max(1 - (from - 1) / ELASTIC, 0);
  return from + ELASTIC * give * (1 - Math.exp(-(after - from) / ELASTIC)); // never reaches 1 + ELASTIC
}

// What is left of the light at a strain.
export function lightAt(strain) {
  const t = clamp((strain - 1) / ELASTIC, 0, 1);
  return 1 - 0.6 * t * t * (3 - 2 * t);
}
