// Vectors and rotations as plain arrays. A rotation is three rows: right, down and forward of a camera in the world.

export const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const length = (v) => Math.hypot(v[0], v[1], v[2]);
export const scaled = (v, s) => [v[0] * s, v[1] * s, v[2] * s];
export const unit = (v) => scaled(v, 1 / (length(v) || 1));
export const mix = (a, b, t) => add(scaled(a, 1 - t), b, t);
export const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

export function turned(v, axis, angle) {
  // Rodrigues; the axis has length 1
  const c = Math.cos(angle);
  const s = Math.sin(angle);
  const along = dot(v, axis) * (1 - c);
  const side = cross(axis, v);
  return [0, 1, 2].map((i) => v[i] * c + side[i] * s + axis[i] * along);
}

// The rotation a share t of the shorter way from one to another.
export function between(from, to, t) {
  const step = [0, 1, 2].map((i) =>
    [0, 1, 2].map((j) => from[0][i] * to[0][j] + from[1][i] * to[1][j] + from[2][i] * to[2][j]),
  );
  const twice = [step[1][2] - step[2][1], step[2][0] - step[0][2], step[0][1] - step[1][0]]; // 2 sin(angle) axis
  const angle = Math.atan2(length(twice) / 2, (step[0][0] + step[1][1] + step[2][2] - 1) / 2);
  if (length(twice) < 1e-9) return t < 0.5 ? from : to; // the same, or half a turn, which has no shorter way
  return from.map((row) => turned(row, unit(twice), t * angle));
}
