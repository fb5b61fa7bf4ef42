"""Large photos by hand: sizes, tiles, exposures and what the graph is given; groups and origins; limits of networks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tinysplat_runtime.errors import InputError, ModelError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.sh import C0
from tinysplat_runtime.graphs import enlarge, predict, walk
from tinysplat_runtime.graphs.enlarge import Enlarger
from tinysplat_runtime.graphs.inference import Graph
from tinysplat_runtime.graphs.predict import NetworkLimits, network_inputs
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.neighbours import Group


def camera(x: float = 0.0, width: int = 10, height: int = 8, y: float = 0.0, z: float = 0.0) -> Camera:
    c2w = np.eye(4)
    c2w[:3, 3] = x, y, z
    return Camera([[20, 0, width / 2], [0, 20, height / 2], [0, 0, 1]], c2w, width, height)


# ---- sizes and tiles ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("large", "stride", "least", "pixels", "sizes"),
    [
        ((480, 640), 16, 32, 480 * 640 // 4, [(240, 320)]),
        ((960, 1280), 16, 32, 240 * 320, [(240, 320), (480, 640)]),
        ((480, 640), 100, 350, 240 * 320, [(400, 400)]),
        ((100, 100), 1, 1, 99 * 99, [(99, 99)]),
        ((214, 214), 1, 1, 100 * 100, [(100, 100)]),
        ((216, 216), 1, 1, 100 * 100, [(100, 100), (147, 147)]),
    ],
)
def test_sizes_are_whole_strides_and_at_most_about_twice_the_one_before(large, stride, least, pixels, sizes) -> None:
    assert enlarge._sizes(large, NetworkLimits(stride=stride, min_side=least), pixels) == sizes


def test_tiles_are_about_equal_and_worked_on_with_what_lies_beside_them() -> None:
    def spans(length: int, halo: int) -> list[tuple[int, ...]]:
        return [
            (s.kept.start, s.kept.stop, s.worked_on.start, s.worked_on.stop, s.within.start, s.within.stop)
            for s in enlarge._spans(length, halo)
        ]

    assert spans(448, 30) == [(0, 448, 0, 448, 0, 448)]
    assert spans(449, 30) == [(0, 224, 0, 254, 0, 224), (224, 449, 194, 449, 30, 255)]
    assert [(a, b) for a, b, *_ in spans(1000, 5)] == [(0, 333), (333, 667), (667, 1000)]


def test_places_among_small_pixels_are_those_of_centres() -> None:
    places, near = enlarge._among_small(100, 25, slice(40, 44))
    np.testing.assert_allclose(places + near.start, [(n + 0.5) / 4 - 0.5 for n in range(40, 44)], rtol=1e-6)
    assert (near.start, near.stop) == (7, 13)
    places, near = enlarge._among_small(100, 25, slice(0, 4))
    assert near == slice(0, 3) and places[0] == pytest.approx(-0.375)


def test_a_tile_is_given_its_pixels_its_camera_and_the_small_pixels_about_them() -> None:
    photo = np.arange(3 * 80 * 100, dtype=np.float32).reshape(3, 80, 100)
    maps = np.arange(9 * 20 * 25, dtype=np.float32).reshape(9, 20, 25)
    found = enlarge._tile_inputs(photo, maps, camera(width=100, height=80), slice(40, 60), slice(20, 28))
    np.testing.assert_array_equal(found["photo"], photo[None, :, 40:60, 20:28])
    np.testing.assert_array_equal(found["small"], maps[None, :, 7:17, 2:9])
    np.testing.assert_array_equal(found["K"], [[[20, 0, 30], [0, 20, 0], [0, 0, 1]]])
    assert (len(found["rows"]), len(found["columns"])) == (20, 8)
    np.testing.assert_allclose([found["rows"][0], found["columns"][0]], [9.625 - 7, 4.625 - 2])


def test_cameras_of_stretched_photos_are_stretched() -> None:
    (found,) = enlarge._sized([camera()], np.zeros((1, 16, 30, 3)))
    np.testing.assert_allclose(found.K, [[60, 0, 15], [0, 40, 8], [0, 0, 1]])
    assert (found.width, found.height) == (30, 16)


# ---- exposures ------------------------------------------------------------------------------------------------------


def test_blurring_is_the_mean_of_nine_by_nine_with_repeated_borders() -> None:
    image = np.random.default_rng(0).random((12, 15, 3)).astype(np.float32)
    padded = np.pad(image, ((4, 4), (4, 4), (0, 0)), mode="edge")
    expected = [
        [padded[r : r + 9, c : c + 9].mean(axis=(0, 1), dtype=np.float64) for c in range(15)] for r in range(12)
    ]
    np.testing.assert_allclose(enlarge._blurred(image), expected, atol=1e-6)


def test_an_exposure_is_a_line_through_blurred_colours() -> None:
    photo = np.random.default_rng(0).random((30, 40, 3)) * [1, 1, 0] + [0, 0, 0.5]
    gain, offset = enlarge._exposure(photo, photo * [0.5, 9, 3] + [0.1, 0.2, -1])
    x = enlarge._blurred(photo).reshape(-1, 3)
    variance = x.var(axis=0)
    expected = ((variance * [0.5, 9, 3] + 1e-4) / (variance + 1e-4)).clip(0.25, 4)
    np.testing.assert_allclose(gain, expected, rtol=1e-5)
    assert gain[1] == 4 and gain[2] == pytest.approx(1) and gain.dtype == offset.dtype == np.float32
    means = x.mean(axis=0)
    np.testing.assert_allclose(offset, means * [0.5, 9, 3] + [0.1, 0.2, -1] - expected * means, atol=1e-5)
    assert enlarge._exposure(photo, -photo)[0][0] == 0.25


def test_photos_take_on_an_exposure_within_0_and_1() -> None:
    photos = np.array([[[[0.1, 0.5, 0.9]]], [[[0.2, 0.2, 0.2]]]], np.float32)
    exposure = [(np.float32([2, 2, 2]), np.float32([0, -0.5, 0])), (np.float32([1, 1, 1]), np.float32([-1, 0, 0.1]))]
    found = enlarge._exposed(photos, exposure)
    np.testing.assert_allclose(found[:, :, 0, 0], [[0.2, 0.5, 1], [0, 0.2, 0.3]], rtol=1e-5)


def flat(views: int = 1, **fields: Any) -> Gaussians:
    """Gaussians of 8 × 10 pixels at z = 4 before cameras at x = 0, 1, …, of the origin (0, 0, 1)."""
    cameras = tuple(camera(float(n)) for n in range(views))
    lead = (views, 8, 10)
    means = np.broadcast_to([0.5, 0, 3], (*lead, 3))
    plain = {
        "means": means, "quats": np.tile([1.0, 0, 0, 0], (*lead, 1)),
        "scales": np.broadcast_to([0.1, 0.2, 0.3], (*lead, 3)),
        "opacities": np.full(lead, 0.7), "sh": np.zeros((*lead, 1, 3)) + 0.5,
    }  # fmt: skip
    return Gaussians(**{**plain, **fields}, cameras=cameras, origin=np.array([0, 0, 1.0]))


def test_what_is_known_of_small_pixels_is_nine_maps() -> None:
    photo = np.full((8, 10, 3), 0.6)
    photo[..., 2] = 1.4
    maps = enlarge._maps(flat(2), photo, 1)
    assert maps.shape == (9, 8, 10) and maps.dtype == np.float32
    colour = 0.5 + C0 * 0.5
    expected = [0.6, 0.6, 1, 1 / 4, 0.7, 0.3 * 20 / 4, colour - 0.6, colour - 0.6, colour - 1]
    np.testing.assert_allclose(maps[:, 3, 4], expected, rtol=1e-5)
    np.testing.assert_allclose(enlarge._colours(flat()), np.full((1, 8, 10, 3), colour), rtol=1e-6)


def test_views_at_one_place_count_as_a_thousandth_of_near_apart() -> None:
    photos = np.zeros((2, 3, 8, 10), np.float32)
    fixed = enlarge._fixed_inputs(photos, [camera(), camera()], 0, np.array([1.0, 2, 3]), near=5.0)
    assert float(fixed["unit"].item()) == pytest.approx(1 / (20 * 0.005))
    np.testing.assert_allclose(fixed["c2w"][0, :3, 3], [-1, -2, -3])
    assert fixed["sources"].shape == (1, 3, 8, 10)
    np.testing.assert_allclose(fixed["source_K"][0], camera().K_unit, rtol=1e-6)


def enlarging(**metadata: Any) -> Graph:
    return Graph("enlarge", None, {"pixels": 100, "halo": 3, "networks": ["edge"], **metadata})


@pytest.mark.parametrize(
    ("metadata", "words"),
    [
        ({"pixels": 640 * 480 + 1}, "307201 pixels and a halo of 3, expected 1 to 307200 pixels and a halo"),
        ({"halo": 0}, "metadata says 100 pixels and a halo of 0"), ({"networks": 3}, "metadata lacks"),
        ({"pixels": "x"}, "metadata lacks"),
    ],
)  # fmt: skip
def test_damaged_metadata_is_refused(metadata: dict[str, Any], words: str) -> None:
    with pytest.raises(ModelError, match=words):
        Enlarger.of(enlarging(**metadata))
    found = Enlarger.of(enlarging(pixels=640 * 480, halo=1))
    assert (found.pixels, found.halo, found.networks) == (307200, 1, ("edge",))


def test_colours_that_depend_on_the_view_cannot_be_enlarged(monkeypatch: pytest.MonkeyPatch) -> None:
    shiny = flat(2, sh=np.zeros((2, 8, 10, 4, 3)))
    monkeypatch.setattr(enlarge, "predict", lambda *_: shiny)
    with pytest.raises(ModelError, match="net: view-dependent colours, which cannot be enlarged"):
        cameras = [camera(float(n), 40, 32) for n in range(2)]
        network = Graph("net", None, {})
        enlarge.predict_large(
            np.zeros((2, 32, 40, 3), np.float32), cameras, 1, 9, network, Enlarger.of(enlarging(pixels=80))
        )


# ---- groups ---------------------------------------------------------------------------------------------------------


def test_an_origin_is_the_middle_of_captures_beyond_128_near_planes() -> None:
    assert walk._origin([camera(256.0), camera(0)], 2.0).tolist() == [0, 0, 0]
    assert walk._origin([camera(257.0), camera(0)], 2.0).tolist() == [128.5, 0, 0]


def test_photos_are_handed_to_the_network_with_their_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def network(images: Any, cameras: Any, near: float, far: float, graph: Any) -> Gaussians:
        asked.append((images[:, 0, 0, 0].tolist(), [c.centre[0] for c in cameras], near, far, graph))
        return replace(flat(len(cameras)), cameras=tuple(cameras))

    monkeypatch.setattr(walk, "predict", network)
    images = np.arange(3, dtype=np.float32)[:, None, None, None] * np.ones((1, 8, 10, 3), np.float32)
    cameras = [camera(float(n)) for n in range(3)]
    walk.predict_grouped(images, cameras, 1.0, 9.0, "g", [Group((0, 1, 2), (0, 1, 2))])  # type: ignore[arg-type]
    assert asked == [([0, 1, 2], [0, 1, 2], 1.0, 9.0, "g")]
    shown: list[Any] = []

    def show(items: Any, total: int, note: Any) -> Any:
        shown.append(total)
        return iter(items)

    groups = [Group((1, 0), (0,)), Group((2, 1), (1, 2))]
    walk.predict_grouped(images, cameras, 1.0, 9.0, "g", groups)  # type: ignore[arg-type]
    both = [([1, 0], [1, 0], 1.0, 9.0, "g"), ([2, 1], [2, 1], 1.0, 9.0, "g")]
    assert asked[1:] == both
    run = lambda views: network(images[list(views)], [cameras[v] for v in views], 1.0, 9.0, "g")  # noqa: E731
    found = walk.predict_groups(cameras, 1.0, groups, run, show)
    assert asked[3:] == both and shown == [3]
    assert [c.centre[0] for c in found.cameras] == [0, 1, 2] and not found.origin.any()
    np.testing.assert_allclose(found.means[..., 2], 4)  # from each group's origin to the scene's


@pytest.mark.parametrize(
    ("kept", "words"),
    [((0, 1, 2), "photo 3 shows nothing that others do from another place; "),
     ((0, 2), "photo 1 shows nothing that others do from another place, nor do 1 more; "), ((3,), ", nor do 2 more; ")],
)  # fmt: skip
def test_photos_of_no_group_are_counted(monkeypatch: pytest.MonkeyPatch, kept: tuple[int, ...], words: str) -> None:
    sizes: list[Any] = []
    monkeypatch.setattr(walk, "grouped", lambda neighbours, *size: sizes.append(size) or [Group((0, 1, 2, 3), kept)])
    with pytest.raises(InputError) as error:
        walk.capture_groups([camera(float(n)) for n in range(4)], 1, 9, NetworkLimits(2, 3))
    assert str(error.value).endswith(f"{words}leave out what matches nothing") and sizes == [(3, 2)]


# ---- what a network is given ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("metadata", "words"),
    [
        ({"stride": 4097}, "metadata 'stride' is 4097, accepted are whole numbers from 1 to 4096"),
        ({"stride": 0}, "metadata 'stride' is 0,"), ({"min_views": True}, "metadata 'min_views' is True,"),
        ({"size": [1]}, "metadata 'size' is \\[1\\], accepted are \\[H, W\\]"),
        ({"size": [1, 0]}, "metadata 'size' is 0,"),
        ({"min_views": 7}, "metadata says 7 to 6 views, expected min_views <= max_views"),
    ],
)  # fmt: skip
def test_limits_that_no_network_has(metadata: dict[str, Any], words: str) -> None:
    with pytest.raises(ModelError, match=words):
        NetworkLimits.of(Graph("g", None, metadata))


def test_limits_are_what_the_metadata_says_or_two_to_six_views_of_any_size() -> None:
    assert NetworkLimits.of(Graph("g", None, {})) == NetworkLimits(2, 6, 1, 1, None)
    given = {"min_views": 6, "stride": 4096, "min_side": 1, "size": [3, 4], "other": 0}
    assert NetworkLimits.of(Graph("g", None, given)) == NetworkLimits(6, 6, 4096, 1, (3, 4))


def given(views: int = 2, height: int = 8, width: int = 10, **limits: Any) -> dict[str, np.ndarray]:
    images = np.zeros((views, height, width, 3), np.float32)
    return network_inputs(
        images, [camera(float(n), width, height) for n in range(views)], 1, 9, NetworkLimits(**limits)
    )


def test_inputs_by_hand() -> None:
    found = given(stride=6, min_side=9)
    assert (
        found["images"].shape == (2, 3, 12, 12) and found["near"].tolist() == [1, 1] and found["far"].tolist() == [9, 9]
    )
    np.testing.assert_allclose(found["K"][0], [[20 / 12, 0, 5 / 12], [0, 20 / 12, 4 / 12], [0, 0, 1]], rtol=1e-6)
    assert found["c2w"][:, 0, 3].tolist() == [-0.5, 0.5]
    assert given(stride=1, min_side=9)["images"].shape == (2, 3, 9, 10)
    assert given(1, min_views=1)["images"].shape == (1, 3, 8, 10) and given(size=(8, 10))["images"].shape[2:] == (8, 10)
    for limits, words in (
        ({"size": (8, 11)}, "images: 8x10 (HxW), this network was exported for 8x11 alone"),
        ({"min_views": 3}, "images: 2 views, expected 3 to 6"), ({"max_views": 1}, "images: 2 views, expected 2 to 1"),
    ):  # fmt: skip
        with pytest.raises(InputError) as error:
            given(**limits)
        assert str(error.value) == words


def test_poses_a_millionth_of_near_apart_are_one() -> None:
    def check(x: float, near: float, turn: float = 0.0) -> None:
        second = camera(x)
        c2w = second.c2w.copy()
        c2w[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        predict._check_poses([camera(), Camera(second.K, c2w, 10, 8)], near)

    check(2.1e-6, 2.0)
    check(0.0, 2.0, 1.1e-6)
    for x, turn in ((1.9e-6, 0.0), (0.0, 0.9e-6)):
        with pytest.raises(InputError, match="views 0 and 1 have the same pose"):
            check(x, 2.0, turn)
