"""Moving a scene moves its picture; selections keep what they say and nothing else."""

import numpy as np
import pytest
import torch
from scenes import make_cameras, make_gaussians, make_smooth_gaussians, refusing

from tinysplat.gsplat_tensors import to_gsplat
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.editing import (
    crop,
    cut_degree,
    drop_transparent,
    merge,
    rotate_sh,
    select_views,
    similarity,
    trim_border,
)
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices
from tinysplat_runtime.gaussian.sh import sh_basis
from tinysplat_runtime.render import render
from tinysplat_runtime.scene.cameras import Camera

ROTATION = quats_to_matrices(normalize_quats(np.array([0.7, -0.4, 0.5, 0.3])))


@pytest.mark.parametrize("degree", range(5))
def test_turned_coefficients_show_the_turned_colours(degree: int) -> None:
    rng = np.random.default_rng(degree)
    sh = rng.normal(size=(7, (degree + 1) ** 2, 3))
    directions = rng.normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    turned = sh_basis(directions @ ROTATION.T, degree) @ rotate_sh(sh, ROTATION)
    np.testing.assert_allclose(turned, sh_basis(directions, degree) @ sh, atol=1e-12)


@pytest.mark.parametrize("origin", [None, np.array([500_000.0, 4_000_000.0, 30.0])])
def test_a_moved_scene_looks_the_same_from_its_moved_cameras(origin: np.ndarray | None) -> None:
    scene = make_smooth_gaussians(2, 24, 32, degree=3, layers=2, origin=origin)
    moved = similarity(scene, ROTATION, 2.5, (3.0, -1.0, 0.5))
    before, after = (render(g, g.cameras[1], near_plane=n) for g, n in ((scene, 0.01), (moved, 0.025)))
    np.testing.assert_allclose(after, before, atol=2e-3)
    assert moved.is_per_pixel and len(moved.layers) == 2
    listed = similarity(scene.flat(), ROTATION, 2.5, (3.0, -1.0, 0.5))  # whose photos' cameras move along
    for one, other in zip(listed.viewpoints, moved.cameras, strict=True):
        np.testing.assert_array_equal(one.c2w, other.c2w)


def test_selections_keep_what_they_say() -> None:
    scene = make_gaussians(views=3, height=8, width=12, layers=2)
    only = select_views(scene, [2, 0])
    np.testing.assert_array_equal(only.means, scene.means[[2, 0]])
    assert only.layers[1].opacities.shape == (2, 4, 6) and only.cameras == (scene.cameras[2], scene.cameras[0])
    assert trim_border(scene, 2).count == 3 * 4 * 8 + scene.layers[1].opacities.size
    assert trim_border(scene, 0).count == scene.count
    opaque = drop_transparent(scene, 0.5)
    assert opaque.opacities.min() >= 0.5 and opaque.count == (scene.flat().opacities >= 0.5).sum()
    box = crop(scene, (-1, -1, 2), (1, 1, 3))
    corners = np.sort(scene.flat().means[[5, 80]], axis=0)  # what lies on the box's sides stays
    assert {5, 80} <= {*np.flatnonzero(np.isin(scene.flat().means[:, 0], crop(scene, *corners).means[:, 0]))}
    assert 0 < box.count < scene.count and (np.abs(box.means - (0, 0, 2.5)) <= (1, 1, 0.5)).all()


@pytest.mark.parametrize(("degree", "kept"), [(0, 1), (1, 4), (2, 9), (3, 9), (4, 9)])
def test_the_degree_is_cut_in_all_layers_and_never_raised(degree: int, kept: int) -> None:
    scene = make_gaussians(degree=2, layers=2)
    for before, after in zip(scene.layers, cut_degree(scene, degree).layers, strict=True):
        np.testing.assert_array_equal(after.sh, before.sh[..., :kept, :])


def test_merged_scenes_keep_their_places_and_degrees() -> None:
    near, far = make_gaussians(degree=0).flat(), make_gaussians(degree=2, seed=1).flat()
    shifted = Gaussians(**{name: getattr(far, name) for name in FIELDS}, origin=np.array([0.0, 0.0, 10.0]))
    both = merge([near, shifted])
    assert both.count == near.count + far.count and both.degree == 2
    np.testing.assert_allclose(both.means[near.count :], far.means + np.array([0, 0, 10]), rtol=1e-6)
    np.testing.assert_array_equal(both.sh[: near.count, 1:], 0)
    assert both.viewpoints == near.viewpoints + shifted.viewpoints and near.viewpoints


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda g: select_views(g, [3]), "expected different views of 0 to 1"),
        (lambda g: select_views(g, [0, 0]), "expected different views"),
        (lambda g: select_views(g.flat(), [0]), "no views to choose"),
        (lambda g: trim_border(g, 4), "less than half"),
        (lambda g: trim_border(g.flat(), 1), "no border"),
        (lambda g: trim_border(g, -1), "-1 pixels of 12x8, expected less than half of either"),
        (lambda g: drop_transparent(g, 1.01), "expected 0 to 1"),
        (lambda g: drop_transparent(g, 1.0), "none of 192 Gaussians is left"),
        (lambda g: crop(g, (0, 0, 0), (1, 1, 0)), "expected a box"),
        (lambda g: crop(g, (0, 0, 0), (1, 0, 1)), "expected a box"),
        (lambda g: cut_degree(g, 5), "expected 0 to 4"),
        (lambda g: similarity(g, (1 + 1e-6) * np.eye(3)), "no rotation matrix"),
        (lambda g: similarity(g, np.diag([1.0, 1, -1])), "no rotation matrix"),
        (lambda g: similarity(g, np.eye(4)), "no rotation matrix"),
        (lambda g: similarity(g, scale=0), "above 0"),
        (lambda g: similarity(g, scale=float("inf")), "above 0"),
        (lambda g: similarity(g, translation=(0, 1)), "three finite numbers"),
        (lambda g: similarity(g, translation=(0, float("nan"), 0)), "three finite numbers"),
    ],
)
def test_impossible_edits_are_refused(edit, words: str) -> None:
    with refusing(InputError, words):
        edit(make_gaussians())


# ---- gsplat's conventions ----------------------------------------------------------------------------------------


def test_gsplat_tensors_project_where_the_camera_does() -> None:
    """With gsplat's own formula, pixels = K (R x + t), at an origin far away."""
    origin = np.array([1e6, 0.0, -2e6])
    scene = make_smooth_gaussians(2, 16, 20, degree=2, layers=2, origin=origin)
    given = to_gsplat(scene)
    assert {name: tuple(given[name].shape) for name in ("means", "colors", "viewmats", "Ks")} == {
        "means": (scene.count, 3),
        "colors": (scene.count, 9, 3),
        "viewmats": (2, 4, 4),
        "Ks": (2, 3, 3),
    }
    assert (given["sh_degree"], given["width"], given["height"]) == (2, 20, 16)
    means = torch.nn.functional.pad(given["means"], (0, 1), value=1.0)
    local = (means @ given["viewmats"][1].T)[:, :3]
    pixels = (local @ given["Ks"][1].T).numpy()
    flat, camera = scene.flat(), scene.cameras[1]
    expected = ((flat.means + flat.origin - camera.centre) @ camera.rotation.T) @ camera.K.T
    np.testing.assert_allclose(pixels, expected, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(given["quats"].norm(dim=-1), 1, rtol=1e-6)


def test_gsplat_tensors_need_cameras_of_one_size() -> None:
    scene = make_gaussians()
    with pytest.raises(InputError):
        to_gsplat(scene.flat())
    cameras: list[Camera] = [*make_cameras(1, 8, 12), *make_cameras(1, 9, 12)]
    with pytest.raises(InputError):
        to_gsplat(scene, cameras)
