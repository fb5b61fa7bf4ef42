// Where a page begins: front.py in JavaScript, which has the reasons.
import { add, cross, dot, length, scaled } from "./vectors.js";

const COLUMNS = 4; // of points in each picture
const ROWS = 3;
const DEPTHS = 3;
const CONVERGING = 0.01; // least spread of directions of view whose common point means something
const SIDES = 16; // directions that an object is looked at from
const CELLS = 48; // of a picture's side
const DETAIL = 4; // what contrast counts beside area
const SIZE = 640; // pixels of the picture's side
const FILLED = 0.9; // how much of it the bulk takes
const BULK = [0.03, 0.97]; // shares that bound the bulk on each axis
const SAMPLED = 20000; // points that are looked at
const NEARLY = 0.95; // share of the most that is shown from which on a view shows nearly as much
const OPAQUE = 0.1;
const LUMA = [0.3, 0.59, 0.11];
const SH_C0 = 0.28209479177387814;

// Near and far of what cameras look at together, from where they stand alone.
function rangeOf(views) {
  const places = views.map(({ position }) => position);
  const axes = views.map(({ rotation }) => rotation[2]);
  const n = views.length;
  const ends = [0, 1, 2].map((k) => places.map((place) => place[k]));
  const apart = Math.hypot(...ends.map((line) => Math.max(...line) - Math.min(...line))) || 1;
  const A = [0, 1, 2].map((i) =>
    [0, 1, 2].map((j) => axes.reduce((sum, axis) => sum + Number(i === j) - axis[i] * axis[j], 0) / n),
  );
  const b = [0, 1, 2].map(
    (i) => axes.reduce((sum, axis, v) => sum + places[v][i] - axis[i] * dot(axis, places[v]), 0) / n,
  );
  const det = dot(A[0], cross(A[1], A[2]));
  const middle = A[0][0] * A[1][1] - A[0][1] ** 2 + A[0][0] * A[2][2] - A[0][2] ** 2 + A[1][1] * A[2][2] - A[1][2] ** 2;
  if (det / middle > CONVERGING) {
    // near the least eigenvalue, of a matrix whose others are nearly 1
    const point = scaled(
      add(add(scaled(cross(A[1], A[2]), b[0]), cross(A[2], A[0]), b[1]), cross(A[0], A[1]), b[2]),
      1 / det,
    );
    const depths = axes
      .map((axis, v) => dot(axis, add(point, places[v], -1)))
      .filter((depth) => depth > 0)
      .sort((x, y) => x - y);
    const half = depths.length >> 1;
    if (depths.length > n / 2)
      return [0.5, 2].map((times) => (times * (depths[half] + depths[(depths.length - 1) >> 1])) / 2);
  }
  return [1.5 * apart, 30 * apart];
}

// Index of the view (scene.js) in the middle of those that have nearly most of what all have in their frames.
export function frontView(views) {
  if (views.length < 2) return 0;
  const [near, far] = rangeOf(views);
  const points = [];
  for (const {
    width,
    height,
    K: [fx, skew, fy, cx, cy],
    rotation,
    position,
  } of views) {
    for (let n = 0; n < COLUMNS * ROWS; n++) {
      const y = (((Math.floor(n / COLUMNS) + 0.5) / ROWS) * height - cy) / fy;
      const x = ((((n % COLUMNS) + 0.5) / COLUMNS) * width - cx - skew * y) / fx;
      const ray = add(add(rotation[2], rotation[0], x), rotation[1], y);
      for (let d = 0; d < DEPTHS; d++)
        points.push(add(position, ray, 1 / (1 / near + (d / (DEPTHS - 1)) * (1 / far - 1 / near))));
    }
  }
  const seen = views.map(
    ({ width, height, K: [fx, skew, fy, cx, cy], rotation, position }) =>
      points.filter((point) => {
        const [x, y, z] = rotation.map((row) => dot(row, add(point, position, -1)));
        const u = (fx * x + skew * y) / z + cx;
        const v = (fy * y) / z + cy;
        return z > near / 2 && z < 2 * far && u >= 0 && v >= 0 && u <= width && v <= height;
      }).length,
  );
  const most = Math.max(...seen);
  const away = views.map(
    ({ position }) => views.reduce((sum, other) => sum + length(add(position, other.position, -1)), 0) / views.length,
  );
  const farthest = Math.max(...away, 1e-30);
  const ranks = away.map((far, v) => (seen[v] >= NEARLY * most ? Math.round((1e9 * far) / farthest) : Infinity));
  return ranks.indexOf(Math.min(...ranks));
}

// Some of the Gaussians that are solid: their places and indices.
export function solidOf({ means, opacities, count }) {
  const step = Math.ceil(count / SAMPLED) || 1;
  const indices = [];
  for (let i = 0; i < count; i += step) if (opacities[i] > OPAQUE) indices.push(i);
  const points = indices.map((i) => means.slice(3 * i, 3 * i + 3));
  return { indices, points: points.length ? points : [[0, 0, 0]] };
}

// The corners of the box that holds most of some points.
export function bulkOf(points) {
  const sorted = [0, 1, 2].map((k) => points.map((point) => point[k]).sort((x, y) => x - y));
  return BULK.map((share) => sorted.map((line) => line[Math.floor(share * (line.length - 1))]));
}

// Of Gaussians that belong to no pixels, the side that shows most: a view of their bulk, in the file's world.
export function sideOf({ means, opacities, sh, degree, origin, count }) {
  const stride = 3 * (degree + 1) ** 2;
  const { points, indices } = solidOf({ means, opacities, count });
  const lumas = indices.map((i) => 0.5 + SH_C0 * LUMA.reduce((sum, share, k) => sum + share * sh[stride * i + k], 0));
  const [low, high] = bulkOf(points);
  const middle = scaled(add(low, high), 0.5);
  const radius = length(add(high, low, -1)) / 2 || 1;
  let best = -1;
  let rotation;
  for (let n = 0; n < SIDES; n++) {
    const angle = (2 * Math.PI * n) / SIDES;
    const forward = [Math.sin(angle), 0, Math.cos(angle)];
    const right = [Math.cos(angle), 0, -Math.sin(angle)];
    const depths = new Float32Array(CELLS * CELLS).fill(Infinity);
    const shown = new Float32Array(CELLS * CELLS);
    points.forEach((point, i) => {
      const at = add(point, middle, -1);
      const [u, v] = [dot(at, right), at[1]].map((x) => Math.floor(((x / radius + 1) / 2) * CELLS));
      const depth = dot(at, forward);
      if (u < 0 || v < 0 || u >= CELLS || v >= CELLS || depth >= depths[v * CELLS + u]) return;
      [depths[v * CELLS + u], shown[v * CELLS + u]] = [depth, lumas[i]];
    });
    let score = 0;
    for (let at = 0; at < CELLS * CELLS; at++) {
      if (depths[at] === Infinity) continue;
      score += 1;
      for (const beside of [(at + 1) % CELLS ? at + 1 : -1, at + CELLS])
        if (depths[beside] < Infinity) score += (DETAIL * Math.abs(shown[beside] - shown[at])) / 2;
    }
    if (score > best) [best, rotation] = [score, [right, [0, 1, 0], forward]];
  }
  let away = 0;
  for (let corner = 0; corner < 8; corner++) {
    const at = [0, 1, 2].map((k) => (corner & (1 << k) ? high : low)[k] - middle[k]);
    const [x, y, z] = rotation.map((row) => dot(row, at));
    away = Math.max(away, (2 * Math.max(Math.abs(x), Math.abs(y))) / FILLED - z);
  }
  const position = add(add([...origin], middle), rotation[2], -(away || 1));
  return { width: SIZE, height: SIZE, K: [SIZE, 0, SIZE, SIZE / 2, SIZE / 2], rotation, position };
}
