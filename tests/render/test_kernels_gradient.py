"""What a tile is held against, and where values put Gaussians: small arrays by hand."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("numba")

from tinysplat_runtime.render import kernels_blend as kb
from tinysplat_runtime.render import kernels_gradient as kg
from tinysplat_runtime.render.kernels_blend import Extent
from tinysplat_runtime.render.kernels_gradient import Exposure, Sought
from tinysplat_runtime.render.kernels_project import X, Y

PLANE = kb.ROW // (2 * kb.PLANES)


def planes_of(state: np.ndarray, extent: Extent) -> np.ndarray:
    """(5, rows, columns) of a tile: transmittance, red, green, blue and the last."""
    return state.reshape(kb.TILE_HEIGHT, 2 * kb.PLANES, PLANE)[: extent.rows, : kb.PLANES, : extent.columns].swapaxes(
        0, 1
    )


@pytest.mark.parametrize("most_left", [1.0, 0.6])
@pytest.mark.parametrize("is_shown", [True, False])
def test_a_tile_is_held_against_the_photo(is_shown: bool, most_left: float) -> None:
    """Gain 1.25 and offset −0.1, a weight of 3; of pixels that are unknown or too open nothing counts."""
    rng, extent = np.random.default_rng(0), Extent(2, 3, 5, 7)
    state = np.zeros(kb.STATE, np.float32)
    planes = planes_of(state, extent)
    planes[0] = rng.uniform(-1, 1, (5, 7))  # negative where a pixel has stopped
    planes[1:4] = picture = rng.uniform(-0.1, 1.3, (3, 5, 7)).astype(np.float32)
    through = np.abs(planes[0])
    photo = rng.uniform(size=(9, 12, 3)).astype(np.float32)
    photo[3, 4:6, 0] = np.nan
    photo[4, 5] = np.float32(1.25) * picture[:, 2, 2] + np.float32(-0.1)  # exactly
    shown, sums = np.full((9, 12, 4) if is_shown else (0, 0, 0), 7, np.float32), np.full(kg.SUMS, 9.0)
    exposure = Exposure(np.float32(1.25), np.float32(-0.1), np.float32(3))
    kg._compare(state, Sought(photo, exposure, shown, np.float32(most_left)), extent, sums)
    own = photo[2:7, 3:10]
    known = ~np.isnan(own[..., 0]) & ((through <= most_left) if is_shown else True)
    seen = np.moveaxis(1.25 * picture.astype(np.float64) - 0.1, 0, -1)
    error = np.where(known[..., None], seen - own, 0)
    error[np.abs(error) < 1e-6] = 0
    sign = np.sign(error)
    wanted = [np.abs(error).sum(), np.where(known[..., None], seen.clip(0, 1) - own, 0).__pow__(2).sum(),
              (sign * np.moveaxis(picture, 0, -1)).sum(), sign.sum(), known.sum()]  # fmt: skip
    np.testing.assert_allclose(sums, wanted, rtol=1e-5)
    slopes = np.moveaxis(sign, -1, 0) * 1.25 * 3
    np.testing.assert_allclose(planes[1:4], slopes, rtol=1e-6)
    assert (planes[0] == 1).all()
    np.testing.assert_allclose(planes[4], (slopes * picture).sum(axis=0), rtol=1e-4, atol=1e-5)
    if is_shown:
        np.testing.assert_array_equal(shown[2:7, 3:10, 3], through)
        np.testing.assert_array_equal(shown[2:7, 3:10, :3], np.moveaxis(picture, 0, -1))
        assert (shown[:2] == 7).all() and (shown[7:] == 7).all() and (shown[:, 10:] == 7).all()


def test_behind_the_front_everything_shows_as_far_as_it_lets_through() -> None:
    rng, extent = np.random.default_rng(0), Extent(0, 0, 3, 4)
    state = np.zeros(kb.STATE, np.float32)
    planes = planes_of(state, extent)
    planes[:] = rng.uniform(-1, 1, (5, 3, 4))
    before = planes.copy()
    kg._go_behind(state, extent)
    assert (planes[0] == 1).all()
    np.testing.assert_allclose(planes[1:4], before[1:4] * np.abs(before[0]), rtol=1e-6)
    np.testing.assert_array_equal(planes[4], before[4])


def test_a_splat_is_hidden_by_what_lies_before_its_middle_or_the_pixel_nearest_to_it() -> None:
    extent, state, splat = Extent(32, 128, 5, 7), np.zeros(kb.STATE, np.float32), np.zeros(16, np.float32)
    planes = planes_of(state, extent)
    planes[0] = np.arange(35).reshape(5, 7) / 100
    planes[0, 4, 6] = -0.5  # stopped
    for (x, y), (column, row) in {
        (130.7, 34.2): (2, 2),
        (0.0, 0.0): (0, 0),
        (999.0, 33.5): (6, 1),
        (128.2, 99.0): (0, 4),
    }.items():
        splat[X], splat[Y] = x, y
        there = float(planes[0, row, column])
        assert not kg._is_hidden(splat, extent, state, np.float32(there))
        assert kg._is_hidden(splat, extent, state, np.float32(there + 1e-3))
    splat[X], splat[Y] = 999, 999
    assert kg._is_hidden(splat, extent, state, np.float32(1e-3)) and not kg._is_hidden(
        splat, extent, state, np.float32(0)
    )


def test_gaussians_are_put_where_their_values_say() -> None:
    rng = np.random.default_rng(1)
    base, centre = rng.normal(size=(2, kg.BASE, 128)).astype(np.float32), np.array([1.0, -2, 3])
    values = rng.normal(size=(6, 256)).astype(np.float32)
    values[kg.LOGIT, :3] = -np.inf, 90, -90
    geometry, sh = np.zeros((2, 14, 128), np.float32), np.full((2, 12 * 128), 5, np.float32)
    kg.place(base, centre, values, geometry, sh)
    flat = base.swapaxes(0, 1).reshape(kg.BASE, 256).astype(np.float64)
    placed, wide = geometry.swapaxes(0, 1).reshape(14, 256), values.astype(np.float64)
    away = np.exp(wide[kg.LOG_DEPTH])
    np.testing.assert_allclose(placed[:3], centre[:, None] + away * flat[:3], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(placed[3:12], np.exp(wide[kg.LOG_DEPTH] + wide[kg.LOG_SIZE]) * flat[3:12], rtol=1e-5)
    np.testing.assert_allclose(placed[12], -np.logaddexp(0, -wide[kg.LOGIT]), rtol=1e-5, atol=1e-30)
    np.testing.assert_allclose(placed[13], away * flat[12], rtol=1e-5)
    np.testing.assert_array_equal(sh[:, : 3 * 128].reshape(2, 3, 128).swapaxes(0, 1).reshape(3, 256), values[3:])
    assert (sh[:, 3 * 128 :] == 5).all()
