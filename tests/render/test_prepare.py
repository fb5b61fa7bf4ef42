"""Gaussians cut into parts and blocks, and what is kept of them from frame to frame."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import make_gaussians
from scipy.spatial.transform import Rotation

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import prepare as prepare_module
from tinysplat_runtime.render.prepare import Shelf, parts, prepare, principal_axes
from tinysplat_runtime.scene.cameras import Camera


def test_axes_are_columns_of_the_rotation_times_scales() -> None:
    rng = np.random.default_rng(0)
    quats, scales = rng.normal(size=(6, 4)), rng.uniform(0.1, 2, (6, 3))
    wanted = Rotation.from_quat(quats, scalar_first=True).as_matrix() * scales[:, None]
    np.testing.assert_allclose(principal_axes(quats, scales), np.moveaxis(wanted, 0, -1), atol=1e-14)


@pytest.mark.parametrize("by_view", [True, False])
def test_parts_come_in_order_and_are_no_longer_than_a_block(by_view: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prepare_module, "BLOCK_SIZE", 10)
    scene = make_gaussians(2, 3, 4, degree=1, layers=2)  # 12 pixels of each view, and 2 of the second layer
    found = list(parts(scene, by_view=by_view))
    wanted = [(0, True, 10), (0, True, 2), (1, True, 10), (1, True, 2), (0, False, 2), (1, False, 2)]
    if not by_view:
        wanted = [(-1, True, 10), (-1, True, 10), (-1, True, 4), (-1, False, 4)]
    assert [(part.view, part.is_surface, part.size) for part in found] == wanted
    for name, array in (("means", scene.flat().means), ("sh", scene.flat().sh)):
        np.testing.assert_array_equal(np.concatenate([part.rows[name] for part in found]), array)
    assert all((part.photo is scene.cameras[part.view]) if by_view else part.photo is None for part in found)
    assert all(part.own_pixels() is None for part in parts(scene, by_view=by_view, own_pixels=False))


def test_what_can_never_show_is_in_no_block() -> None:
    scene = make_gaussians(1, 2, 4, degree=1)
    scene = Gaussians(
        scene.means, scene.quats, scene.scales, np.array([1, 0.5, 1 / 254, 1 / 256, 0, 0.2, 1, 1]).reshape(1, 2, 4),
        scene.sh, scene.cameras,
    )  # fmt: skip
    (part,), (block,) = parts(scene, by_view=True), prepare(scene, by_view=True)
    shown, flat = [0, 1, 2, 5, 6, 7], scene.flat()
    assert (block.size, block.view, block.is_surface) == (6, 0, True)
    np.testing.assert_array_equal(block.means, flat.means[shown].T)
    np.testing.assert_allclose(np.exp(block.log_opacities), flat.opacities[shown], rtol=1e-6)
    np.testing.assert_array_equal(block.sh, np.moveaxis(flat.sh[shown], 0, -1))
    z = ((flat.means - scene.cameras[0].centre) @ scene.cameras[0].c2w[:3, 2])[shown]
    np.testing.assert_allclose(block.own_pixels, z / scene.cameras[0].focal, rtol=1e-5)
    keep = np.arange(8) % 2 == 0
    for some, rows in ((part.block(keep), [0, 2, 6]), (block.compress(np.array([1, 0, 0, 1, 1, 0], bool)), [0, 5, 6])):
        np.testing.assert_array_equal(some.means, flat.means[rows].T)
        np.testing.assert_array_equal(some.quats, flat.quats[rows])
        np.testing.assert_array_equal(some.scales, flat.scales[rows])
        assert some.axes.shape == (3, 3, 3) and some.sh.shape == (4, 3, 3) and some.own_pixels.shape == (3,)
    outline = part.outline(keep)
    assert outline.size == 3 and outline.axes.size == outline.sh.size == 0
    np.testing.assert_allclose(block.fainter(np.log(0.25)).log_opacities, np.log(flat.opacities[shown] / 4), rtol=1e-6)


def test_bounds_hold_means_scales_and_own_pixels() -> None:
    means = np.array([[[[1.0, 2, 3], [-1, 5, 4], [0, 3, 9]]]])
    scales = np.array([[[[0.1, 0.2, 0.3], [0.4, 0.9, 0.1], [0.2, 0.2, 0.2]]]])
    c2w = np.diag([-1.0, 1, -1, 1])  # looks along −z from the origin of the world, which lies at z = 20 of the means
    camera = Camera([[2.0, 0, 1], [0, 8, 1], [0, 0, 1]], c2w, 3, 1)
    scene = Gaussians(means, np.ones((1, 1, 3, 4)), scales, np.ones((1, 1, 3)), np.zeros((1, 1, 3, 1, 3)), (camera,),
                      np.array([0.0, 0, -20]))  # fmt: skip
    (part,) = parts(scene, by_view=True)
    np.testing.assert_allclose(part.bounds, [-1, 2, 3, 1, 5, 9, 0.9, 17 / 4], rtol=1e-6)
    (part,) = parts(scene)
    np.testing.assert_allclose(part.bounds, [-1, 2, 3, 1, 5, 9, 0.9, 0], rtol=1e-6)


def test_a_shelf_keeps_what_was_wanted_last_in_as_many_places_as_it_has() -> None:
    made = []
    shelf = Shelf(lambda part, place: made.append((part, place)) or (part, place), 3)
    assert shelf.take([5, 7]) == [(5, 0), (7, 1)] and shelf.take([7, 2]) == [(7, 1), (2, 2)]
    assert shelf.take([9, 7]) == [(9, 0), (7, 1)]  # in the place of 5, the one longest not wanted
    assert shelf.take([5]) == [(5, 2)] and made == [(5, 0), (7, 1), (2, 2), (9, 0), (5, 2)]
