// Which views are drawn from here, and with what share: render/near.py has the reasons.
import { add, length } from "./vectors.js";

const NEAR_REACH = 1.5; // of the second nearest view's distance, where few views' shares reach 0
export const FEW = 6; // views, up to which all are drawn behind the near ones
export const DRAWN = 4; // views of more, that are drawn whole
export const AROUND = 12; // views of more, whose coarse surfaces are drawn behind these
export const OPEN = 1 / 64; // transmittance that everything else has to leave of a pixel for coarse surfaces to be drawn there
export const EVERY = 4; // of a coarse surface: one pixel of so many rows and columns, whose Gaussian is as many times as large

// How far views are from a camera, place (in depths) and direction alike.
export function distances(views, depth, camera) {
  return views.map(({ position, rotation }) => Math.hypot(
    length(add(camera.position, position, -1)) / depth, length(add(camera.rotation[2], rotation[2], -1))));
}

// The views that count: of many, the first of those at one place that look one way.
export function counted(views) {
  if (views.length <= FEW) return views.map((_, v) => v);
  const poses = views.map(({ position, rotation }) => [...position, ...rotation[2]].join());
  return views.map((_, v) => v).filter((v) => poses.indexOf(poses[v]) === v);
}

function ramp(distance, nearest, reach) {
  if (reach <= nearest) return Number(distance <= reach);
  return Math.max(0, Math.min(1, (reach - distance) / (reach - nearest)));
}

// Shares of opacity by view: `front` of surfaces that are drawn before all others, `all` of whatever is drawn, `behind` of
// coarse surfaces that are drawn behind it.
export function shares(far, views) {
  const [front, all, behind] = [0, 1, 2].map(() => new Float32Array(far.length));
  if (far.length < 2) return { front, all: all.fill(1), behind };
  const near = [...views].sort((a, b) => far[a] - far[b] || a - b), isMany = near.length > FEW;
  const drawn = isMany ? near.slice(0, DRAWN) : near;
  const reach = isMany ? far[near[DRAWN]] : NEAR_REACH * far[near[Math.min(1, near.length - 1)]];
  for (const v of drawn) {
    const share = ramp(far[v], far[drawn[0]], reach);
    front[v] = share * share;
    all[v] = isMany ? share : 1;
  }
  const last = near.length > AROUND ? far[near[AROUND]] : Infinity;
  for (const v of isMany ? near.slice(0, AROUND) : []) behind[v] = last < Infinity ? ramp(Math.max(far[v], reach), reach, last) : 1;
  return { front, all, behind };
}

// Indices of the Gaussians to draw, nearest first: `order(plane, nearPlane, shares)` for means (3n) and parts of them,
// { view, isFront, from, to, coarse }; view is -1 where there is none, and `coarse`, where there is one, lists the part's
// Gaussians of its coarse surface. First copies of the surfaces that have a share in front, with COPY set, then all whose
// view has a share, then coarse surfaces, with BEHIND set; equal depths in their order. Self-contained, as a worker runs
// its text. `whole` is where coarse surfaces begin.
export function sorting(means, parts) {
  const COPY = 0x80000000, BEHIND = 0x40000000, n = means.length / 3, counts = new Uint32Array(65536);
  const keys = new Uint32Array(n), depths = new Float32Array(keys.buffer), fronts = new Uint8Array(n);
  let [order, other] = [new Uint32Array(n), new Uint32Array(n)], total = 0;
  function pass(shift) { // bits of positive floats rise as they do
    counts.fill(0);
    for (let i = 0; i < total; i++) counts[(keys[order[i]] >>> shift) & 65535]++;
    let sum = 0;
    for (let b = 0; b < 65536; b++) { const count = counts[b]; counts[b] = sum; sum += count; }
    for (let i = 0; i < total; i++) other[counts[(keys[order[i]] >>> shift) & 65535]++] = order[i];
    [order, other] = [other, order];
  }
  return ([x, y, z, t], nearPlane, { front, all, behind }) => {
    function list(i) {
      depths[i] = x * means[3 * i] + y * means[3 * i + 1] + z * means[3 * i + 2] + t;
      if (depths[i] > nearPlane) order[total++] = i;
    }
    function sorted() {
      pass(0);
      pass(16);
      return order.subarray(0, total);
    }
    total = 0;
    for (const { view, coarse } of parts) if (coarse && behind[view] > 0) coarse.forEach(list);
    const last = sorted().map((i) => i | BEHIND);
    total = 0;
    for (const { view, isFront, from, to } of parts) {
      if (view >= 0 && !(all[view] > 0)) continue;
      const isCopied = isFront && view >= 0 && front[view] > 0 ? 1 : 0;
      for (let i = from; i < to; i++) {
        fronts[i] = isCopied;
        list(i);
      }
    }
    const whole = sorted();
    let copies = 0;
    for (const i of whole) if (fronts[i]) other[copies++] = (i | COPY) >>> 0;
    const found = new Uint32Array(copies + total + last.length);
    found.set(other.subarray(0, copies));
    found.set(whole, copies);
    found.set(last, copies + total);
    return { sorted: found, whole: copies + total };
  };
}
