"""What thumbnails tell of cameras and depths, on two walls at known depths and with cameras given wrongly."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scenes import tells

import tinysplat_runtime as ts
from tinysplat_runtime.recipe.doubts import doubts
from tinysplat_runtime.scene.lenses import opencv_lens
from tinysplat_runtime.scene.look import UNSEEN, agreed, look_at, nearest, neighbours, range_guessed, range_seen, told
from tinysplat_runtime.scene.scenes import Frame, Scene, even_sizes

DEPTHS = (2.0, 5.0)
H, W, F = 144, 192, 162.0


def camera(x: float, turn: float = 0.0) -> ts.Camera:
    c2w = np.eye(4)
    c2w[:3, :3] = [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
    c2w[:3, 3] = x, 0.05, 1.0
    return ts.Camera(np.array([[F, 0, W / 2], [0, F, H / 2], [0, 0, 1]]), c2w, W, H)


def texture(x: NDArray, y: NDArray) -> NDArray:
    """Colours of a wall, smooth over a tenth of a unit."""
    rng = np.random.default_rng(3)
    waves = rng.normal(size=(3, 24, 2)) * 7
    phases = rng.uniform(0, 6, (3, 24))
    channels = [
        0.5 + 0.1 * np.sin(x[..., None] * w[:, 0] + y[..., None] * w[:, 1] + p).sum(-1)
        for w, p in zip(waves, phases, strict=True)
    ]
    return np.stack(channels, axis=-1).clip(0, 1)


def photo(view: ts.Camera) -> NDArray:
    """Two walls: one at z = 1 + DEPTHS[0] left of x = 0, one at 1 + DEPTHS[1] behind it."""
    v, u = np.mgrid[0:H, 0:W] + 0.5
    rays = np.stack([(u - W / 2) / F, (v - H / 2) / F, np.ones_like(u)], -1) @ view.c2w[:3, :3].T
    places = [view.centre + rays * ((1 + z - view.centre[2]) / rays[..., 2])[..., None] for z in DEPTHS]
    near, far = (texture(place[..., 0], place[..., 1] + 9 * k) for k, place in enumerate(places))
    return np.where((places[0][..., 0] < 0)[..., None], near, far)


def stored(folder: Path, views: list[ts.Camera], photos: list[NDArray]) -> Scene:
    frames = []
    for i, (view, pixels) in enumerate(zip(views, photos, strict=True)):
        Image.fromarray((pixels * 255).astype(np.uint8)).save(folder / f"{i}.png")
        frames.append(Frame(view, folder / f"{i}.png"))
    return Scene(folder, tuple(frames), 1.5, 6.0)


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    views = [camera(-0.15, 0.05), camera(0.15, -0.05)]
    return stored(tmp_path, views, [photo(view) for view in views])


def test_a_look_is_what_each_pixel_costs_at_each_depth() -> None:
    """Colour by colour and pixel by pixel, in float64; then means over windows of 5×5 whose borders are repeated."""
    rng = np.random.default_rng(0)
    one, other = (
        ts.Camera([[9, 0, 5], [0, 8, 3.5], [0, 0, 1]], view.c2w, 11, 7) for view in (camera(-0.2), camera(0.3, 0.1))
    )
    image, its, depths = rng.random((7, 11, 3)), rng.random((7, 11, 3)), np.array([1.0, 2.5, 7.0])
    costs = np.full((3, 7, 11), UNSEEN)
    for p, v, u in np.ndindex(costs.shape):
        ray = one.rotation.T @ np.linalg.inv(one.K) @ [u + 0.5, v + 0.5, 1]
        x, y, z = other.K @ other.rotation @ (one.centre + depths[p] * ray - other.centre)
        if z > 0 and 0 <= x / z < 11 and 0 <= y / z < 7:
            costs[p, v, u] = np.abs(its[int(y / z), int(x / z)] - image[v, u]).mean()
    padded = np.pad(costs, ((0, 0), (2, 2), (2, 2)), mode="edge")
    smooth = np.lib.stride_tricks.sliding_window_view(padded, (5, 5), axis=(1, 2)).mean(axis=(3, 4))
    found = look_at(image, one, its, other, depths)
    np.testing.assert_allclose(found.costs, smooth, atol=1e-6)
    assert found.cost == pytest.approx(np.minimum(smooth.min(axis=0), UNSEEN).mean(), abs=1e-6)


def test_photos_of_two_walls_tell_depths_and_agree_from_both_sides(scene: Scene) -> None:
    images, cameras = scene.images(), scene.cameras
    depths = 1 / np.linspace(1 / 1.5, 1 / 6, 48)
    here, there = (look_at(images[a], cameras[a], images[b], cameras[b], depths) for a, b in ((0, 1), (1, 0)))
    assert agreed(here, cameras[0], there, cameras[1]) > 0.8 and here.clear.mean() > 0.6
    (share,) = told(images, cameras, [(0, 1)], depths)
    (other,) = told(np.stack([images[0], images[0][::-1]]), cameras, [(0, 1)], depths)
    assert share > 0.6 > 4 * other
    assert nearest([camera(x) for x in (0, 1, 3, 3.5)]) == [1, 0, 3, 2]
    assert neighbours([camera(x) for x in (0, 1, 3)]).tolist() == [[1, 2], [0, 2], [1, 0]]


def changed(scene: Scene, change) -> Scene:
    def moved(i: int, frame: Frame) -> Frame:
        c2w = change(i, frame.camera.c2w.copy())
        return dataclasses.replace(frame, camera=ts.Camera(frame.camera.K, c2w, W, H))

    return dataclasses.replace(scene, frames=tuple(moved(i, frame) for i, frame in enumerate(scene.frames)))


def scaled(factor: float):
    return lambda i, c2w: np.block([[c2w[:3, :3], factor * c2w[:3, 3:]], [c2w[3:]]])


def turned_round(i: int, c2w: NDArray) -> NDArray:
    return c2w @ np.diag([-1.0, 1, -1, 1]) if i else c2w


def test_right_cameras_are_not_suspected(scene: Scene) -> None:
    assert doubts(scene) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda i, c2w: np.linalg.inv(c2w), "w2c"),
        (lambda i, c2w: c2w @ np.diag([1.0, -1, -1, 1]), "OpenGL"),
        (scaled(1000), "times 0.001,"),
        (scaled(0.01), "times 100,"),
        (turned_round, "photo 1 (0.png) and photo 2 (1.png) have much in common, but not where the cameras say"),
    ],
)
def test_what_is_wrong_with_cameras_is_named(scene: Scene, change, words: str) -> None:
    (fault,) = doubts(changed(scene, change))
    assert words in fault


def test_photos_that_look_different_ways_are_told(tmp_path: Path) -> None:
    views = [camera(-0.15), camera(0.15, np.pi)]
    behind = texture(*np.meshgrid(np.linspace(20, 24, W), np.linspace(20, 23, H)))
    (fault,) = doubts(stored(tmp_path, views, [photo(views[0]), behind]))
    assert "near 1.5" in fault and "far 6" in fault


def with_intrinsics(scene: Scene, change) -> Scene:
    def moved(frame: Frame) -> Frame:
        K = frame.camera.K.copy()
        change(K)
        return dataclasses.replace(frame, camera=ts.Camera(K, frame.camera.c2w, W, H))

    return dataclasses.replace(scene, frames=tuple(map(moved, scene.frames)))


def zoomed(factor: float):
    def change(K: NDArray) -> None:
        K[:2, :2] *= factor

    return change


def centred_at(x: float, y: float):
    def change(K: NDArray) -> None:
        K[:2, 2] = x, y

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (zoomed(0.5), "focal lengths are off, or of another size of photo: times 2"),
        (zoomed(1.5), "focal lengths are off, or of another size of photo: times 0.66"),
        (centred_at(0, 0), "photo 1 (0.png): K's principal point lies at (0 %, 0 %)"),
        (centred_at(W, H), "principal point lies at (100 %, 100 %)"),
        (centred_at(W / 2, 0.95 * H), "(50 %, 95 %)"),
        (centred_at(0.4 * W, 0.6 * H), "the principal point is off: with cx and cy in the middle of the photo"),
        (centred_at(H / 2, W / 2), "the principal point is off: with cx and cy exchanged"),
        (zoomed(1.02), None),
    ],
)
def test_what_is_wrong_with_intrinsics_is_named(tmp_path: Path, change, words: str | None) -> None:
    """Of cameras that turn to what they look at: of parallel ones focal lengths are depths in other units."""
    views = [camera(x, -x / 2.5) for x in (-0.3, 0.3)]
    scene = stored(tmp_path, views, [photo(view) for view in views])
    assert doubts(scene) == []
    found = doubts(with_intrinsics(scene, change))
    assert found == [] if words is None else len(found) == 1 and words in found[0]


@pytest.mark.parametrize(
    ("order", "turn", "words"),
    [
        ((1, 0), 0, "photos are swapped (left for right?)"),
        ((2, 1, 0), 0, "in the reverse order of their cameras"),
        ((1, 2, 3, 0), 0, "belong to the"),
        ((0, 1), 2, "turned, by their Exif orientation or for want of it"),
    ],
)
def test_photos_of_other_cameras_or_turned_are_told(tmp_path: Path, order, turn: int, words: str) -> None:
    places = np.array([0.0, 0.35, 0.6, 1.1])[: len(order)]
    views = [camera(x - 0.4, 0.1 * (x - 0.4)) for x in places]
    photos = [np.rot90(photo(view), turn) for view in views]
    assert doubts(stored(tmp_path, views, [photo(view) for view in views])) == []
    (fault,) = doubts(stored(tmp_path, views, [photos[i] for i in order]))
    assert words in fault


def four(folder: Path, change) -> Scene:
    """Four photos of the walls, the second changed."""
    views = [camera(x) for x in (-0.3, -0.1, 0.1, 0.3)]
    photos = [photo(view) for view in views]
    photos[1] = change(photos)
    return stored(folder, views, photos)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda photos: np.zeros_like(photos[1]), ["photo 2 (1.png) is of one colour"]),
        (lambda photos: photos[2], ["photo 3 (2.png) is the same picture as photo 2 (1.png)"]),
        (lambda photos: photos[1][::-1, ::-1], ["photo 2 (1.png) is upside down"]),
        (lambda photos: photos[1][:, ::-1], ["photo 2 (1.png) is mirrored"]),
        (lambda photos: 1 - photos[1], ["photo 2 (1.png) is a negative"]),
        (lambda photos: 0.7 * photos[1], []),
        (lambda photos: photos[1], []),
    ],
    ids=["black", "twice", "upside down", "mirrored", "negative", "darker", "right"],
)
def test_a_photo_that_does_not_belong_is_named(tmp_path: Path, change, words: list[str]) -> None:
    found = doubts(four(tmp_path, change))
    assert len(found) == len(words)
    assert all(tells(doubt, start) for doubt, start in zip(found, words, strict=True))


@pytest.mark.parametrize("turn", [0.0, 0.2, 0.6])
def test_a_photo_is_not_named_for_looking_aside(tmp_path: Path, turn: float) -> None:
    """Cameras are right; of the last photo's pixels the others show fewer the more it looks aside."""
    views = [*(camera(x) for x in (-0.3, -0.1, 0.1)), camera(0.3, turn)]
    assert doubts(stored(tmp_path, views, [photo(view) for view in views])) == []


def test_a_photo_of_another_scene_is_named(tmp_path: Path) -> None:
    other = texture(*np.meshgrid(np.linspace(20, 24, W), np.linspace(20, 23, H)))
    (doubt,) = doubts(four(tmp_path, lambda photos: other))
    assert doubt.startswith("photo 2 (1.png) hardly matches the others, which match each other well")


def test_axes_are_told_by_the_convention_of_the_file(scene: Scene) -> None:
    (scene.path / "transforms.json").touch()
    (fault,) = doubts(changed(scene, lambda i, c2w: c2w @ np.diag([1.0, -1, -1, 1])))
    assert "transform_matrix has OpenCV axes" in fault


def test_mirrored_photos_are_told(tmp_path: Path) -> None:
    views = [camera(-0.3, 0.14), camera(0.3, -0.12)]
    (fault,) = doubts(stored(tmp_path, views, [photo(view)[:, ::-1] for view in views]))
    assert "photos are mirrored, or the world of the cameras is" in fault


def test_of_many_photos_one_of_another_scene_is_named(tmp_path: Path) -> None:
    views = [camera(x, -x / 4) for x in np.linspace(-0.6, 0.6, 13)]
    photos = [photo(view) for view in views]
    photos[6] = texture(*np.meshgrid(np.linspace(20, 24, W), np.linspace(20, 23, H)))
    (doubt,) = doubts(stored(tmp_path, views, photos))
    assert doubt.startswith("photo 7 (6.png) hardly matches the others")


def test_poses_rolled_against_their_photos_are_told(tmp_path: Path) -> None:
    views = [camera(-0.3, 0.14), camera(0.3, -0.12)]
    scene = stored(tmp_path, views, [photo(view) for view in views])
    assert doubts(scene) == []
    roll = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    (fault,) = doubts(changed(scene, lambda _, c2w: c2w @ roll))
    assert "or poses rolled: with photos turned" in fault


def test_a_skew_that_photos_do_not_have_is_told(tmp_path: Path) -> None:
    views = [camera(-0.3, 0.14), camera(0.3, -0.12)]
    scene = stored(tmp_path, views, [photo(view) for view in views])

    def skewed(K: NDArray) -> None:
        K[0, 1] = 0.05 * K[0, 0]

    (fault,) = doubts(with_intrinsics(scene, skewed))
    assert "photo 1 (0.png): K has a skew of 5% of the focal length" in fault


@pytest.mark.parametrize(("k1", "is_told"), [(50.0, True), (0.3, False)])
def test_a_lens_that_there_is_not_is_told(tmp_path: Path, k1: float, is_told: bool) -> None:
    views = [camera(-0.3, 0.14), camera(0.3, -0.12)]
    scene = stored(tmp_path, views, [photo(view) for view in views])
    lens = opencv_lens((F, F), np.array([W / 2, H / 2]), (k1, 0, 0, 0, 0, 0), (H, W), fisheye=False)
    frames = even_sizes([dataclasses.replace(f, camera=lens.camera(f.camera.c2w), lens=lens) for f in scene.frames])
    found = doubts(dataclasses.replace(scene, frames=tuple(frames)))
    assert ["photo 1 (0.png): its distortion (k1, k2, …) shrinks it" in doubt for doubt in found] == [True] * is_told


def test_one_pose_rolled_against_the_others_is_told(tmp_path: Path) -> None:
    scene, (cos, sin) = four(tmp_path, lambda photos: photos[1]), (np.cos(0.17), np.sin(0.17))
    roll = np.array([[cos, -sin, 0, 0], [sin, cos, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    (fault,) = doubts(changed(scene, lambda i, c2w: c2w @ roll if i == 2 else c2w))
    assert "the pose of photo 3 (2.png) is rolled" in fault


@pytest.mark.parametrize("way", [(0, 0.3), (0.4, 0)], ids=["up", "beside"])
def test_one_pose_moved_against_the_others_is_told(tmp_path: Path, way: tuple[float, float]) -> None:
    views = [camera(x, -x / 2.5) for x in (-0.3, -0.1, 0.1, 0.3)]
    scene = stored(tmp_path, views, [photo(view) for view in views])
    moved = np.eye(4)
    moved[:2, 3] = way
    (doubt,) = doubts(changed(scene, lambda i, c2w: moved @ c2w if i == 1 else c2w))
    assert doubt.startswith("photo 2 (1.png) has much in common with others, but not where the cameras say")


@pytest.mark.parametrize(
    ("near", "far", "words"),
    [
        (0.1, 90.0, "near 0.1 and far 90 reach far beyond what the photos show"),
        (12.0, 12.5, "photos agree about depths from 1.9"),
    ],
)
def test_a_depth_range_that_is_far_off_is_told(tmp_path: Path, near: float, far: float, words: str) -> None:
    scene = four(tmp_path, lambda photos: photos[1])
    assert doubts(scene) == []
    (doubt,) = doubts(dataclasses.replace(scene, near=near, far=far))
    assert words in doubt
    assert doubts(dataclasses.replace(scene, near=near, far=far, is_estimated=True)) == []


@pytest.mark.parametrize("wrong", [0, 1])
def test_two_photos_of_different_things_are_named(tmp_path: Path, wrong: int) -> None:
    views = [camera(-0.15, 0.05), camera(0.15, -0.05)]
    photos = [photo(view) for view in views]
    photos[wrong] = texture(*np.meshgrid(np.linspace(20, 24, W), np.linspace(20, 23, H)))
    scene = stored(tmp_path, views, photos)
    for is_estimated, wrong_ in ((False, "near and far, the poses or the photos"), (True, "the poses or the photos")):
        (doubt,) = doubts(dataclasses.replace(scene, is_estimated=is_estimated))
        assert doubt.startswith("photo 1 (0.png) and photo 2 (1.png) do not match at any depth from 1.5 to 6")
        assert f"or {wrong_} are wrong" in doubt


def test_a_range_that_begins_far_too_near_is_told_of_many_depths(scene: Scene) -> None:
    """The two walls lie too far apart for a range to be wrong by how little of it they fill."""
    (doubt,) = doubts(dataclasses.replace(scene, near=0.45))
    assert doubt.startswith("near 0.45 and far 6 reach far beyond what the photos show, most of it from 1.9")


def test_the_depth_range_is_found_from_photos(scene: Scene) -> None:
    near, far = range_seen(scene.images(), scene.cameras)
    assert 0.5 * DEPTHS[0] < near < DEPTHS[0] and DEPTHS[1] < far < 3 * DEPTHS[1]


def test_photos_that_agree_about_nothing_are_told(scene: Scene) -> None:
    noise = np.random.default_rng(0).uniform(size=(2, H, W, 3))
    with pytest.raises(ts.InputError, match="agree about no depth"):
        range_seen(noise, scene.cameras)
    with pytest.raises(ts.InputError, match="one place"):
        range_seen(scene.images(), [scene.cameras[0]] * 2)


def test_cameras_around_a_thing_look_at_it_and_parallel_ones_far_ahead() -> None:
    def at(angle: float) -> ts.Camera:
        c2w = np.eye(4)
        c2w[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        c2w[:3, 3] = -4 * c2w[:3, 2]
        return ts.Camera(np.array([[F, 0, W / 2], [0, F, H / 2], [0, 0, 1]]), c2w, W, H)

    assert range_guessed([at(angle) for angle in (0, 1, 2)]) == pytest.approx((2, 8), rel=1e-6)
    near, far = range_guessed([camera(0), camera(0.2)])
    assert near == pytest.approx(0.3) and far == pytest.approx(6)
