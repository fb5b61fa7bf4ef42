// Which views are drawn from here, and with what share: render/near.py has the reasons.
import { add, length } from "./vectors.js";

const NEAR_REACH = 1.5; // of the second nearest view's distance, where few views' shares reach 0
const FEW = 6; // views, up to which all are drawn behind the near ones
const DRAWN = 4; // views of more, that a picture is drawn from

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

// Shares of opacity by view: `front` of surfaces that are drawn before all others, `all` of whatever is drawn.
export function shares(far, views) {
  const front = new Float32Array(far.length), all = new Float32Array(far.length);
  if (far.length < 2) return { front, all: all.fill(1) };
  const near = [...views].sort((a, b) => far[a] - far[b] || a - b), isMany = near.length > FEW;
  const reach = isMany ? far[near[DRAWN]] : NEAR_REACH * far[near[Math.min(1, near.length - 1)]];
  for (const v of isMany ? near.slice(0, DRAWN) : near) {
    const share = ramp(far[v], far[near[0]], reach);
    front[v] = share * share;
    all[v] = isMany ? share : 1;
  }
  return { front, all };
}

// Indices of the Gaussians to draw, nearest first: `order(plane, nearPlane, shares)` for means (3n) and parts of them,
// { view, isFront, from, to }; view is -1 where there is none. First copies of the surfaces that have a share in front, with
// COPY set, then all whose view has a share; equal depths in their order. Self-contained, as a worker runs its text.
export function sorting(means, parts) {
  const COPY = 0x80000000, n = means.length / 3, counts = new Uint32Array(65536);
  const keys = new Uint32Array(n), depths = new Float32Array(keys.buffer), fronts = new Uint8Array(n);
  let [order, other] = [new Uint32Array(n), new Uint32Array(n)];
  function pass(total, shift) { // bits of positive floats rise as they do
    counts.fill(0);
    for (let i = 0; i < total; i++) counts[(keys[order[i]] >>> shift) & 65535]++;
    let sum = 0;
    for (let b = 0; b < 65536; b++) { const count = counts[b]; counts[b] = sum; sum += count; }
    for (let i = 0; i < total; i++) other[counts[(keys[order[i]] >>> shift) & 65535]++] = order[i];
    [order, other] = [other, order];
  }
  return ([x, y, z, t], nearPlane, { front, all }) => {
    let total = 0;
    for (const { view, isFront, from, to } of parts) {
      if (view >= 0 && !(all[view] > 0)) continue;
      const isCopied = isFront && view >= 0 && front[view] > 0 ? 1 : 0;
      for (let i = from; i < to; i++) {
        depths[i] = x * means[3 * i] + y * means[3 * i + 1] + z * means[3 * i + 2] + t;
        if (depths[i] > nearPlane) { fronts[i] = isCopied; order[total++] = i; }
      }
    }
    pass(total, 0);
    pass(total, 16);
    let copies = 0;
    for (let i = 0; i < total; i++) if (fronts[order[i]]) other[copies++] = (order[i] | COPY) >>> 0;
    const sorted = new Uint32Array(total + copies);
    sorted.set(other.subarray(0, copies));
    sorted.set(order.subarray(0, total), copies);
    return sorted;
  };
}
