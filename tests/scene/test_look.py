"""What thumbnails tell of cameras and depths, on two walls at known depths and with cameras given wrongly."""

import dataclasses
import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scenes import tells
from scipy.spatial.transform import Rotation

import tinysplat_runtime as ts
from tinysplat_runtime.recipe.doubts import doubts
from tinysplat_runtime.recipe.prepare import prepared
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.scene.lenses import opencv_lens
from tinysplat_runtime.scene.look import range_seen
from tinysplat_runtime.scene.scenes import Frame, Scene, even_sizes
from tinysplat_runtime.scene.turned import as_cameras_have_them

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
    """Two photos of the walls."""
    return walls(tmp_path, [camera(-0.15, 0.05), camera(0.15, -0.05)])


def walls(folder: Path, views: list[ts.Camera], changes: Mapping[int, Callable[[NDArray], NDArray]] = {}) -> Scene:
    """Photos of the walls, of which some are changed, as they were taken."""
    return stored(folder, views, [changes.get(i, np.asarray)(photo(view)) for i, view in enumerate(views)])


def changed(
    scene: Scene,
    pose: Callable[[int, NDArray], NDArray] = lambda i, c2w: c2w,
    lens: Callable[[NDArray], NDArray] = np.asarray,
) -> Scene:
    """The scene with other cameras than those that took its photos."""
    cameras = [ts.Camera(lens(c.K), pose(i, c.c2w), W, H) for i, c in enumerate(scene.cameras)]
    frames = [dataclasses.replace(frame, camera=c) for frame, c in zip(scene.frames, cameras, strict=True)]
    return dataclasses.replace(scene, frames=tuple(frames))


def doubted(scene: Scene, words: str) -> bool:
    """Whether there is a doubt about a scene that tells these words."""
    return any(tells(doubt, words) for doubt in doubts(scene))


def another_scene(_: NDArray | None = None) -> NDArray:
    """A photo of something else."""
    return texture(*np.meshgrid(np.linspace(20, 24, W), np.linspace(20, 23, H)))


def barred(own: NDArray) -> NDArray:
    """A photo with bars at its top and bottom."""
    return np.pad(own[18:-18], ((18, 18), (0, 0), (0, 0)))


def bannered(own: NDArray) -> NDArray:
    """A photo with squares of many greys along its bottom."""
    squares = np.kron(np.random.default_rng(0).random((4, 24)), np.ones((8, 8)))
    return np.concatenate([own[:-32], np.repeat(squares[..., None], 3, axis=2)])


def rolled(degrees: float) -> NDArray:
    return np.block([[Rotation.from_euler("z", degrees, degrees=True).as_matrix(), np.zeros((3, 1))], [0, 0, 0, 1]])


def moved(x: float, y: float) -> NDArray:
    return np.eye(4) + np.pad([[x], [y]], ((0, 2), (3, 0)))


FOUR = [camera(x) for x in (-0.3, -0.1, 0.1, 0.3)]
CONVERGING = [camera(x, -x / 2.5) for x in (-0.3, 0.3)]
TURNED_OUT = [camera(-0.3, 0.14), camera(0.3, -0.12)]


@pytest.mark.parametrize(
    "views",
    [
        *([camera(x, 0.1 * x) for x in row] for row in ([-0.4, -0.05], [-0.4, -0.05, 0.2], [-0.4, -0.05, 0.2, 0.7])),
        *([*FOUR[:3], camera(0.3, turn)] for turn in (0.0, 0.2, 0.6)),  # the last photo shows less the more it turns
        CONVERGING,
        TURNED_OUT,
    ],
)
def test_right_cameras_are_not_suspected(tmp_path: Path, views: list[ts.Camera]) -> None:
    assert doubts(walls(tmp_path, views)) == []


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        (lambda i, c2w: np.linalg.inv(c2w), "w2c"),
        (lambda i, c2w: c2w @ np.diag([1.0, -1, -1, 1]), "OpenGL"),
        (lambda i, c2w: c2w * np.array([[1, 1, 1, 1000]] * 3 + [[1] * 4]), "0.001"),
        (lambda i, c2w: c2w * np.array([[1, 1, 1, 0.01]] * 3 + [[1] * 4]), "100"),
        (lambda i, c2w: c2w @ np.diag([-1.0, 1, -1, 1]) if i else c2w, "photo 1 (0.png) photo 2 (1.png)"),
    ],
)
def test_what_is_wrong_with_poses_is_named(scene: Scene, pose, words: str) -> None:
    assert doubted(changed(scene, pose), words)


@pytest.mark.parametrize("orientation", [2, 3])
@pytest.mark.parametrize("are_cameras_of_stored", [True, False])
def test_photos_that_exif_turns_are_taken_as_their_cameras_have_them(
    tmp_path: Path, orientation: int, are_cameras_of_stored: bool
) -> None:
    here = walls(tmp_path, FOUR)
    exif = Image.Exif()
    exif[0x0112] = orientation
    for frame in here.frames:
        pixels = np.asarray(Image.open(frame.path))
        stored_so = pixels if are_cameras_of_stored else pixels[:: -1 if orientation == 3 else 1, ::-1]
        Image.fromarray(stored_so).save(frame.path, exif=exif)
    found = as_cameras_have_them(here)
    wanted = [(photo(view) * 255).astype(np.uint8) for view in FOUR]
    for frame, pixels in zip(found.frames, wanted, strict=True):
        np.testing.assert_array_equal(frame.photo(), pixels)


def test_units_in_which_nothing_is_drawn_are_told(tmp_path: Path) -> None:
    small = changed(walls(tmp_path, FOUR), lambda i, c2w: c2w * np.array([[1, 1, 1, 1e-4]] * 3 + [[1] * 4]))
    assert doubted(small.between(1.5e-4, 6e-4), "0.00015 0.0006 0.01 1e+04")


@pytest.mark.parametrize("place", [(454321.5, 5351234.25, 300.0), (4_177_000.5, 855_000.25, 4_727_000.75)])
@pytest.mark.parametrize("wrong", [None, 1], ids=["right", "another scene"])
def test_doubts_are_the_same_in_utm_and_ecef(tmp_path: Path, place: tuple[float, ...], wrong: int | None) -> None:
    """There rounding makes lines of cameras in a row not quite parallel."""
    here = walls(tmp_path, FOUR, {} if wrong is None else {wrong: another_scene})
    shift = np.pad(np.array(place)[:, None], ((0, 1), (3, 0)))
    assert doubts(changed(here, lambda i, c2w: c2w + shift)) == doubts(here)


def test_axes_are_told_by_the_convention_of_the_file(scene: Scene) -> None:
    (scene.path / "transforms.json").touch()
    assert doubted(changed(scene, lambda i, c2w: c2w @ np.diag([1.0, -1, -1, 1])), "transform_matrix OpenCV")


@pytest.mark.parametrize(
    ("lens", "words"),
    [
        (lambda K: [[F, 0, 0], [0, F, 0], [0, 0, 1]], "photo 1 (0.png) K"),
        (lambda K: [[F, 0, W], [0, F, H], [0, 0, 1]], "photo 1 (0.png) K"),
        (lambda K: [[F, 0, W / 2], [0, F, 0.95 * H], [0, 0, 1]], "photo 1 (0.png) K"),
        (lambda K: [[F, 0, 0.4 * W], [0, F, 0.6 * H], [0, 0, 1]], "cx"),
        (lambda K: [[F, 0, H / 2], [0, F, W / 2], [0, 0, 1]], "cx"),
        (lambda K: K + np.array([[0, 0.05 * F, 0], [0, 0, 0], [0, 0, 0]]), "photo 1 (0.png) K 5%"),
    ],
)
def test_what_is_wrong_with_intrinsics_is_named(tmp_path: Path, lens, words: str) -> None:
    assert doubted(changed(walls(tmp_path, CONVERGING), lens=lens), words)


@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_wrong_focal_lengths_are_told_with_what_would_fit(tmp_path: Path, factor: float) -> None:
    """Of cameras that turn to what they look at: of parallel ones focal lengths are depths in other units."""
    zoomed = changed(
        walls(tmp_path, CONVERGING), lens=lambda K: K * np.array([[factor, 1, 1], [1, factor, 1], [1] * 3])
    )
    numbers = [float(number) for number in re.findall(r"\d+\.?\d*", " ".join(doubts(zoomed)))]
    assert any(abs(factor * number - 1) < 0.15 for number in numbers)


@pytest.mark.parametrize(("k1", "is_told"), [(50.0, True), (0.3, False)])
def test_a_lens_that_there_is_not_is_told(tmp_path: Path, k1: float, is_told: bool) -> None:
    scene = walls(tmp_path, TURNED_OUT)
    lens = opencv_lens((F, F), np.array([W / 2, H / 2]), (k1, *7 * (0,)), (H, W), fisheye=False)
    frames = even_sizes([dataclasses.replace(f, camera=lens.camera(f.camera.c2w), lens=lens) for f in scene.frames])
    assert doubted(dataclasses.replace(scene, frames=tuple(frames)), "k1") is is_told


@pytest.mark.parametrize(
    ("order", "change", "pose"),
    [
        ((1, 0), np.asarray, np.eye(4)),
        ((2, 1, 0), np.asarray, np.eye(4)),
        ((1, 2, 3, 0), np.asarray, np.eye(4)),
        ((0, 1), lambda photo: photo[::-1, ::-1], np.eye(4)),
        ((0, 1), lambda photo: photo[:, ::-1], np.eye(4)),
        ((0, 1), np.asarray, rolled(90)),
    ],
    ids=["exchanged", "reversed", "each the next one's", "upside down", "mirrored", "rolled"],
)
def test_photos_that_are_not_their_cameras_are_told(tmp_path: Path, order, change, pose) -> None:
    views = [camera(x, 0.1 * x) for x in np.array([-0.4, -0.05, 0.2, 0.7])[: len(order)]]
    if len(order) == 2:
        views = TURNED_OUT
    scene = stored(tmp_path, views, [change(photo(views[i])) for i in order])
    assert doubts(changed(scene, lambda i, c2w: c2w @ pose))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        pytest.param(np.zeros_like, "photo 2 (1.png)", id="black"),
        pytest.param(lambda own: photo(FOUR[2]), "photo 3 (2.png) photo 2 (1.png)", id="twice"),
        pytest.param(lambda own: own[::-1, ::-1], "photo 2 (1.png)", id="upside down"),
        pytest.param(lambda own: own[:, ::-1], "photo 2 (1.png)", id="mirrored"),
        pytest.param(lambda own: 1 - own, "photo 2 (1.png)", id="negative"),
        pytest.param(another_scene, "photo 2 (1.png)", id="another scene's"),
        pytest.param(lambda own: 0.7 * own, None, id="darker"),
        pytest.param(lambda own: 0.15 * own, "photo 2 (1.png) 0.15", id="much darker"),
        pytest.param(lambda own: own[..., ::-1], "photo 2 (1.png) has its colours exchanged", id="colours exchanged"),
        pytest.param(lambda own: np.roll(own, 12, axis=0), "photo 2 (1.png) 8%", id="shifted"),
        pytest.param(barred, "photo 2 (1.png) has black bars", id="bars"),
    ],
)
def test_a_photo_that_does_not_belong_is_named(tmp_path: Path, change, words: str | None) -> None:
    scene = walls(tmp_path, FOUR, {1: change})
    assert doubted(scene, words) if words else doubts(scene) == []


@pytest.mark.parametrize(("change", "words"), [(barred, "all photos"), (bannered, "one place of the picture")])
def test_what_is_on_all_photos_is_told(tmp_path: Path, change, words: str) -> None:
    assert doubted(walls(tmp_path, FOUR, dict.fromkeys(range(4), change)), words)


def test_dark_things_on_black_are_no_bars(tmp_path: Path) -> None:
    """What a round thing leaves black at the borders ends nowhere straight."""
    v, u = np.mgrid[:H, :W]
    disc = (np.hypot(v - H / 2, u - W / 2) < 0.45 * H)[..., None]
    scene = walls(tmp_path, FOUR, dict.fromkeys(range(4), lambda own: own * disc))
    assert not doubted(scene, "black bars")


def test_of_many_photos_one_of_another_scene_is_named(tmp_path: Path) -> None:
    views = [camera(x, -x / 4) for x in np.linspace(-0.6, 0.6, 13)]
    assert doubted(walls(tmp_path, views, {6: another_scene}), "photo 7 (6.png)")


@pytest.mark.parametrize(
    ("wrong", "change", "words"),
    [
        (2, lambda c2w: c2w @ rolled(40), "photo 3 (2.png)"),
        (1, lambda c2w: moved(0, 1) @ c2w, "photo 2 (1.png)"),
        (1, lambda c2w: moved(1, 0) @ c2w, "photo 2 (1.png)"),
    ],
    ids=["rolled", "up", "beside"],
)
def test_one_wrong_pose_is_named(tmp_path: Path, wrong: int, change, words: str) -> None:
    views = FOUR if wrong == 2 else [camera(x, -x / 2.5) for x in (-0.3, -0.1, 0.1, 0.3)]
    assert doubted(changed(walls(tmp_path, views), lambda i, c2w: change(c2w) if i == wrong else c2w), words)


@pytest.mark.parametrize(("near", "far"), [(0.1, 90.0), (12.0, 12.5), (0.1, 6.0)])
def test_a_depth_range_that_is_far_off_is_told_unless_it_was_estimated(tmp_path: Path, near: float, far: float) -> None:
    scene = dataclasses.replace(walls(tmp_path, FOUR), near=near, far=far)
    assert doubted(scene, f"near {near:g}" if near < 1 else "near")
    assert doubts(dataclasses.replace(scene, is_estimated=True)) == []


@pytest.mark.parametrize("is_estimated", [False, True])
@pytest.mark.parametrize("wrong", [0, 1])
def test_two_photos_of_different_things_are_named(tmp_path: Path, wrong: int, is_estimated: bool) -> None:
    """With the depths that they were sought at, which may be what is wrong."""
    scene = walls(tmp_path, [camera(-0.15, 0.05), camera(0.15, -0.05)], {wrong: another_scene})
    assert doubted(dataclasses.replace(scene, is_estimated=is_estimated), "0.png 1.png")


def test_photos_that_look_different_ways_are_told(tmp_path: Path) -> None:
    views = [camera(-0.15), camera(0.15, np.pi)]
    assert doubted(walls(tmp_path, views, {1: another_scene}), "near 1.5 far 6")


def test_the_depth_range_is_found_from_photos(scene: Scene) -> None:
    near, far = range_seen(scene.images(), scene.cameras)
    assert 0.5 * DEPTHS[0] < near < DEPTHS[0] and DEPTHS[1] < far < 3 * DEPTHS[1]


def test_photos_that_agree_about_no_depth_have_no_range(scene: Scene) -> None:
    noise = np.random.default_rng(0).uniform(size=(2, H, W, 3))
    for images, cameras in ((noise, scene.cameras), (scene.images(), [scene.cameras[0]] * 2)):
        with pytest.raises(ts.InputError):
            range_seen(images, cameras)


def test_where_photos_agree_about_no_depth_the_cause_is_named(tmp_path: Path) -> None:
    scene = dataclasses.replace(walls(tmp_path, CONVERGING, {1: np.zeros_like}), near=None, far=None)
    with pytest.raises(ts.InputError, match=r"no depth.*photo 2 \(1.png\) is of one colour"):
        prepared(EncodeRequest(scene))
