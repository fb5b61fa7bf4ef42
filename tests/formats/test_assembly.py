"""Arrays of files as Gaussians: shapes, grids, cameras, origins and where nodes put them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import make_gaussians

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.assembly import Points, assemble, cut_degree_note, far_note, without_invalid
from tinysplat_runtime.formats.placement import placed
from tinysplat_runtime.gaussian.quaternions import multiply_quats, normalize_quats

K = np.array([[10.0, 0, 2], [0, 10, 1.5], [0, 0, 1]])


def arrays(*lead: int, degree: int = 0, **changes: Any) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    made = {
        "means": rng.normal(size=(*lead, 3)), "quats": rng.normal(size=(*lead, 4)), "scales": np.full((*lead, 3), 0.1),
        "opacities": np.full(lead, 0.5), "sh": rng.normal(size=(*lead, (degree + 1) ** 2, 3)),
    }  # fmt: skip
    return {name: array for name, array in {**made, **changes}.items() if array is not None}


def test_a_list_becomes_a_grid_row_by_row() -> None:
    given = arrays(24)
    found = assemble(given, (2, 3, 4), None)
    assert found.opacities.shape == (2, 3, 4)
    np.testing.assert_allclose(found.means[1, 2, 3], given["means"][23], rtol=1e-6)
    np.testing.assert_allclose(found.means[0, 1, 0], given["means"][4], rtol=1e-6)
    assert assemble(arrays(2, 3, 4), (2, 3, 4), None).opacities.shape == (2, 3, 4)


CAMERAS = {"K": np.stack([K] * 2), "c2w": np.stack([np.eye(4)] * 2)}


@pytest.mark.parametrize(
    ("given", "grid", "words"),
    [
        (arrays(24), (2, 3, 5), "Gaussians of shape (24,) are not the pixels of a 2x3x5 grid"),
        (arrays(3, 2, 4), (2, 3, 4), "Gaussians of shape (3, 2, 4) are not the pixels of a 2x3x4 grid"),
        (arrays(24, sh=np.zeros((23, 1, 3))), (2, 3, 4), "Gaussians of shape (24,) are not the pixels of a 2x3x4 grid"),
        (arrays(4, means=None, sh=None), None, "lacks means, sh; expected means, quats, scales, opacities, sh"),
        (arrays(2, 3), None, "opacities: shape (2, 3), expected (V, H, W) or (N,)"),
        (arrays(4, origin=np.zeros(2)), None, "origin: shape (2,), expected (3,)"),
        (arrays(2, 3, 4, K=CAMERAS["K"]), None, "K without c2w"),
        (arrays(2, 3, 4, c2w=CAMERAS["c2w"]), None, "c2w without K, expected both or neither"),
        (arrays(24, **CAMERAS), None, "K and c2w, but Gaussians of shape (24,); give their pixels with --grid V,H,W"),
        (arrays(3, 3, 4, **CAMERAS), None, "K: shape (2, 3, 3), expected (3, 3, 3)"),
        (arrays(2, 3, 4, K=CAMERAS["K"], c2w=np.eye(4)), None, "c2w: shape (4, 4), expected (2, 4, 4)"),
        (arrays(2, 3, 4, K=CAMERAS["K"], c2w=np.stack([np.eye(4), np.zeros((4, 4))])), None, "c2w[1]: "),
        (arrays(2, 3, 4, layer1_means=np.zeros((2, 1, 1, 3))), None,
         "lacks layer1_quats, layer1_scales, layer1_opacities, layer1_sh; expected layer1_means, "),
    ],
)  # fmt: skip
def test_arrays_that_do_not_fit_are_refused_by_name(given: dict[str, Any], grid: Any, words: str) -> None:
    with pytest.raises(InputError) as error:
        assemble(given, grid, None)
    assert words in str(error.value)


def layer(n: int, *lead: int, **changes: Any) -> dict[str, Any]:
    return {f"layer{n}_{name}": array for name, array in arrays(*lead, **changes).items()}


def test_layers_have_cameras_of_their_own_and_errors_name_them() -> None:
    c2w = np.stack([np.eye(4)] * 2)
    c2w[1, 0, 3] = 5
    small = np.stack([np.diag([0.5, 0.5, 1]) @ K] * 2)
    found = assemble(
        {**arrays(2, 3, 4, **CAMERAS), **layer(1, 2, 2, 2, K=small), **layer(2, 2, 1, 1, K=small, c2w=c2w)}, None, None
    )
    assert [g.opacities.shape for g in found.layers] == [(2, 3, 4), (2, 2, 2), (2, 1, 1)]
    assert (found.cameras[0].width, found.cameras[0].height) == (4, 3)
    np.testing.assert_allclose(found.layers[1].cameras[1].K, small[1])
    np.testing.assert_allclose(found.layers[1].cameras[1].c2w, np.eye(4))
    np.testing.assert_allclose(found.layers[2].cameras[1].c2w, c2w[1])
    bad = {**arrays(2, 3, 4), **layer(1, 2, 2, 2, scales=np.full((2, 2, 2, 3), -1.0))}
    with pytest.raises(InputError, match=r"^layer1_scales"):
        assemble(bad, None, None)


def test_origins_come_where_float32_would_lose_digits() -> None:
    """At 1,000 units a float32 moves a point by up to 3e-5, seen from 1 unit away more than 1e-6 of that."""
    near = arrays(1, 1, 2, means=np.array([[[[0.123456789, 0, 1], [0, 0, 1]]]]))
    view = {"K": K[None], "c2w": np.eye(4)[None]}
    found = assemble({**near, **view}, None, None)
    assert not found.origin.any()
    c2w = np.eye(4)[None].copy()
    c2w[0, :3, 3] = 1000, 2000, 0
    far = {**near, "means": near["means"] + [1000, 2000, 0], "K": K[None], "c2w": c2w}
    found = assemble(far, None, None)
    np.testing.assert_array_equal(found.origin, [1000, 2000, 0])
    np.testing.assert_allclose(found.means, near["means"], rtol=1e-6)
    assert not assemble({**far, "means": far["means"].astype(np.float32)}, None, None).origin.any()
    found = assemble({**far, "means": near["means"], "origin": np.array([1000.0, 2000, 0])}, None, None)
    np.testing.assert_array_equal(found.origin, [1000, 2000, 0])
    np.testing.assert_allclose(found.means, near["means"], rtol=1e-6)
    found = assemble(arrays(2, means=np.array([[1e6 + 0.1, 0, 0], [1e6 + 0.3, 1, 0]])), None, None)
    np.testing.assert_allclose(found.origin, [1e6 + 0.2, 0.5, 0])  # without cameras, the mean
    np.testing.assert_allclose(found.means, [[-0.1, -0.5, 0], [0.1, 0.5, 0]], atol=1e-7)


def test_rounding_is_held_against_the_nearest_camera() -> None:
    """2^-25 of rounding at 1/2 + 2^-25, from 0.02 units away too much, from 0.04 units not."""
    point = 0.5 + 2.0**-25
    for away, moved in ((0.02, True), (0.04, False)):
        c2w = np.stack([np.eye(4)] * 2)
        c2w[:, 0, 3] = 300, point - away
        given = arrays(2, 1, 1, means=np.array([[[[point, 0, 0]]]] * 2), K=CAMERAS["K"], c2w=c2w)
        assert assemble(given, None, None).origin.any() == moved


def test_points_are_all_layers_where_the_world_has_them() -> None:
    c2w = np.stack([np.eye(4)] * 2)
    c2w[:, 0, 3] = 1e6
    views = {"K": CAMERAS["K"], "c2w": c2w, "layer1_K": CAMERAS["K"]}
    given = {**arrays(2, 3, 4, origin=np.array([1e6, 0, 0])), **layer(1, 2, 1, 2, degree=1), **views}
    made = assemble(given, None, None)
    points = Points.of(made)
    assert points.gaussians.count == len(points.means) == 28 and points.is_far
    np.testing.assert_allclose(points.means[:24], made.means.reshape(-1, 3) + np.array([1e6, 0, 0]), rtol=1e-12)
    assert far_note(points) == [
        "positions lose digits: too far from the world's origin for float; bring the scene nearer first"
    ]
    near = Points.of(make_gaussians())
    assert not near.is_far and far_note(near) == []
    assert cut_degree_note(made, 1, ".x") == []
    assert cut_degree_note(made, 0, ".x") == ["SH of degree 1 cut to 0, the highest that readers of .x know"]


def test_gaussians_that_hold_what_float32_cannot_are_left_out() -> None:
    largest = float(np.finfo(np.float32).max)
    given = arrays(6)
    given["means"][1, 2] = np.nan
    given["sh"][2, 0, 1] = np.inf
    given["scales"][3, 0] = largest
    given["opacities"][4] = largest * 1.001
    given["other"] = np.zeros(2)
    found, count = without_invalid(given)
    assert count == 3 and [*found] == [*given] and len(found["other"]) == 2
    np.testing.assert_array_equal(found["quats"], given["quats"][[0, 3, 5]])
    fine = arrays(6)
    assert without_invalid(fine) == (fine, 0)
    every = arrays(6, opacities=np.full(6, np.nan))
    assert without_invalid(every)[1] == 0
    for passes in (
        {**given, "layer1_means": np.zeros(1)},
        {**given, "sh": np.zeros((5, 1, 3))},
        arrays(1, 2, 3, sh=np.full((1, 2, 3, 1, 3), np.nan)),
    ):
        assert without_invalid(passes)[0] is passes


def node(scale: float = 1.0, turn: float = 0.0, move: tuple[float, ...] = (0, 0, 0)) -> np.ndarray:
    c, s = np.cos(turn), np.sin(turn)
    matrix = np.eye(4)
    matrix[:3, :3] = scale * np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    matrix[:3, 3] = move
    return matrix


def test_nodes_move_turn_and_enlarge() -> None:
    given = arrays(5, degree=1)
    assert placed(given, np.eye(4)) is given
    moved = placed(given, node(2, 0, (1, 2, 3)))
    np.testing.assert_allclose(moved["means"], 2 * given["means"] + [1, 2, 3])
    np.testing.assert_allclose(moved["scales"], 2 * given["scales"])
    assert moved["quats"] is given["quats"] and moved["sh"] is given["sh"]
    turned = placed(given, node(0.5, np.pi / 2))
    np.testing.assert_allclose(turned["means"], 0.5 * given["means"][:, [1, 0, 2]] * [-1, 1, 1], atol=1e-12)
    expected = multiply_quats(np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)]), given["quats"])
    dots = np.abs((normalize_quats(turned["quats"]) * normalize_quats(expected)).sum(axis=1))
    np.testing.assert_allclose(dots, 1, atol=1e-12)
    np.testing.assert_allclose(turned["sh"][:, [0, 2]], given["sh"][:, [0, 2]], atol=1e-12)  # constant, and along z
    signs = np.array([1, -1])[:, None]  # SH 1 is −y, SH 3 is −x: x turns to y, and y to −x
    np.testing.assert_allclose(turned["sh"][:, [1, 3]], given["sh"][:, [3, 1]] * signs, atol=1e-12)


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (np.diag([1, 1, 1.002, 1]), "a node stretches or mirrors"),
        (np.diag([-1.0, 1, 1, 1]), "a node stretches or mirrors"),
        (np.diag([0.0, 0, 0, 1]), "no similarity"), (np.diag([1, np.inf, 1, 1]), "no similarity"),
        (np.diag([1.0, 1, 0, 1]), "no similarity"),
    ],
)  # fmt: skip
def test_nodes_that_no_gaussian_can_follow(matrix: np.ndarray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        placed(arrays(2), matrix)


def test_rounding_of_a_node_s_scales_is_none() -> None:
    assert placed(arrays(2), np.diag([1, 1, 1.0005, 1]))["scales"] == pytest.approx(0.1 * (3.0005 / 3))
