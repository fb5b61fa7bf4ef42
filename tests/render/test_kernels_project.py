"""Compiled projection beside that of numpy, and what chunks remember."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("numba")

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import kernels_project as kp
from tinysplat_runtime.render.compiled import pack
from tinysplat_runtime.render.lists import view_numbers
from tinysplat_runtime.render.prepare import parts, prepare
from tinysplat_runtime.render.project import View, projected
from tinysplat_runtime.scene.cameras import Camera

COUNT = 300  # the third chunk is half full


def scene(degree: int, photo: bool) -> Gaussians:
    """Of all sizes about a camera; with a photo, of own pixels from a tenth to five of the picture's."""
    rng = np.random.default_rng(degree)
    lead = (1, 1, COUNT) if photo else (COUNT,)
    means = rng.uniform([-6, -5, -1], [6, 5, 9], (*lead, 3)) * rng.uniform(0.05, 1, (*lead, 1))
    cameras = (Camera([[24.0, 0, 1], [0, 24, 1], [0, 0, 1]], np.diag([1.0, 1, 1, 1]), COUNT, 1),) if photo else ()
    return Gaussians(
        means, rng.normal(size=(*lead, 4)), np.exp(rng.uniform(-7, 1, (*lead, 3))), rng.uniform(0.01, 1, lead),
        rng.normal(size=(*lead, (degree + 1) ** 2, 3)), cameras, np.array([0.1, -0.2, 0.3]),
    )  # fmt: skip


def view(focal: float = 40.0) -> View:
    c2w = np.eye(4)
    c2w[:3, :3] = [[0.96, 0, 0.28], [0, 1, 0], [-0.28, 0, 0.96]]
    c2w[:3, 3] = 0.3, -0.1, -0.2
    return View.of(
        Camera([[focal, 1.5, 21], [0, 1.2 * focal, 30], [0, 0, 1]], c2w, 50, 70), np.array([0.1, -0.2, 0.3]), 0.3
    )


@pytest.mark.parametrize("photo", [False, True], ids=["screen", "own"])
@pytest.mark.parametrize("degree", range(5))
def test_records_are_what_numpy_projects(degree: int, photo: bool) -> None:
    made, share = scene(degree, photo), -0.25
    (part,), (block,) = parts(made, by_view=photo), prepare(made, by_view=photo)
    chunks, count = pack(part, 0), block.size
    records = np.full((len(chunks.sh) * 128, 16), np.nan, np.float32)
    for focal in (40.0, 5.0):  # by the second, own pixels are less than the picture's
        seen = projected(block.fainter(share), view(focal))
        numbers, work = view_numbers(view(focal), share), np.empty(kp.SCRATCH, np.float32)
        written, wide = kp.project(chunks.geometry, chunks.sh, numbers, work, records, np.zeros(0, np.int32))
        assert written == len(records)
        assert seen is not None and 20 < seen.visible.size < count
        is_wide = records[:, kp.LAST] == 1
        assert wide == is_wide.sum() and wide < 20
        rows = seen.visible[~is_wide[seen.visible]]
        np.testing.assert_allclose(records[rows, :5], seen.planes.T[rows, :5], rtol=2e-4, atol=2e-4)
        np.testing.assert_allclose(records[rows, kp.RED : kp.BLUE + 1], seen.planes.T[rows, 5:], rtol=1e-4, atol=2e-5)
        np.testing.assert_allclose(records[rows, kp.LOG_OPACITY], seen.log_opacities[rows], atol=1e-4)
        np.testing.assert_allclose(records[rows, kp.DEPTH], seen.depths[rows], rtol=1e-6)
        bounds = records[rows][:, [kp.LEFT, kp.RIGHT, kp.TOP, kp.BOTTOM]]
        apart = np.abs(bounds - seen.bounds[:, rows].T).max(axis=1)
        assert apart.max() <= 1 and (apart > 0).mean() < 0.05  # rounding decides
        wants_chord = bounds[:, 1] - bounds[:, 0] >= 16
        np.testing.assert_allclose(
            records[rows, kp.REACH], np.where(wants_chord, 1 / records[rows, kp.ALPHA_X], 0), rtol=1e-5
        )
        assert wants_chord.any() and not wants_chord.all()
        hidden = np.setdiff1d(np.arange(len(records)), seen.visible)
        hidden = hidden[~is_wide[hidden]]
        off = records[hidden, kp.RIGHT] >= 0
        assert off.sum() <= 2 and not off[hidden >= count].any()
        z = (made.means.reshape(-1, 3) + view().offset) @ view().projection[2]
        shown = made.opacities.ravel() >= 1 / 255
        assert (records[:count][z[shown] <= 0.3][:, kp.DEPTH] == -1).all()


def test_records_may_be_of_those_alone_that_may_show() -> None:
    (part,) = parts(scene(1, False))
    chunks, work, numbers = pack(part, 0), np.empty(kp.SCRATCH, np.float32), view_numbers(view())
    every, some = np.full((2, len(chunks.sh) * 128, 16), np.nan, np.float32)
    rows = np.full(len(every), -1, np.int32)
    _, wide = kp.project(chunks.geometry, chunks.sh, numbers, work, every, np.zeros(0, np.int32))
    count, same = kp.project(chunks.geometry, chunks.sh, numbers, work, some, rows)
    shown = np.flatnonzero((every[:, kp.RIGHT] >= 0) | (every[:, kp.LAST] > 0))
    assert 0 < count == shown.size < len(every) and same == wide
    np.testing.assert_array_equal(rows[:count], shown)
    np.testing.assert_array_equal(some[:count], every[shown])
    assert (rows[count:] == -1).all() and np.isnan(some[count:]).all()
    behind = View.of(Camera(np.eye(3), np.diag([1.0, 1, 1, 1]), 9, 9), np.array([0, 0, -99.0]), 0.1)
    assert kp.project(chunks.geometry, chunks.sh, view_numbers(behind), work, some, rows) == (0, 0)
