"""Eight numbers at once do in compiled code what numpy does with arrays of eight."""

import numpy as np
import pytest

pytest.importorskip("numba")

from tinysplat_runtime.system.kernels_compile import compiled
from tinysplat_runtime.system.kernels_lanes import LANES, halves, lanes, least, load, most, ramp, store, total, where

F = np.float32


@compiled
def worked(a: np.ndarray, b: np.ndarray, single: np.float32, out: np.ndarray) -> np.float32:
    x, y = load(a, np.uint64(1)), load(b, np.uint64(0))
    kept = where((x > y) & (x < single), x / y, lanes(single))
    found = least(most(kept, y - x), single) * single + ramp()
    found += where(x >= y, x, where(x <= single, y, single))
    store(out, np.uint64(2), found)
    return total(found)


@compiled
def powers(a: np.ndarray, out: np.ndarray) -> None:
    whole, power = halves(load(a, np.uint64(0)))
    store(out, np.uint64(0), whole)
    store(out, np.uint64(LANES), power)


def test_lanes_compute_as_arrays_do() -> None:
    rng = np.random.default_rng(0)
    a, b, out = rng.normal(size=LANES + 1).astype(F), rng.normal(size=LANES).astype(F), np.zeros(LANES + 2, F)
    single = F(0.75)
    summed = worked(a, b, single, out)
    x, y = a[1:], b
    kept = np.where((x > y) & (x < single), x / y, single)
    expected = np.minimum(np.maximum(kept, y - x), single) * single + np.arange(LANES, dtype=F)
    expected = expected + np.where(x >= y, x, np.where(x <= single, y, single))
    np.testing.assert_allclose(out[2:], expected, rtol=1e-6)
    assert (out[:2] == 0).all() and summed == pytest.approx(expected.sum(dtype=np.float64), rel=1e-6)


def test_halves_are_whole_numbers_and_powers_of_two() -> None:
    given, out = np.array([1, 1.99, 127, 127.5, 130.25, 200, 253, 254.9], F), np.zeros(2 * LANES, F)
    powers(given, out)
    np.testing.assert_array_equal(out[:LANES], np.floor(given))
    np.testing.assert_array_equal(out[LANES:], np.ldexp(F(1), given.astype(int) - 127))
