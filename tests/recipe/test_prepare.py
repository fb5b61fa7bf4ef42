"""Which photos of a capture are taken, and what is said of it."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from networks.two_planes import trace, write_traced
from scenes import Heard, refusing, tells

import tinysplat_runtime as ts
from tinysplat_runtime.recipe import prepare
from tinysplat_runtime.recipe.prepare import prepared
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.scenes import Frame, Scene

VIEWS, HEIGHT, WIDTH = 10, 48, 64


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten photos in a row, farther from each other than needed, and cameras that state no depths."""
    folder = tmp_path_factory.mktemp("row")
    traced = trace(VIEWS, HEIGHT, WIDTH, spacing=0.25, subpixels=1)
    return write_traced(folder, traced)


def chosen(scene: object, **options: object) -> tuple[list[str], list[str]]:
    """Names of the photos that are taken, and what was said."""
    heard = Heard()
    found = prepared(EncodeRequest(scene, **options), heard)  # type: ignore[arg-type]
    assert found.near is not None and found.far is not None
    return [frame.path.name for frame in found.frames], heard.lines


def names(*indices: int) -> list[str]:
    return [f"{i:04}.png" for i in indices]


def test_a_capture_gets_all_photos_that_it_needs_and_a_line(capture: Path) -> None:
    found, said = chosen(capture)
    assert found == names(*range(VIEWS))
    assert any(tells(line, f"{VIEWS} of {VIEWS}") for line in said) and not any("\n" in line for line in said)


@pytest.mark.parametrize(
    ("views", "wanted"),
    [
        ("all", range(VIEWS)),
        ("0-8:2,9", (0, 2, 4, 6, 8, 9)),
        ([3, 1], (3, 1)),
        ("0-9", range(VIEWS)),
        ("2-2,4", (2, 4)),
    ],
)
def test_views_are_taken_as_asked(capture: Path, views: object, wanted: tuple[int, ...]) -> None:
    assert chosen(capture, views=views)[0] == names(*wanted)


@pytest.mark.filterwarnings("ignore::tinysplat_runtime.errors.InputWarning")  # that it is not there
def test_views_keep_their_numbers_where_a_photo_is_not_there(capture: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(capture, tmp_path / "row")
    (folder / "images/0000.png").unlink()
    assert chosen(folder, views="1,3")[0] == names(1, 3)
    with refusing(ts.InputError, "0"):
        chosen(folder, views="0,1")
    said = next(line for line in chosen(folder, views="auto:2")[1] if "which see most" in line)
    assert set(map(int, re.findall(r"views (\d+),(\d+)", said)[0])) <= {int(name[:4]) for name in chosen(folder)[0]}


def test_frames_that_lie_between_others_are_left_out(capture: Path) -> None:
    scene = ts.load_scene(capture, near=2.0, far=12.0)
    frames = []
    for frame in scene.frames:
        for step in range(5):
            c2w = frame.camera.c2w.copy()
            c2w[0, 3] += 0.05 * step
            frames.append(replace(frame, camera=Camera(frame.camera.K, c2w, WIDTH, HEIGHT)))
    found, said = chosen(replace(scene, frames=tuple(frames)))
    assert VIEWS <= len(found) < 50 and any(tells(line, f"{len(found)} 50 --views") for line in said)


def moved(scene: ts.Scene, views: range, offset: float) -> ts.Scene:
    """Some cameras somewhere else."""
    frames = list(scene.frames)
    for v in views:
        c2w = frames[v].camera.c2w.copy()
        c2w[0, 3] += offset
        frames[v] = replace(frames[v], camera=Camera(frames[v].camera.K, c2w, WIDTH, HEIGHT))
    return replace(scene, frames=tuple(frames))


def test_a_photo_that_matches_nothing_is_named_and_left_out(capture: Path) -> None:
    scene = moved(ts.load_scene(capture, near=2.0, far=12.0), range(4, 5), 900)
    for views in (None, "all", list(range(VIEWS))):
        found, said = chosen(scene, views=views)
        assert found == names(0, 1, 2, 3, 5, 6, 7, 8, 9)
        assert any("0004.png" in line for line in said)


def test_two_places_are_told_and_both_taken(capture: Path) -> None:
    found, said = chosen(moved(ts.load_scene(capture, near=2.0, far=12.0), range(6, VIEWS), 900))
    assert found == names(*range(VIEWS))
    assert any(tells(line, "2 6 4") for line in said)


@pytest.mark.parametrize("views", [None, "0-3", "auto:2"])
@pytest.mark.parametrize("depths", [{}, {"near": 2.0, "far": 12.0}])
def test_cameras_that_only_turn_are_refused_in_a_line(capture: Path, views: object, depths: dict[str, float]) -> None:
    scene = ts.load_scene(capture, **depths)
    frames = []
    for v, frame in enumerate(scene.frames):
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(v / 50), -np.sin(v / 50)], [np.sin(v / 50), np.cos(v / 50)]]
        frames.append(replace(frame, camera=Camera(frame.camera.K, turn, WIDTH, HEIGHT)))
    with pytest.raises(ts.InputError):
        chosen(replace(scene, frames=tuple(frames)), views=views)


@pytest.mark.parametrize("depths", [{}, {"near": 2.0, "far": 12.0}])
@pytest.mark.parametrize("count", [2, 5, VIEWS])
def test_photos_taken_twice_are_left_out_and_named(capture: Path, count: int, depths: dict[str, float]) -> None:
    scene = ts.load_scene(capture, **depths).views(range(count))
    twice = [frame for frame in scene.frames for _ in range(2)]
    for i in range(1, len(twice), 2):
        twice[i] = replace(twice[i], path=twice[i].path.with_name("again.png"))
    for views in (None, "all"):
        found, said = chosen(replace(scene, frames=tuple(twice)), views=views)
        assert found == names(*range(count)) and any("again.png" in line for line in said)


@pytest.mark.parametrize("count", [2, 4, VIEWS])
def test_depths_are_found_about_what_photos_show(tmp_path: Path, count: int) -> None:
    """However long the row is: what a margin adds is less than the depths span."""
    traced = trace(count, 96, 128, spacing=0.25, subpixels=1)
    low, high = np.percentile(traced.depth, (2, 95))
    (found,) = {(s.near, s.far) for s in [prepared(EncodeRequest(write_traced(tmp_path, traced)))]}
    assert low / 2 < found[0] < low and high < found[1] < 2.5 * high


def test_depths_that_are_stated_far_too_wide_are_said(capture: Path) -> None:
    found, said = chosen(ts.load_scene(capture, near=0.01, far=100.0))
    assert found == names(*range(VIEWS)) and any(tells(line, "0.01 100") for line in said)


# ---- what is said ------------------------------------------------------------------------------------------------


def photos_of(count: int, height: int, width: int, **depths: float) -> Scene:
    """Photos that are never opened, cameras side by side."""
    frames = []
    for v in range(count):
        c2w = np.eye(4)
        c2w[0, 3] = 0.1 * v
        camera = Camera([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1]], c2w, width, height)
        frames.append(Frame(camera, Path(f"{v}.png")))
    return Scene(Path("made"), tuple(frames), depths.get("near"), depths.get("far"))


@pytest.mark.parametrize("size", [None, "full"])
def test_large_photos_are_scaled_to_the_size_that_is_said_unless_asked_otherwise(size: str | None) -> None:
    heard = Heard()
    found = prepared(EncodeRequest(photos_of(2, 1920, 1080, near=1.0, far=2.0), size=size), heard).cameras[0]
    if size is not None:
        assert (found.height, found.width) == (1920, 1080) and not heard.lines
        return
    assert found.height * found.width <= prepare.LARGE_PIXELS
    assert found.height / found.width == pytest.approx(16 / 9, rel=0.01)
    assert any(tells(line, f"1080x1920 {found.width}x{found.height} --size") for line in heard.lines)


def test_one_photo_is_too_few(capture: Path) -> None:
    with pytest.raises(ts.InputError):
        chosen(capture, views=[3])
    with refusing(ts.InputError, "made:"):
        prepared(EncodeRequest(photos_of(1, 8, 8, near=1.0, far=2.0)))


def test_cameras_far_nearer_to_each_other_than_to_anything_are_told_of_units() -> None:
    with refusing(ts.InputError, "made:"):
        prepared(EncodeRequest(photos_of(2, 8, 8, near=1000.0, far=2000.0)))


@pytest.mark.parametrize(
    ("scene", "options", "said"),
    [
        (["a", "b"], {}, "encode: 2 --focal --baseline"),
        (["a", "b"], {"focal": 5.0}, "focal: "),
        (["a"], {"focal": 5.0, "baseline": 1.0}, "focal: "),
        ([], {}, "encode: 0"),
        (["a", "b"], {"poses": "p"}, "poses: 2"),
        ({"a": 1}, {}, "scene: {'a': 1} Scene"),
        (photos_of(2, 8, 8), {"focal": 1.0, "baseline": 1.0}, "focal: Scene"),
    ],
)
def test_paths_and_options_that_do_not_go_together_are_told(scene, options, said: str) -> None:
    with pytest.raises(ts.InputError) as caught:
        prepare.named_scene(EncodeRequest(scene, **options))
    assert tells(str(caught.value), said)


def test_a_scene_at_hand_takes_the_depths_that_are_given() -> None:
    scene = photos_of(2, 8, 8, near=1.0, far=9.0)
    for options, depths in (({}, (1, 9)), ({"near": 2.0}, (2, 9)), ({"far": 5.0}, (1, 5))):
        found = prepare.named_scene(EncodeRequest(scene, **options))
        assert (found.near, found.far) == depths


@pytest.mark.parametrize(
    ("photo", "size", "lost"),
    [
        ((500, 741), "256x256", 0.33),
        ((100, 200), "100x90", 0.44),
        ((256, 455), "455x200", 0.22),
        ((60, 80), "40x30", 0),
    ],
)
def test_what_a_crop_cuts_off_is_said_with_sizes_that_keep_it(photo: tuple[int, int], size: str, lost: float) -> None:
    """Or refused, where that much goes that width and height may have been exchanged."""
    heard = Heard()
    request = EncodeRequest(photos_of(2, *photo, near=1.0, far=2.0), size=size)
    try:
        prepared(request, heard)
    except ts.InputError as error:
        heard.lines.append(str(error))
    if not lost:
        assert not heard.lines
        return
    line, own = " ".join(heard.lines), f"{photo[1]}x{photo[0]}"
    assert any(abs(float(part) - 100 * lost) <= 1 for part in re.findall(r"([\d.]+) ?%", line))
    heard.lines.clear()
    for whole in {*re.findall(r"\d+x\d+", line)} - {size, own}:
        width, height = map(int, whole.split("x"))
        assert width / height == pytest.approx(photo[1] / photo[0], rel=0.02)
        prepared(EncodeRequest(photos_of(2, *photo, near=1.0, far=2.0), size=whole), heard)
    assert own in line and not heard.lines
