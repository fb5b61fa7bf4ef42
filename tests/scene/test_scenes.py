"""Scene folders: what is accepted loads as written, and every fault is one line naming file and field."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import FAR, NEAR, make_cameras, make_photo, refusing, scene_document, write_scene

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.images import read_image
from tinysplat_runtime.scene.intake.layouts import load_cameras, load_scene
from tinysplat_runtime.scene.pictures import jpeg_bytes, write_png
from tinysplat_runtime.scene.resampling import resize_cover
from tinysplat_runtime.scene.scenes import Frame, Scene


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_scene(tmp_path / "desk", views=3, height=24, width=32)


def rewrite(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    document = json.loads((folder / "cameras.json").read_text())
    change(document)
    (folder / "cameras.json").write_text(json.dumps(document))


def refusal(folder: Path, **options: float) -> str:
    with pytest.raises(InputError) as caught:
        load_scene(folder, **options)
    message = str(caught.value)
    assert "\n" not in message and len(message) < 400
    return message


def test_folder_loads_with_cameras_photos_and_depths(folder: Path) -> None:
    rewrite(folder, lambda d: d.update(licence="CC0", frames=[{**f, "depth": "d.png"} for f in d["frames"]]))
    scene = load_scene(folder)
    assert (scene.name, scene.path, scene.depth_range()) == ("desk", folder, (NEAR, FAR))
    for camera, expected in zip(scene.cameras, make_cameras(3, 24, 32), strict=True):
        np.testing.assert_array_equal(camera.K, expected.K)
        np.testing.assert_array_equal(camera.c2w, expected.c2w)
    images = scene.images()
    assert images.dtype == np.float32
    np.testing.assert_array_equal(images, np.stack([make_photo(24, 32, seed=i) for i in range(3)]) / np.float32(255))


def test_views_keep_the_order_given_and_photos_are_read_only_when_asked_for(folder: Path) -> None:
    """Of a scene that its .json file names."""
    scene = load_scene(str(folder / "cameras.json"))
    (folder / "images" / "0001.png").unlink()
    chosen = scene.views(np.array([2, 0]))
    assert chosen.frames == (scene.frames[2], scene.frames[0])
    assert chosen.depth_range() == scene.depth_range() and chosen.images().shape == (2, 24, 32, 3)
    with refusing(InputError, "0001.png"):
        scene.images()


@pytest.mark.parametrize(("indices", "words"), [([0, 3], "3 of 0 to 2"), ([-1], "-1"), ([1, 1], "1"), ([], "")])
def test_views_that_do_not_exist_are_refused(folder: Path, indices: list[int], words: str) -> None:
    with refusing(InputError, words) as caught:
        load_scene(folder).views(indices)
    assert caught.value.where == str(folder)


def test_resized_scene_delivers_the_size_its_cameras_state_always_of_the_whole_photo(folder: Path) -> None:
    scene = load_scene(folder)
    small = scene.resized(20, 5).resized(10, 20)
    images = small.images()
    assert images.shape == (3, 10, 20, 3)
    for camera, original in zip(small.cameras, scene.cameras, strict=True):
        assert (camera.height, camera.width) == (10, 20)
        np.testing.assert_allclose(camera.K, original.resized(10, 20).K)
    np.testing.assert_array_equal(images[1], resize_cover(make_photo(24, 32, seed=1), 10, 20))


def test_large_photos_are_read_smaller_where_that_is_enough(tmp_path: Path) -> None:
    """Twice as large as the picture that is wanted, or larger; the whole photo where that is not."""
    y, x = np.mgrid[:1040, :1200] / 40
    path = tmp_path / "a.jpg"
    path.write_bytes(jpeg_bytes(np.stack([np.sin(x), np.cos(y), np.sin(x + y)], axis=-1) / 2 + 0.5))
    K, whole = [[900, 0, 600], [0, 900, 520], [0, 0, 1]], read_image(path)
    frame = Frame(Camera(K, np.eye(4), 1200, 1040), path)
    for least in ((130, 150), (131, 150), (260, 301), (520, 600)):
        height, width, _ = frame.photo(least).shape
        assert 1040 % height == 0 and 1040 // height == 1200 // width and height >= 2 * least[0]
    assert frame.photo((130, 150)).size < whole.size
    np.testing.assert_array_equal(frame.resized(600, 600).image(), resize_cover(whole, 600, 600))
    np.testing.assert_allclose(frame.resized(104, 110).image(), resize_cover(whole, 104, 110), atol=0.02)
    for width in (1198, 1204):
        with refusing(InputError, f"{path} 1200x1040 {width}x1040"):
            Frame(Camera(K, np.eye(4), width, 1040), path).resized(104, 120).image()


def test_photos_of_several_sizes_need_one_chosen(folder: Path) -> None:
    write_png(folder / "images" / "0002.png", make_photo(24, 40))
    rewrite(folder, lambda d: d["frames"][2].update(width=40))
    scene = load_scene(folder)
    with refusing(InputError, "0002.png 40x24 0000.png 32x24 --size"):
        scene.images()
    assert scene.resized(16, 16).images().shape == (3, 16, 16, 3)
    assert scene.views([2]).images().shape == (1, 24, 40, 3)


def test_depth_range_comes_from_options_first_and_is_needed_only_when_asked_for(folder: Path) -> None:
    assert load_scene(folder, near=2.0).depth_range() == (2.0, FAR)
    rewrite(folder, lambda d: d.update(near=None, far=None))
    scene = load_scene(folder, near=1.0)
    with refusing(InputError, "--far"):
        scene.depth_range()
    rewrite(folder, lambda d: [d.pop("near"), d.pop("far")])
    with refusing(InputError, "--near --far"):
        load_scene(folder).depth_range()


@pytest.mark.parametrize("near", [0, -1, 1e-300, float("nan"), float("inf"), FAR, FAR + 1])
def test_depths_out_of_order_or_range_are_refused(folder: Path, near: float) -> None:
    assert f"{folder}: near" in refusal(folder, near=near)


FAULTS: list[tuple[Callable[[dict[str, Any]], object], str]] = [
    (lambda d: d["frames"][1]["K"][0].__setitem__(0, -3), "frames[1].K"),
    (lambda d: d["frames"][2].update(K=[[1, 2], [3]]), "frames[2].K"),
    (lambda d: d["frames"][0].update(c2w=[[1, 0, 0, 0]] * 3), "frames[0].c2w"),
    (lambda d: d["frames"][0]["K"][0].__setitem__(0, 10**400), "frames[0].K"),
    (lambda d: d["frames"][0].update(width="32"), "frames[0].width"),
    (lambda d: d["frames"][0].update(height=10**30), "frames[0].height"),
    (lambda d: d["frames"][1].pop("file"), "frames[1].file"),
    (lambda d: d["frames"][1].update(file="a\0b"), "frames[1].file"),
    (lambda d: d["frames"][1].update(file="images/../../x.png"), "frames[1].file"),
    (lambda d: d["frames"].__setitem__(1, 5), "frames[1]"),
    (lambda d: d.update(frames=[]), "frames"),
    (lambda d: d.pop("frames"), "frames"),
    (lambda d: d.update(near="2"), "near"),
    (lambda d: d.update(far=float("inf")), "far"),
]


@pytest.mark.parametrize(("change", "words"), FAULTS, ids=range(len(FAULTS)))
def test_fault_is_named_by_file_and_field(folder: Path, change: Callable[[dict[str, Any]], object], words: str) -> None:
    rewrite(folder, change)
    message = refusal(folder)
    assert message.startswith(f"{folder / 'cameras.json'}: ") and words in message


@pytest.mark.parametrize(
    "text",
    [b"", b"{", b"[]", b"null", b'"frames"', b"\xff\xfe\x00", b"[" * 100_000, b'{"frames":' * 50_000, b"1" * 5000],
    ids=["empty", "cut", "list", "null", "string", "binary", "deep lists", "deep objects", "long number"],
)
def test_json_that_is_no_scene_is_refused(folder: Path, text: bytes) -> None:
    (folder / "cameras.json").write_bytes(text)
    assert refusal(folder).startswith(f"{folder / 'cameras.json'}: ")


def test_cameras_alone_need_no_photos(tmp_path: Path) -> None:
    document: dict[str, Any] = scene_document(make_cameras(2))
    for frame in document["frames"]:
        del frame["file"]
    (tmp_path / "path.json").write_text(json.dumps(document))
    assert [c.width for c in load_cameras(tmp_path / "path.json")] == [12, 12]
    document["frames"][1]["K"] = 3
    (tmp_path / "path.json").write_text(json.dumps(document))
    with refusing(InputError, f"{tmp_path / 'path.json'} frames[1].K"):
        load_cameras(tmp_path / "path.json")


def test_scenes_are_made_from_frames_in_python_too(folder: Path) -> None:
    frame = Frame(make_cameras(1, 24, 32)[0], folder / "images" / "0000.png")
    assert Scene(folder, (frame,)).images().shape == (1, 24, 32, 3)
    with refusing(InputError, str(folder)):
        Scene(folder, ())
