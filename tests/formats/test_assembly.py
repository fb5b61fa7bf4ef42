"""Arrays of files to Gaussians: when an origin is needed and which, what is left out, and what shapes are refused."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.assembly import (
    Points,
    assemble,
    cut_degree_note,
    far_note,
    without_invalid,
)
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.scene.cameras import Camera

K = np.array([[9.0, 0, 2], [0, 9, 1], [0, 0, 1]])


def arrays(*lead: int, degree: int = 0, dtype: type = np.float64) -> dict[str, NDArray]:
    rng = np.random.default_rng(0)
    return {
        "means": rng.uniform(-1, 1, (*lead, 3)).astype(dtype), "quats": rng.uniform(0.1, 1, (*lead, 4)),
        "scales": rng.uniform(0.1, 1, (*lead, 3)), "opacities": rng.uniform(0.1, 1, lead),
        "sh": rng.uniform(-1, 1, (*lead, (degree + 1) ** 2, 3)),
    }  # fmt: skip


def camera(x: float, width: int = 4, height: int = 2) -> Camera:
    return Camera(K, np.eye(4) + x * np.eye(4, k=3), width, height)


def test_means_near_the_origin_are_taken_as_they_are() -> None:
    given = arrays(5)
    found = assemble(given, None, None)
    assert not found.origin.any()
    np.testing.assert_array_equal(found.means, given["means"].astype(np.float32))


def test_far_means_are_relative_to_the_mean_of_the_cameras_or_of_themselves() -> None:
    given = arrays(2, 2, 4)
    given["means"] += [1e7, 0, 0]
    found = assemble(given, None, [camera(1e7 - 1), camera(1e7 + 3)])
    assert found.origin.tolist() == [1e7 + 1, 0, 0]
    np.testing.assert_allclose(found.means + found.origin, given["means"], atol=1e-6)
    flat = arrays(7)
    flat["means"] += 1e7
    found = assemble(flat, None, None)
    np.testing.assert_allclose(found.origin, flat["means"].mean(axis=0))
    np.testing.assert_allclose(found.means + found.origin, flat["means"], atol=1e-7)
    single = {**flat, "means": flat["means"].astype(np.float32)}
    assert not assemble(single, None, None).origin.any()


def test_an_origin_that_a_file_states_stays_and_is_added_to() -> None:
    given = {**arrays(3), "origin": np.array([1.0, 2, 3])}
    assert assemble(given, None, None).origin.tolist() == [1, 2, 3]
    given["means"] = given["means"] + 1e7
    found = assemble(given, None, None)
    np.testing.assert_allclose(found.origin, np.add(given["means"].mean(axis=0), [1, 2, 3]))
    with pytest.raises(InputError, match=r"origin: shape \(2,\), expected \(3,\)"):
        assemble({**arrays(3), "origin": np.zeros(2)}, None, None)


def test_gaussians_of_nan_or_beyond_float32_are_left_out_and_counted() -> None:
    given = arrays(6)
    given["means"][1, 2], given["sh"][3, 0, 0], given["scales"][4, 0] = np.nan, np.inf, 3.5e38
    given["quats"][5, 0] = float(np.finfo(np.float32).max)
    found, count = without_invalid({**given, "origin": np.zeros(3)})
    assert count == 3 and found["origin"].shape == (3,)
    for name, array in given.items():
        np.testing.assert_array_equal(found[name], array[[0, 2, 5]])
    assert without_invalid(arrays(4))[1] == 0
    for same in (
        {**arrays(1), "means": np.full((1, 3), np.nan)}, {**given, "layer1_means": np.zeros(1)},
        {**given, "means": given["means"][:5]}, {**arrays(1, 2, 2), "means": np.full((1, 2, 2, 3), np.nan)}, {},
    ):  # fmt: skip
        assert without_invalid(same) == (same, 0)


def test_a_list_is_put_on_its_grid_in_c_order() -> None:
    given = arrays(16)
    found = assemble(given, (2, 2, 4), None)
    assert found.opacities.shape == (2, 2, 4)
    assert found.opacities[1, 1, 3] == np.float32(given["opacities"][15])
    np.testing.assert_array_equal(found.means[1, 0, 1], given["means"][9].astype(np.float32))
    assert assemble(arrays(2, 2, 4), (2, 2, 4), None).opacities.shape == (2, 2, 4)
    for lead in ((15,), (17,), (2, 4, 2)):
        with pytest.raises(InputError, match=r"Gaussians of shape \(.*\) are not the pixels of a 2x2x4 grid"):
            assemble(arrays(*lead), (2, 2, 4), None)
    with pytest.raises(InputError, match="are not the pixels"):
        assemble({**given, "scales": given["scales"][:15]}, (2, 2, 4), None)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"means": None, "sh": None}, "lacks means, sh; expected means, quats, scales, opacities, sh"),
        ({"opacities": np.zeros((2, 4))}, "opacities: shape (2, 4), expected (V, H, W) or (N,)"),
        ({"c2w": np.zeros((2, 4, 4))}, "c2w without K, expected both or neither"),
        ({"K": np.zeros((2, 3, 3))}, "K without c2w"),
        ({"K": np.zeros((3, 3, 3)), "c2w": np.zeros((2, 4, 4))}, "K: shape (3, 3, 3), expected (2, 3, 3)"),
        ({"K": np.zeros((2, 3, 3)), "c2w": np.zeros((2, 3, 4))}, "c2w: shape (2, 3, 4), expected (2, 4, 4)"),
        ({"K": np.stack([K, 0 * K]), "c2w": np.stack([np.eye(4)] * 2)}, "K[1]: "),
        ({"layer1_means": np.zeros(3)}, "lacks layer1_quats, layer1_scales, layer1_opacities, layer1_sh; expected"),
    ],
)
def test_what_does_not_fit_is_named(change, said: str) -> None:
    given = {name: array for name, array in {**arrays(2, 2, 4), **change}.items() if array is not None}
    with pytest.raises(InputError) as caught:
        assemble(given, None, None)
    assert str(caught.value).startswith(said)


def test_cameras_of_a_flat_list_need_its_grid() -> None:
    views = {"K": np.stack([K] * 2), "c2w": np.stack([np.eye(4)] * 2)}
    with pytest.raises(
        InputError, match=r"K and c2w, but Gaussians of shape \(16,\); give their pixels with --grid V,H,W"
    ):
        assemble({**arrays(16), **views}, None, None)
    found = assemble({**arrays(16), **views}, (2, 2, 4), None)
    assert [(one.width, one.height) for one in found.cameras] == [(4, 2)] * 2


def test_notes_say_what_is_cut_and_what_is_far() -> None:
    flat = assemble(arrays(4, degree=4), None, None)
    assert cut_degree_note(flat, 3, ".x") == ["SH of degree 4 cut to 3, the highest that readers of .x know"]
    assert cut_degree_note(flat, 4, ".x") == []
    points = Points.of(flat)
    assert not points.is_far and far_note(points) == []
    moved = Gaussians(flat.means, flat.quats, flat.scales, flat.opacities, flat.sh, (), [1e7, 0, 0])
    points = Points.of(moved)
    np.testing.assert_array_equal(points.means, np.add(flat.means.astype(np.float64), [1e7, 0, 0]))
    assert points.is_far
    assert far_note(points) == [
        "positions lose digits: too far from the world's origin for float; bring the scene nearer first"
    ]
    near = Gaussians(flat.means, flat.quats, flat.scales, flat.opacities, flat.sh, (), [0.5, 0, 0])
    assert not Points.of(near).is_far or np.abs(near.means).max() < 1e-3
