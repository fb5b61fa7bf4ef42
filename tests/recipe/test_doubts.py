"""What is named as wrong with a scene, at the limits: made-up costs in place of thumbnails, cameras read otherwise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from tinysplat_runtime.recipe import doubts as room
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.look import PLANES, UNSEEN, Look
from tinysplat_runtime.scene.scenes import Frame, Scene

HEIGHT, WIDTH = 6, 8
DEPTHS = 1 / np.linspace(1 / 2.0, 1 / 10.0, PLANES)


def camera(x: float, height: int = HEIGHT, width: int = WIDTH) -> Camera:
    c2w = np.eye(4)
    c2w[:3, :3] = [[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]]
    c2w[:3, 3] = x, 0.5 * x * x, 3.0
    return Camera([[9, 0.25, width / 2 + 1], [0, 7, height / 2 - 1], [0, 0, 1]], c2w, width, height)


def scene_of(costs: Sequence[float], height: int = HEIGHT, width: int = WIDTH) -> room._Thumbnails:
    """Photos of noise, each with a cost, at cameras farther and farther apart."""
    count = len(costs)
    images = np.random.default_rng(count).uniform(0.2, 0.8, (count, height, width, 3))
    cameras = [camera(float(v * v), height, width) for v in range(count)]
    looks = [Look(np.full((1, height, width), cost), DEPTHS[:1]) for cost in costs]
    return room._Thumbnails(images, cameras, tuple(f"photo {v + 1}" for v in range(count)), DEPTHS, looks)


def test_thumbnails_have_planes_from_near_to_far_evenly_in_inverse_depth_and_names_from_1(tmp_path: Path) -> None:
    from tinysplat_runtime.scene.images import write_png

    for name in "ab":
        write_png(tmp_path / f"{name}.png", np.random.default_rng(0).integers(0, 255, (96, 192, 3)).astype(np.uint8))
    frames = tuple(Frame(camera(x, 96, 192), tmp_path / f"{name}.png") for x, name in enumerate("ab"))
    seen = room._Thumbnails.of(Scene(tmp_path, frames, 2.0, 10.0))
    assert seen.names == ("photo 1 (a.png)", "photo 2 (b.png)") and seen.images.shape == (2, 48, 96, 3)
    assert len(seen.depths) == 48
    assert_allclose(seen.depths, DEPTHS)
    assert_allclose(seen.cameras[1].K[:2, 2], [97 / 2, 47 / 2])
    assert [found.costs.shape for found in seen.looks] == [(48, 48, 96)] * 2


# ---- other readings of the cameras -------------------------------------------------------------------------------


def read_by_hand(text: str, images: NDArray, cameras: Sequence[Camera]) -> tuple[NDArray, NDArray, NDArray]:
    """Images, c2w and K as a reading's text says, written a second time."""
    c2w, K = np.stack([one.c2w for one in cameras]), np.stack([one.K for one in cameras])
    if "w2c" in text:
        c2w = np.linalg.inv(c2w)
    elif "OpenGL" in text:
        c2w[:, :, 1:3] = -c2w[:, :, 1:3]
    elif "translations" in text:
        c2w[:, :3, 3] *= float(text.rpartition(" ")[2])
    elif "focal" in text:
        factor = float({"0.666667": 2 / 3}.get(text.rpartition(" ")[2], text.rpartition(" ")[2]))
        K[:, :2, :2] *= factor
    elif "exchanged" in text:
        images = np.stack([images[v] for v in range(len(images) - 1, -1, -1)])
    elif "next" in text:
        images = np.stack([images[-1], *images[:-1]])
    elif "before" in text:
        images = np.stack([*images[1:], images[0]])
    elif "upside" in text:
        images = np.stack([[row[::-1] for row in image[::-1]] for image in images])
    elif "left" in text:  # what was at the right is on top
        images = np.stack([[image[:, column] for column in range(image.shape[1] - 1, -1, -1)] for image in images])
    elif "right" in text:
        images = np.stack([[image[::-1, column] for column in range(image.shape[1])] for image in images])
    return images, c2w, K


COMMON = [
    "c2w holds world-to-camera matrices (w2c): with their inverses",
    "c2w has OpenGL axes (y up, z backward) where OpenCV's are expected: with y and z turned",
    *(f"translations are in other units than near and far: times {unit}"
      for unit in ("1000", "100", "10", "0.1", "0.01", "0.001")),
    *(f"focal lengths are off, or of another size of photo: times {by}" for by in ("0.5", "0.666667", "1.5", "2")),
]  # fmt: skip
UPSIDE = "photos are upside down, by their Exif orientation or for want of it: turned by 180 degrees"
SIDE = "photos lie on their side, by their Exif orientation or for want of it: turned to the "


@pytest.mark.parametrize(
    ("views", "height", "more"),
    [
        (2, HEIGHT, ["photos are swapped (left for right?): exchanged", UPSIDE]),
        (3, HEIGHT, [
            "photos are in the reverse order of their cameras: exchanged",
            "photos belong to the next camera: each moved by one",
            "photos belong to the camera before: each moved by one", UPSIDE,
        ]),
        (2, WIDTH, ["photos are swapped (left for right?): exchanged", UPSIDE, f"{SIDE}left", f"{SIDE}right"]),
    ],
)  # fmt: skip
def test_cameras_and_photos_are_read_in_every_way_that_the_words_say(views: int, height: int, more: list[str]) -> None:
    seen = scene_of([0.1] * views, height)
    readings = list(room._readings(seen))
    assert [reading.text for reading in readings] == COMMON + more
    for reading in readings:
        images, c2w, K = read_by_hand(reading.text, seen.images, seen.cameras)
        assert_array_equal(reading.images, images, err_msg=reading.text)
        assert_allclose([one.c2w for one in reading.cameras], c2w, atol=1e-12, err_msg=reading.text)
        assert_allclose([one.K for one in reading.cameras], K, rtol=1e-6, err_msg=reading.text)
        is_focal = reading.text.startswith("focal")
        assert reading.better == (0.8 if is_focal else 0.75)
        assert (reading.zoom == 0) != is_focal
        assert all((one.width, one.height) == (WIDTH, height) for one in reading.cameras)
    assert [round(reading.zoom, 3) for reading in readings if reading.zoom] == [0.5, 0.667, 1.5, 2.0]


def test_a_unit_that_no_camera_may_have_leaves_the_camera() -> None:
    far = Camera(camera(0).K, np.block([[np.eye(3), np.full((3, 1), 1e14)], [np.zeros(3), 1.0]]), WIDTH, HEIGHT)
    assert room._scaled(far, 1000.0) is far
    assert_allclose(room._scaled(far, 0.1).centre, 1e13)


@pytest.fixture
def costing(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[str]]:
    """`_camera_fault` where readings cost what a table says, by the beginnings of their texts, and all others 1."""

    def fault(given: float, table: dict[str, float], elsewhere: float | None = None) -> list[str]:
        seen = scene_of([given, given])
        readings = list(room._readings(seen))

        def look(images: NDArray, cameras: Sequence[Camera], depths: NDArray) -> list[Look]:
            if cameras is seen.cameras and images is seen.images:  # as given, at depths of another zoom
                cost = given if elsewhere is None else elsewhere
            else:
                matrices = [(one.c2w.tobytes(), one.K.tobytes()) for one in cameras]
                text = next(
                    one.text for one in readings if np.array_equal(one.images, images)
                    and [(c.c2w.tobytes(), c.K.tobytes()) for c in one.cameras] == matrices
                )  # fmt: skip
                cost = next((cost for start, cost in table.items() if start in text), 1.0)
            return [Look(np.full((1, HEIGHT, WIDTH), cost + step), depths[:1]) for step in (0.001, -0.001)]

        monkeypatch.setattr(room, "look", look)
        return room._camera_fault(seen)

    return fault


@pytest.mark.parametrize(
    ("given", "table", "named"),
    [
        (0.0799, {"w2c": 0.01}, []),
        (0.08, {"w2c": 0.01}, ["w2c"]),
        (0.12, {"w2c": 0.0899}, ["w2c"]),
        (0.12, {"w2c": 0.0901}, []),
        (0.12, {"times 2": 0.0959}, ["times 2"]),
        (0.12, {"times 2": 0.0961}, []),
        (0.12, {"w2c": 0.05, "OpenGL": 0.0539}, ["w2c", "OpenGL"]),
        (0.12, {"w2c": 0.05, "OpenGL": 0.0541}, ["w2c"]),
        (0.12, {"OpenGL": 0.05, "w2c": 0.0501}, ["OpenGL", "w2c"]),
        (0.12, {"w2c": 0.0503, "OpenGL": 0.0502, "exchanged": 0.0501, "upside": 0.05},
         ["upside", "exchanged", "OpenGL"]),
        (0.12, {"w2c": 0.0899, "OpenGL": 0.0901}, ["w2c"]),
        (0.2425, {}, []),
        (0.2426, {}, ["back to back"]),
        (0.2499, {"w2c": 0.1}, ["w2c"]),
    ],
)  # fmt: skip
def test_readings_are_named_that_are_much_better_the_best_first(costing, given: float, table, named: list[str]) -> None:
    found = costing(given, table)
    assert len(found) == bool(named)
    parts = found[0].split("; or ") if found else []
    assert len(parts) == len(named) and all(word in part for word, part in zip(named, parts, strict=True)), found
    if named == ["back to back"]:
        assert found == ["the cameras stand back to back: no photo shows what another does between near and far"]
    elif named:
        assert found[0].endswith(", photos agree far better")


def test_focal_lengths_are_no_fault_where_other_depths_explain_as_well(costing) -> None:
    assert costing(0.12, {"times 2": 0.05}, elsewhere=0.0626) != []  # 0.05 is less than 0.8 of it
    assert costing(0.12, {"times 2": 0.05}, elsewhere=0.0624) == []
    assert costing(0.12, {"w2c": 0.05}, elsewhere=0.01) != []


def test_depths_of_another_zoom_are_those_divided_by_it(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, depths = scene_of([0.2, 0.2]), []

    def look(images: NDArray, cameras: Sequence[Camera], given: NDArray) -> list[Look]:
        depths.append(given)
        return [Look(np.full((1, HEIGHT, WIDTH), 0.01), given[:1])] * 2

    monkeypatch.setattr(room, "look", look)
    assert room._camera_fault(seen)
    others = [given for given in depths if not np.array_equal(given, DEPTHS)]
    assert_allclose(others, [DEPTHS * 2, DEPTHS * 1.5, DEPTHS / 1.5, DEPTHS / 2])


@pytest.mark.parametrize(
    ("x", "y", "place"),
    [
        (0.1, 0.1, ""), (0.9, 0.9, ""), (0.5, 0.5, ""), (0.09, 0.5, "(9 %, 50 %)"), (0.91, 0.5, "(91 %, 50 %)"),
        (0.5, 0.09, "(50 %, 9 %)"), (0.5, 0.91, "(50 %, 91 %)"), (0.0, 1.0, "(0 %, 100 %)"),
    ],
)  # fmt: skip
def test_a_principal_point_belongs_into_the_inner_four_fifths(x: float, y: float, place: str) -> None:
    found = room._off_centre(Camera([[9, 0, 100 * x], [0, 9, 50 * y], [0, 0, 1]], np.eye(4), 100, 50))
    wanted = (
        f"K's principal point lies at {place} of width and height, where it is near (50 %, 50 %): of another size of "
        "photo, or missing"
    )
    assert found == (wanted if place else "")


def test_the_first_principal_point_is_told_whatever_the_cost() -> None:
    seen = scene_of([0.01, 0.01, 0.01])
    cameras = [
        seen.cameras[0],
        *(Camera([[9, 0, 0], [0, 9, 3], [0, 0, 1]], c.c2w, WIDTH, HEIGHT) for c in seen.cameras[1:]),
    ]
    (found,) = room._camera_fault(replace(seen, cameras=cameras))
    assert found.startswith("photo 2: K's principal point lies at (0 %, 50 %)")


# ---- photos ------------------------------------------------------------------------------------------------------


def test_photos_of_one_colour_and_twins_are_told_once_each() -> None:
    seen = scene_of([0.1] * 5)
    images = seen.images.copy()
    images[1] = 0.5
    images[1, 0, 0] += 3.9 / 255
    images[3] = images[1]  # a twin that shows nothing is told of as such alone
    images[4] = images[2]
    assert room._useless(replace(seen, images=images)) == [
        "photo 2 is of one colour, which shows nothing to find depth by",
        "photo 4 is of one colour, which shows nothing to find depth by",
        "photo 5 is the same picture as photo 3, from another place",
    ]
    images[1, 0, 0] += 0.2 / 255
    images[3], images[4] = seen.images[3], seen.images[0]
    assert room._useless(replace(seen, images=images)) == ["photo 5 is the same picture as photo 1, from another place"]
    images[4] = seen.images[4]
    assert room._useless(replace(seen, images=images)) == []


@pytest.mark.parametrize(
    ("looked", "least", "odd"),
    [
        ([0.2, 0.05], {}, []),
        ([0.05, 0.05, 0.0999], {2: 0.9}, []),
        ([0.05, 0.05, 0.1001], {2: 0.1}, [3]),
        ([0.05, 0.05, 0.2], {2: 0.0999}, []),
        ([0.2, 0.2, 0.34], {0: 0.2, 1: 0.2, 2: 0.341}, [3]),
        ([0.2, 0.2, 0.34], {0: 0.2, 1: 0.2, 2: 0.339}, []),
        ([0.05, 0.25, 0.05, 0.25], {1: 0.2, 3: 0.2}, [2, 4]),
        ([0.11, 0.11, 0.11, 0.5], {0: 0.1, 1: 0.1, 2: 0.1, 3: 0.5}, [4]),
    ],
)
def test_odd_photos_cost_much_at_the_best_of_others(monkeypatch, looked, least, odd: list[int]) -> None:
    asked = []

    def cost(seen: room._Thumbnails, view: int) -> float:
        asked.append(view)
        return least[view]

    monkeypatch.setattr(room, "_least_cost", cost)
    found = room._odd(scene_of(looked))
    said = "hardly matches the others: too little overlap, a wrong pose, another scene or moment"
    assert found == [f"photo {number} {said}" for number in odd]
    if len(looked) > 2 and max(looked) >= 0.1:
        assert asked == [view for view, cost in enumerate(looked) if cost >= 0.1]


def test_a_photo_is_held_against_the_three_nearest_as_they_are_and_evenly_bright(monkeypatch) -> None:
    seen = scene_of([0.1] * 6)  # cameras at x = 0, 1, 4, 9, 16, 25
    seen.images[2] *= 0.5
    pairs = []

    def look_at(image, own, other, its, depths) -> Look:
        view, partner = (next(v for v, c in enumerate(seen.cameras) if c is one) for one in (own, its))
        is_even = not np.array_equal(image, seen.images[view])
        assert np.array_equal(other, seen.images[partner]) != is_even and depths is seen.depths
        pairs.append((is_even, view, partner))
        return Look(np.full((1, 1, 1), 0.2 - 0.02 * partner - 0.01 * is_even), DEPTHS[:1])

    monkeypatch.setattr(room, "look_at", look_at)
    assert room._least_cost(seen, 2) == pytest.approx(0.2 - 0.02 * 3 - 0.01)
    assert sorted(pairs) == [(even, 2, other) for even in (False, True) for other in (0, 1, 3)]


def test_brightness_is_evened_out_by_factors_of_two_at_most() -> None:
    levels = np.array([0.0, 0.1, 0.3, 0.4, 0.9])
    images = np.ones((5, 2, 4, 3)) * levels[:, None, None, None]
    images[2] += np.linspace(-0.1, 0.1, 24).reshape(2, 4, 3)
    mean = levels.mean()  # 0.34
    factors = [2, 2, mean / 0.3, mean / 0.4, 0.5]
    assert_allclose(room._even(images), images * np.array(factors)[:, None, None, None])
    assert_allclose(room._even(np.full((2, 2, 2, 3), [[[[4e-4]]], [[[2e-3]]]])).mean(axis=(1, 2, 3)), [4.8e-4, 1.2e-3])


# ---- depths ------------------------------------------------------------------------------------------------------


def matching(best: Sequence[int], clear: float = 1.0, near: float = 2.0, far: float = 10.0) -> room._Thumbnails:
    """Two photos whose pixels have their best depth at planes `best` in turn; a share of them tells it clearly."""
    costs = np.full((PLANES, 10, len(best)), 0.2)
    for column, plane in enumerate(best):
        costs[plane, :, column] = 0.0
        costs[plane, round(10 * clear) :, column] = 0.15
    depths = 1 / np.linspace(1 / near, 1 / far, PLANES)
    return replace(scene_of([0.1, 0.1]), looks=[Look(costs, depths)] * 2, depths=depths)


@pytest.mark.parametrize(
    ("alike", "clear", "at_all"),
    [(0.25, 1.0, True), (0.24, 1.0, False), (0.25, 0.1, True), (0.9, 0.0, False)],
)
def test_photos_match_where_a_quarter_has_one_depth_from_both_sides_and_a_tenth_tells_it(
    monkeypatch, alike: float, clear: float, at_all: bool
) -> None:
    monkeypatch.setattr(room, "agreed", lambda found, camera, other, its: alike)
    monkeypatch.setattr(room, "look", lambda images, cameras, depths: matching([3], clear).looks)
    seen = matching([3], clear)
    assert bool(room._match(seen, seen.looks)) is at_all
    said = "hardly match anywhere from near 2 to far 10: these, poses or photos are wrong"
    assert room._range_doubts(seen) == ([] if at_all else [f"photo 1 and photo 2 {said}"])
    more = replace(seen, names=("a", "b", "c"))
    assert room._range_doubts(more) == ([] if at_all else [f"photos {said}"])


def test_each_photo_is_asked_about_the_nearest_one_and_the_best_answer_counts(monkeypatch) -> None:
    seen = scene_of([0.1] * 4)  # at 0, 1, 4, 9: nearest are 1, 0, 1, 2
    looks = [Look(np.zeros((1, 1, 1)), DEPTHS[:1]) for _ in range(4)]
    looks[3] = matching([5]).looks[0]
    asked = []

    def agree(found: Look, own: Camera, other: Look, its: Camera) -> float:
        v, u = (next(i for i, one in enumerate(looks) if one is given) for given in (found, other))
        assert own is seen.cameras[v] and its is seen.cameras[u]
        asked.append((v, u))
        return 0.25 if v == 2 else 0.0

    monkeypatch.setattr(room, "agreed", agree)
    assert room._match(seen, looks)
    assert asked == [(0, 1), (1, 0), (2, 1), (3, 2)]


def test_photos_that_match_once_evenly_bright_are_no_doubt(monkeypatch) -> None:
    dark, even = matching([5]), matching([7])
    monkeypatch.setattr(room, "look", lambda images, cameras, depths: even.looks)
    monkeypatch.setattr(room, "agreed", lambda found, *_: 0.0 if found is dark.looks[0] else 0.5)
    assert room._range_doubts(dark) == []


@pytest.mark.parametrize(
    ("best", "near", "far", "extent"),
    [
        ([34] * 20, 0.1, 100.0, (34, 34)),  # plane 34 of 47 lies beyond 0.72 of them
        ([33] * 20, 0.1, 100.0, None),
        ([34] * 20, 2.0, 10.0, None),  # 4.75, less than three times near
        ([33] * 3 + [40] * 15 + [45] * 2, 0.1, 100.0, None),
        ([33] + [40] * 18 + [45], 0.1, 100.0, (40, 40)),
        ([33] + [40] * 16 + [45] * 3, 0.1, 100.0, (40, 45)),
        ([35] * 20, 0.5, 2.4, None),
        ([45] * 20, 1.0, 3.5, (45, 45)),
        ([45] * 20, 1.0, 3.1, None),
    ],
)
def test_a_range_is_too_wide_where_nearly_all_lies_beyond_its_inverse_middle_and_far_behind_near(
    monkeypatch, best: list[int], near: float, far: float, extent: tuple[int, int] | None
) -> None:
    monkeypatch.setattr(room, "agreed", lambda *_: 1.0)
    shown = [1 / (1 / near + plane / 47 * (1 / far - 1 / near)) for plane in extent or ()]
    extents = " to ".join(f"{depth:.3g}" for depth in shown)
    said = f"near {near:g} and far {far:g} lie far about what photos show, most of it from {extents}"
    assert room._range_doubts(matching(best, near=near, far=far)) == ([said] if extent else [])


def test_no_range_is_told_of_cameras_at_one_place(monkeypatch) -> None:
    monkeypatch.setattr(room, "agreed", lambda *_: 0.0)
    monkeypatch.setattr(room, "look", lambda images, cameras, depths: matching([5]).looks)
    seen = matching([5])
    for apart, said in ((1.9e-6, 0), (2.1e-6, 1)):  # a millionth of near
        moved = [
            Camera(c.K, np.block([[np.eye(3), np.array([[0], [v * apart], [3]])], [np.zeros(3), 1.0]]), WIDTH, HEIGHT)
            for v, c in enumerate(seen.cameras)
        ]
        assert len(room._range_doubts(replace(seen, cameras=moved))) == said


def test_the_first_kind_of_doubt_is_told_alone(monkeypatch) -> None:
    told = {"_useless": ["a"], "_camera_fault": ["b"], "_odd": ["c"], "_range_doubts": ["d"]}
    monkeypatch.setattr(room._Thumbnails, "of", classmethod(lambda cls, scene: None))
    for name, lines in told.items():
        for other in told:
            monkeypatch.setattr(room, other, lambda seen, other=other: told[other] if other >= "" else [])
        for earlier in list(told)[: list(told).index(name)]:
            monkeypatch.setattr(room, earlier, lambda seen: [])
        assert room.doubts(None) == lines  # type: ignore[arg-type]


def test_what_photos_do_not_show_of_each_other_costs_a_quarter() -> None:
    assert UNSEEN == 0.25 and Look(np.full((2, 1, 2), [[[0.9, 0.1]], [[0.4, 0.2]]]), DEPTHS[:2]).cost == 0.175
