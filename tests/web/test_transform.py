"""Inverse transforms of blocks against matrix products in numpy: Rec. ITU-T H.265, 8.6.4."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from page.scripts import PAGE, ask

MODULE = (PAGE.parent / "web" / "hevc" / "transform.js").as_uri()
COLUMN = np.array([64, 90, 90, 90, 89, 88, 87, 85, 83, 82, 80, 78, 75, 73, 70, 67, 64, 61, 57, 54, 50, 46, 43, 38, 36,
                   31, 25, 22, 18, 13, 9, 4])  # fmt: skip
"""transMatrix's first column, of the cosines of π n / 64."""

SINES = np.array([[29, 55, 74, 84], [74, 74, 0, -74], [84, -29, -74, 55], [55, -84, 74, -29]])

CODE = """
for (const one of CASES) {
  const { log2, bits, kind, columns, rows } = one, side = 1 << log2, values = new Int32Array(1024);
  one.block.forEach((row, y) => values.set(row, 32 * y));
  const plane = Uint16Array.from(one.plane.flat()), stride = side + 3, block = { values, bits, columns, rows };
  if (kind === "sines") addSines(block, plane, 2 * stride + 1, stride);
  else addCosines(block, log2, plane, 2 * stride + 1, stride);
  found.push([...plane]);
}
export default found;
"""


def matrix(side: int) -> NDArray:
    """Rows by coefficient, columns by sample."""
    n, k = np.mgrid[:32, :32]
    cosine = np.cos(np.pi * (2 * k + 1) * n / 64)
    nearest = np.argmin(np.abs(np.abs(cosine)[..., None] - np.cos(np.pi * np.arange(32) / 64)), axis=-1)
    whole = np.where(n == 0, 64, np.sign(cosine) * np.where(np.abs(cosine) < 1e-9, 0, COLUMN[nearest]))
    return whole[:: 32 // side, :side].astype(np.int64)


def wanted(case: dict[str, Any]) -> NDArray:
    side, bits = 1 << case["log2"], case["bits"]
    weights = SINES if case["kind"] == "sines" else matrix(side)
    middle = np.clip((weights.T @ case["block"] + 64) >> 7, -32768, 32767)
    shift = 20 - bits
    rest = (middle @ weights + (1 << (shift - 1))) >> shift
    plane = case["plane"].copy()
    plane[2 : 2 + side, 1 : 1 + side] = np.clip(plane[2 : 2 + side, 1 : 1 + side] + rest, 0, (1 << bits) - 1)
    return plane


def made(log2: int, bits: int, kind: str, block: NDArray, seed: int) -> dict[str, Any]:
    side = 1 << log2
    at = np.nonzero(block)
    reach = [4 * (int(where.max()) // 4) + 4 if where.size else 4 for where in at]
    plane = np.random.default_rng(seed).integers(0, 1 << bits, (side + 3, side + 3))
    return {
        "log2": log2,
        "bits": bits,
        "kind": kind,
        "block": block,
        "plane": plane,
        "rows": reach[0],
        "columns": reach[1],
    }


def cases(log2: int, bits: int, kind: str) -> list[dict[str, Any]]:
    rng, side, found = np.random.default_rng(10 * log2 + bits), 1 << log2, []
    for place in range(16):  # one coefficient alone, and beside the first
        for first in (0, 300):
            block = np.zeros((side, side), np.int64)
            block[0, 0] = first
            block[place // 4, place % 4] += int(rng.integers(-900, 900))
            found.append(block)
    for reach in range(4, side + 1, 4):
        for size in (200, 32767):
            block = np.zeros((side, side), np.int64)
            block[:reach, : side - reach + 4] = rng.integers(-size, size + 1, (reach, side - reach + 4))
            found.append(block)
    for extreme in (-32768, 32767):
        found += [np.full((side, side), extreme), np.pad([[extreme]], (0, side - 1))]
    return [made(log2, bits, kind, block, n) for n, block in enumerate(found)]


@pytest.mark.parametrize("bits", [8, 10, 12])
def test_residuals_are_added_as_the_standard_s_matrices_say(bits: int) -> None:
    given = [case for log2 in (2, 3, 4, 5) for case in cases(log2, bits, "cosines")] + cases(2, bits, "sines")
    plain = [
        {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in one.items()} for one in given
    ]
    start = f'import {{ addCosines, addSines }} from "{MODULE}";\nconst found = [], CASES = {plain};\n'
    for one, found in zip(given, ask(start + CODE), strict=True):
        np.testing.assert_array_equal(np.reshape(found, one["plane"].shape), wanted(one), err_msg=str(one["block"]))
