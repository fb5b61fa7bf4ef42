/** Cameras as files have them: docs/FORMAT.md, CAMS, and what is computed of them. */

/** @typedef {import("./cursor.js").Cursor} Cursor */

const MAX_SIDE = 1 << 16;
const MAX_POSITION = 1e15;
const MIN_FOCAL = 1e-6;
const MAX_INTRINSIC = 1e9;
const ROTATION_TOLERANCE = 1e-3;
const POLAR_STEPS = 5;

/** @typedef {import("./tsplat.js").Camera} Camera */

/**
 * Numbers by view, column by column, of which nothing is known yet: FORMAT.md, "Columns".
 *
 * @param {Cursor} cursor
 * @param {number} views
 * @param {number} columns
 * @returns {(view: number) => number[]} a view's numbers
 */
export function readColumns(cursor, views, columns) {
  const read = Array.from({ length: columns }, () => {
    const form = cursor.u8();
    cursor.require(form <= 3, `a column stored as ${form}, known are 0 to 3`);
    return cursor.numbers(form & 2 ? "f32" : "f64", form & 1 ? views : 1);
  });
  return (view) => read.map((numbers) => (numbers.length === 1 ? numbers[0] : numbers[view]));
}

/**
 * The cameras of the section.
 *
 * @param {Cursor} cursor
 * @param {number} count
 * @returns {Camera[]}
 */
export function readCameras(cursor, count) {
  const numbersOf = readColumns(cursor, count, 19);
  cursor.finish();
  return Array.from({ length: count }, (_, view) => {
    const numbers = numbersOf(view);
    const [width, height] = numbers.slice(5, 7);
    requireSides(cursor, height, width);
    return { ...intrinsicsOf(cursor, numbers), c2w: poseOf(cursor, numbers.slice(7)), width, height };
  });
}

/**
 * The cameras of a layer's grid, which follow where it has `own` intrinsics, and else are the file's, scaled.
 *
 * @param {Cursor} cursor
 * @param {{ cameras: Camera[], views: number[], viewCount: number }} file
 * @param {number} height
 * @param {number} width
 * @param {boolean} isOwn
 * @returns {Camera[]}
 */
export function layerCameras(cursor, { cameras, views, viewCount }, height, width, isOwn) {
  const own = isOwn ? readColumns(cursor, viewCount, 5) : undefined;
  return cameras.map((camera, i) => {
    const [across, down] = [width / camera.width, height / camera.height];
    const { fx, fy, cx, cy, skew } = camera;
    const numbers = own?.(views[i]) ?? [fx * across, fy * down, cx * across, cy * down, skew * across];
    return { ...intrinsicsOf(cursor, numbers), c2w: camera.c2w, width, height };
  });
}

/**
 * fx, fy, cx, cy and skew, checked.
 *
 * @param {Cursor} cursor
 * @param {number[]} numbers
 */
function intrinsicsOf(cursor, [fx, fy, cx, cy, skew]) {
  cursor.require(fx >= MIN_FOCAL && fy >= MIN_FOCAL, `focal lengths ${fx} and ${fy}, at least ${MIN_FOCAL}`);
  const largest = Math.max(fx, fy, Math.abs(cx), Math.abs(cy), Math.abs(skew));
  cursor.require(largest <= MAX_INTRINSIC, `an intrinsic number of ${largest}, at most ${MAX_INTRINSIC}`);
  return { fx, fy, cx, cy, skew };
}

/**
 * c2w, checked.
 *
 * @param {Cursor} cursor
 * @param {number[]} numbers its upper three rows
 */
function poseOf(cursor, numbers) {
  const c2w = new Float64Array(16);
  c2w.set(numbers);
  c2w[15] = 1;
  cursor.require(c2w.every(Number.isFinite), "a camera's pose is not finite");
  const far = Math.max(Math.abs(c2w[3]), Math.abs(c2w[7]), Math.abs(c2w[11]));
  cursor.require(far <= MAX_POSITION, `a camera at ${far}, at most ${MAX_POSITION}`);
  const R = rotationOf(c2w).map((entry) => Math.min(Math.max(entry, -2), 2));
  const product = times(R, transposed(R));
  const deviation = Math.max(...product.map((entry, i) => Math.abs(entry - (i % 4 === 0 ? 1 : 0))));
  cursor.require(deviation <= ROTATION_TOLERANCE && determinant(R) >= 0, "a camera's pose is no rotation");
  return c2w;
}

/** @param {Cursor} cursor @param {number} height of a picture or grid @param {number} width */
export function requireSides(cursor, height, width) {
  const fits = [height, width].every((side) => Number.isInteger(side) && side >= 1 && side <= MAX_SIDE);
  cursor.require(fits, `${width}x${height}, sides are 1 to ${MAX_SIDE}`);
}

/** @param {Cursor} cursor @param {Float64Array | number[]} position */
export function requirePosition(cursor, position) {
  for (const x of position) cursor.require(Math.abs(x) <= MAX_POSITION, `${x}, at most ${MAX_POSITION} accepted`);
}

/** Upper left 3 × 3, row by row. @param {Float64Array} c2w */
function rotationOf(c2w) {
  return [c2w[0], c2w[1], c2w[2], c2w[4], c2w[5], c2w[6], c2w[8], c2w[9], c2w[10]];
}

/** @param {number[]} a @param {number[]} b both 3 × 3 */
function times(a, b) {
  return a.map((_, i) => {
    const [row, column] = [3 * ((i / 3) | 0), i % 3];
    return a[row] * b[column] + a[row + 1] * b[column + 3] + a[row + 2] * b[column + 6];
  });
}

/** @param {number[]} a */
function transposed(a) {
  return [a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]];
}

/** @param {number[]} m */
function determinant(m) {
  return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
}

/**
 * The exact rotation nearest to a camera's: Newton's iteration for the polar factor, 3 × 3 row by row.
 *
 * @param {Camera} camera
 */
export function exactRotation(camera) {
  let found = rotationOf(camera.c2w);
  for (let step = 0; step < POLAR_STEPS; step++) {
    const cubed = times(found, times(transposed(found), found));
    found = found.map((entry, i) => 1.5 * entry - 0.5 * cubed[i]);
  }
  return found;
}

/**
 * Quaternion wxyz of a rotation, its component of largest magnitude positive (Shepperd 1978).
 *
 * @param {number[]} m
 */
export function quaternionOf(m) {
  const [xx, yy, zz] = [m[0], m[4], m[8]];
  const [wx, wy, wz] = [m[7] - m[5], m[2] - m[6], m[3] - m[1]];
  const [xy, xz, yz] = [m[3] + m[1], m[6] + m[2], m[7] + m[5]];
  const candidates = [
    [1 + xx + yy + zz, wx, wy, wz],
    [wx, 1 + xx - yy - zz, xy, xz],
    [wy, xy, 1 - xx + yy - zz, yz],
    [wz, xz, yz, 1 - xx - yy + zz],
  ];
  let best = 0;
  for (let i = 1; i < 4; i++) if (candidates[i][i] > candidates[best][best]) best = i;
  const length = Math.hypot(...candidates[best]);
  return candidates[best].map((component) => component / length);
}

/**
 * Hamilton product a ⊗ b.
 *
 * @param {ArrayLike<number>} a
 * @param {ArrayLike<number>} b
 */
export function multiplied(a, b) {
  return [
    a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
    a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
    a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
    a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
  ];
}
