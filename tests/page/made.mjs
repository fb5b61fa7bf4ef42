// Cameras and views of made-up scenes, and comparisons of numbers, for tests of the page's modules.
import assert from "node:assert/strict";
import { turned } from "../../runtime/tinysplat_runtime/page/vectors.js";

export const ROWS = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
];
export const UP = [0, -1, 0];

/** A view at x, turned about the vertical. */
export const view = (x, turn = 0) => ({
  K: [500, 0, 500, 320, 240],
  width: 640,
  height: 480,
  position: [x, 0, 0],
  rotation: ROWS.map((row) => turned(row, UP, turn)),
});

/** Fails where numbers, however nested, differ by more than rounding. */
export function close(found, wanted, within = 1e-9) {
  const [one, other] = [found, wanted].map((value) => [value].flat(9));
  assert.equal(one.length, other.length);
  one.forEach((number, at) =>
    assert.ok(Math.abs(number - other[at]) <= within * (1 + Math.abs(other[at])), `${number} is not ${other[at]}`),
  );
}

/** Numbers from 0 to 1, the same in every run. */
export function randoms(seed = 5) {
  return () => (seed = (seed * 16807) % 2147483647) / 2147483647;
}
