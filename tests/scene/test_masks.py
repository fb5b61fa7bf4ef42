"""Masks are found where tools keep them, mean what these mean by black, and are refused where they do not fit."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scenes import make_photo, refusing, tells, write_scene

from tinysplat_runtime.errors import InputError, InputWarning
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.masks import filled
from tinysplat_runtime.scene.pictures import jpeg_bytes, write_png

HEIGHT, WIDTH = 24, 32
KEPT = np.zeros((HEIGHT, WIDTH), bool)
KEPT[4:20, 6:30] = True
WHITE = KEPT * np.uint8(255)


def masked(folder: Path, name: str, mask: NDArray = WHITE, views: int = 3) -> Path:
    """A scene folder with a mask a photo, whose name follows from the photo's number."""
    write_scene(folder, views=views)
    for i in range(views):
        path = folder / name.format(i=i)
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_bytes(jpeg_bytes(np.repeat(mask[..., None], 3, 2))) if path.suffix == ".jpg" else write_png(
            path, mask
        )
    return folder


@pytest.mark.parametrize(
    "name",
    [
        "masks/{i:04}.png",
        "masks/{i:04}.png.png",
        "Mask/{i:04}.PNG",
        "masks/images/{i:04}.jpg",
        "images/masks/{i:04}.png",
        "images/{i:04}.mask.png",
        "images/{i:04}_mask.png",
        "images/{i:04}.png.png",
        "images/{i:04}.png.mask.png",
        "masks/{i:04}_mask.png",
        "masks/{i:04}.mask.png",
        "_mask/{i:04}.png",
        ".mask/{i:04}.png.png",
        "masks_2/images/{i:04}.png",
    ],
)
def test_masks_are_found_where_tools_keep_them(tmp_path: Path, name: str) -> None:
    scene = load_scene(masked(tmp_path, name))
    for i, frame in enumerate(scene.frames):
        np.testing.assert_array_equal(frame.known(), KEPT)
        photo = make_photo(HEIGHT, WIDTH, seed=i) / np.float32(255)
        np.testing.assert_array_equal(frame.judged()[KEPT], photo[KEPT])
        assert not frame.is_on_background and np.isnan(frame.judged()[~KEPT]).all()
    assert [frame.known() for frame in scene.with_masks(None).frames] == [None] * 3


def test_instant_ngp_leaves_out_what_is_white(tmp_path: Path) -> None:
    scene = load_scene(masked(tmp_path, "images/dynamic_mask_{i:04}.png", WHITE[::-1] ^ 255))
    for frame in scene.frames:
        np.testing.assert_array_equal(frame.known(), KEPT[::-1])


@pytest.mark.parametrize("name", ["mask.png", "images/mask.png", "masks/sensor.png"])
def test_one_mask_is_that_of_all_photos(tmp_path: Path, name: str) -> None:
    scene = load_scene(masked(tmp_path, name))
    for frame in scene.frames:
        np.testing.assert_array_equal(frame.known(), KEPT)


def test_what_looks_like_masks_and_is_not_read_is_named(tmp_path: Path) -> None:
    with pytest.warns(InputWarning, match="skymasks"):
        load_scene(masked(tmp_path, "skymasks/{i:04}.png"))


def test_nerfstudio_names_the_mask_of_a_frame_and_a_transparent_photo_is_its_own(tmp_path: Path) -> None:
    frames = []
    for i in range(3):
        pose = np.eye(4)
        pose[0, 3] = i
        photo = make_photo(HEIGHT, WIDTH, seed=i)
        Image.fromarray(np.dstack([photo, WHITE]) if i == 2 else photo).save(tmp_path / f"{i}.png")
        frames.append({"file_path": f"{i}.png", "transform_matrix": pose.tolist(), "mask_path": f"other\\m{i}.png"})
    del frames[2]["mask_path"]
    (tmp_path / "other").mkdir()
    write_png(tmp_path / "other/m0.png", WHITE)
    write_png(tmp_path / "other/m1.png", WHITE)
    (tmp_path / "transforms.json").write_text(json.dumps({"fl_x": 30, "w": WIDTH, "h": HEIGHT, "frames": frames}))
    scene = load_scene(tmp_path)
    for frame in scene.frames:
        np.testing.assert_array_equal(frame.known(), KEPT)
    assert [frame.is_on_background for frame in scene.frames] == [False, False, True]
    assert [frame.is_on_background for frame in scene.with_masks("background").frames] == [True] * 3
    (tmp_path / "other/m1.png").unlink()
    with pytest.warns(InputWarning) as said:
        assert load_scene(tmp_path).frames[1].mask is None
    assert "1 masks" in str(said[0].message) and "m1.png" in str(said[0].message)
    frames[0]["mask_path"] = "../outside.png"
    (tmp_path / "transforms.json").write_text(json.dumps({"fl_x": 30, "w": WIDTH, "h": HEIGHT, "frames": frames}))
    with refusing(InputError, r"frames\[0\].mask_path: '../outside.png' leaves"):
        load_scene(tmp_path)


@pytest.mark.parametrize(
    "written",
    [
        lambda mask: mask // 255,
        lambda mask: np.where(mask, np.uint8(200), np.uint8(40)),
        lambda mask: np.repeat(np.repeat(mask, 3, 0), 3, 1),
        lambda mask: mask[::2, ::2],
    ],
    ids=["0 and 1", "greys", "three times as large", "half as large"],
)
def test_black_is_left_out_at_every_size_and_scale(tmp_path: Path, written: Callable[[NDArray], NDArray]) -> None:
    frame = load_scene(masked(tmp_path, "masks/{i:04}.png", np.ascontiguousarray(written(WHITE)))).frames[0]
    np.testing.assert_array_equal(frame.known(), KEPT)
    small = frame.resized(12, 16)
    np.testing.assert_array_equal(small.known(), KEPT[::2, ::2])
    assert small.image().shape == (12, 16, 3)


def test_white_masks_change_nothing(tmp_path: Path) -> None:
    frame = load_scene(masked(tmp_path, "masks/{i:04}.png", np.full_like(WHITE, 255))).frames[0]
    assert (frame.known() is None and frame.judged() is frame.image()) or not np.isnan(frame.judged()).any()


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda path: write_png(path, np.zeros((WIDTH, HEIGHT), np.uint8)), "24x32 pixels, expected 32x24"),
        (lambda path: write_png(path, np.zeros((HEIGHT, HEIGHT), np.uint8)), "24x24 pixels, expected 32x24"),
        (lambda path: path.write_bytes(path.read_bytes()[:40]), "PNG cut short"),
        (lambda path: path.write_bytes(b"GIF89a"), "GIF, expected a JPEG, PNG"),
    ],
)
def test_masks_that_fit_no_photo_are_refused_by_their_name(tmp_path: Path, damage, words: str) -> None:
    frame = load_scene(masked(tmp_path, "masks/{i:04}.png")).frames[1]
    damage(tmp_path / "masks/0001.png")
    with refusing(InputError, f"masks/0001.png: {words}"):
        frame.resized(12, 16).image()


def test_masks_without_photos_and_photos_without_masks_are_said(tmp_path: Path) -> None:
    masked(tmp_path, "masks/{i:04}.png")
    (tmp_path / "masks/0001.png").rename(tmp_path / "masks/other.png")
    (tmp_path / "masks/._0000.png").write_bytes(b"")
    with pytest.warns() as said:
        scene = load_scene(tmp_path)
    lines = [str(line.message) for line in said]
    assert (
        len(lines) == 2 and tells(lines[0], "1 of 3 masks (other.png)") and tells(lines[1], "1 of 3 photos (0001.png)")
    )
    assert [frame.known() is None for frame in scene.frames] == [False, True, False]


def test_what_is_not_known_continues_smoothly_what_is() -> None:
    rng = np.random.default_rng(0)
    row, column = np.mgrid[:37, :50] / 50
    values = np.stack([row, column, np.full_like(row, 0.3)], axis=2)
    known = rng.uniform(size=values.shape[:2]) < 0.3
    known[10:25, 12:40] = False
    spoilt = np.where(known[..., None], values, rng.normal(size=values.shape) * 1e3)
    found = filled(spoilt, known)
    np.testing.assert_array_equal(found[known], values[known])
    assert np.abs(found - values).max() < 0.2 and np.abs(found[..., 2] - 0.3).max() < 1e-12
    steps = np.abs(np.diff(found[12:23, 14:38], axis=1)).max()
    assert steps < 0.1  # no edge inside
    np.testing.assert_array_equal(filled(spoilt, np.zeros_like(known)), spoilt)
