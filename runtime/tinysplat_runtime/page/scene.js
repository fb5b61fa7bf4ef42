// What tsplat.js decodes, in the page's units: its origin is the mean camera centre and its unit makes the median depth
// REACH, so that float32 does not depend on where a scene lies and how large it is.
import { sideOf } from "./front.js";
import { add, cross, dot, length, scaled, unit } from "./vectors.js";

const REACH = 4;
const LEAST_OPACITY = 1 / 255; // that shows
const NEAR_PLANE = 0.01; // scene units
const LEVEL = 0.1; // mean sine of the roll of cameras that are held level

// A camera as the page takes it: rows of its rotation right, down and forward; position in the world.
export function viewOf({ width, height, fx, fy, cx, cy, skew, c2w }) {
  const forward = unit([c2w[2], c2w[6], c2w[10]]);
  const right = [c2w[0], c2w[4], c2w[8]];
  const x = unit(add(right, forward, -dot(right, forward))); // exact where few digits were written
  return {
    width,
    height,
    K: [fx, skew, fy, cx, cy],
    rotation: [x, cross(forward, x), forward],
    position: [c2w[3], c2w[7], c2w[11]],
  };
}

// Runs of Gaussians: of a view's pixels, or of none.
function partsOf(layers) {
  return layers.flatMap(({ views, count, offset }, layer) => {
    if (!views) return [{ view: -1, isFront: false, from: offset, to: offset + count }];
    const own = count / views;
    return Array.from({ length: views }, (_, view) => ({
      view,
      isFront: layer === 0,
      from: offset + view * own,
      to: offset + (view + 1) * own,
    }));
  });
}

// decoded: of tsplat.js. cameras: views of a file that has none. frame: of the same scene, decoded from fewer bytes.
export function sceneOf(decoded, cameras = [], frame = null) {
  const given = decoded.cameras.length ? decoded.cameras : cameras;
  const taken = given.length ? given : (decoded.viewpoints ?? []);
  // Of a list, where its photos were taken, or the side that shows most.
  const world = taken.length ? taken.map(viewOf) : [sideOf(decoded)];
  const { scale, centre } = frame ?? frameOf(decoded, world, world[0]);
  const views = world.map((view) => ({ ...view, position: scaled(add(view.position, centre, -1), scale) }));
  return {
    ...shown(decoded, scale, add([...decoded.origin], centre, -1)),
    frame: { scale, centre },
    views,
    hasCameras: taken.length > 0,
    reach: REACH,
    nearPlane: NEAR_PLANE * scale,
    up: upOf(views),
  };
}

// Up of a scene: −y where all cameras are held level in a world that stands upright, else where they have it on the
// whole.
function upOf(views) {
  const down = views.reduce((sum, { rotation }) => add(sum, rotation[1], 1 / views.length), [0, 0, 0]);
  const roll = views.reduce((sum, { rotation }) => sum + rotation[0][1] ** 2 / views.length, 0);
  if (roll < LEVEL ** 2 && down[1] > 0.3) return [0, -1, 0];
  return length(down) > 1e-6 ? unit(scaled(down, -1)) : scaled(views[0].rotation[1], -1);
}

function frameOf({ means, opacities, count, origin }, views, { position, rotation }) {
  const centre = scaled(
    views.reduce((sum, { position }) => add(sum, position), [0, 0, 0]),
    1 / views.length,
  );
  const depths = [];
  const offset = add([...origin], position, -1);
  for (let i = 0; i < count; i += Math.ceil(count / 20000)) {
    const z = dot(rotation[2], add(means.subarray(3 * i, 3 * i + 3), offset));
    if (z > 0 && opacities[i] > 0.1) depths.push(z);
  }
  const median = depths.sort((a, b) => a - b)[depths.length >> 1];
  return { centre, scale: median ? REACH / median : 1 };
}

// The Gaussians that can show, moved and scaled.
function shown({ means, scales, quats, opacities, sh, degree, layers }, scale, offset) {
  const functions = (degree + 1) ** 2;
  const width = 3 * functions;
  const parts = [];
  const isShown = (i) =>
    opacities[i] >= LEAST_OPACITY && Number.isFinite(means[3 * i] + means[3 * i + 1] + means[3 * i + 2]);
  let count = 0;
  for (let i = 0; i < opacities.length; i++) count += isShown(i) ? 1 : 0;
  const out = {
    means: new Float32Array(3 * count),
    scales: new Float32Array(3 * count),
    quats: new Float32Array(4 * count),
    opacities: new Float32Array(count),
    sh: new Float32Array(width * count),
  };
  let at = 0;
  for (const { view, isFront, from, to } of partsOf(layers)) {
    const start = at;
    for (let i = from; i < to; i++) {
      if (!isShown(i)) continue;
      for (let k = 0; k < 3; k++) {
        out.means[3 * at + k] = scale * (means[3 * i + k] + offset[k]);
        out.scales[3 * at + k] = scale * scales[3 * i + k];
      }
      for (let k = 0; k < 4; k++) out.quats[4 * at + k] = quats[4 * i + k];
      for (let k = 0; k < width; k++) out.sh[width * at + k] = sh[width * i + k];
      out.opacities[at++] = opacities[i];
    }
    if (at > start) parts.push({ view, isFront, from: start, to: at });
  }
  return { ...out, count, functions, parts };
}
