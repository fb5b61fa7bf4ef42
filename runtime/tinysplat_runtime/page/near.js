// How much of which view is drawn first from here: render/near.py has the reasons.
import { add, length } from "./vectors.js";

const NEAR_REACH = 1.5; // of the second nearest view's distance, where shares reach 0
const MOST_VIEWS = 6; // drawn in a picture

// How far views are from a camera, place (in depths) and direction alike.
export function distances(views, depth, camera) {
  return views.map(({ position, rotation }) =>
    Math.hypot(length(add(camera.position, position, -1)) / depth, length(add(camera.rotation[2], rotation[2], -1))),
  );
}

function ramp(distance, nearest, reach) {
  if (reach <= nearest) return Number(distance <= reach);
  return Math.max(0, Math.min(1, (reach - distance) / (reach - nearest)));
}

// Two shares by view: of its surface's alphas, that is drawn before all else, and of its opacities, that they have.
export function shares(far) {
  const ranked = [...far].sort((a, b) => a - b);
  const front = (distance) => (far.length > 1 ? ramp(distance, ranked[0], NEAR_REACH * ranked[1]) ** 2 : 0);
  const opaque = (distance) => (far.length > MOST_VIEWS ? ramp(distance, ranked[1], ranked[MOST_VIEWS]) : 1);
  return Float32Array.from(far.flatMap((distance) => [front(distance), opaque(distance)]));
}

// Indices of the Gaussians to draw, nearest first: `order(plane, nearPlane, shares)` for means (3n) and parts of them, {
// view, isFront, from, to }; view is -1 where there is none. First copies of the surfaces that have a share in front,
// with COPY set, then all with some opacity; equal depths in their order. Self-contained, as a worker runs its text.
export function sorting(means, parts) {
  const COPY = 0x80000000;
  const n = means.length / 3;
  const counts = new Uint32Array(65536);
  const keys = new Uint32Array(n);
  const depths = new Float32Array(keys.buffer);
  const fronts = new Uint8Array(n);
  let [order, other] = [new Uint32Array(n), new Uint32Array(n)];
  let total = 0;
  function pass(shift) {
    // bits of positive floats rise as they do
    counts.fill(0);
    for (let i = 0; i < total; i++) counts[(keys[order[i]] >>> shift) & 65535]++;
    let sum = 0;
    for (let b = 0; b < 65536; b++) {
      const count = counts[b];
      counts[b] = sum;
      sum += count;
    }
    for (let i = 0; i < total; i++) other[counts[(keys[order[i]] >>> shift) & 65535]++] = order[i];
    [order, other] = [other, order];
  }
  return ([x, y, z, t], nearPlane, shares) => {
    total = 0;
    for (const { view, isFront, from, to } of parts) {
      if (shares[2 * view + 1] === 0) continue;
      const isCopied = isFront && shares[2 * view] > 0 ? 1 : 0;
      for (let i = from; i < to; i++) {
        fronts[i] = isCopied;
        depths[i] = x * means[3 * i] + y * means[3 * i + 1] + z * means[3 * i + 2] + t;
        if (depths[i] > nearPlane) order[total++] = i;
      }
    }
    pass(0);
    pass(16);
    let copies = 0;
    for (let n = 0; n < total; n++) if (fronts[order[n]]) other[copies++] = (order[n] | COPY) >>> 0;
    const found = new Uint32Array(copies + total);
    found.set(other.subarray(0, copies));
    found.set(order.subarray(0, total), copies);
    return found;
  };
}
