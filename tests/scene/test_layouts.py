"""Layouts of scenes: which reader takes which, and what each says of files that are not as they should be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import colmap_texts, make_cameras, tells, write_scene

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.intake.layouts import load_scene

CAMERAS = make_cameras(5, 24, 32)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    scene = write_scene(tmp_path / "desk", 5, 24, 32)
    (scene / "cameras.json").unlink()
    return scene


def refusal(path: Any, **options: Any) -> str:
    with pytest.raises(InputError) as caught:
        load_scene(path, **options).depth_range()
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (7, "int"),
        ("https://x.org/a", "https://x.org/a URL"),
        ("film.MP4", "film.MP4 --poses `tinysplat poses"),
        ("a.JPG", "a.JPG"),
    ],
)
def test_what_is_no_scene_is_told_by_its_name(path: Any, words: str) -> None:
    assert tells(refusal(path), words)


def test_photos_alone_are_told_what_finds_their_cameras(folder: Path, tmp_path: Path) -> None:
    """Whether they are in the folder itself or where another tool has put them; nothing is said of an empty one."""
    for named in (folder, folder / "images"):
        assert f"`tinysplat poses {folder / 'images'} -o SCENE`" in refusal(named)
    (folder / "bundle.out").write_text("# Bundle file v0.3\n")
    assert "Bundler" in refusal(folder) and f"`tinysplat poses {folder / 'images'} -o SCENE`" in refusal(folder)
    (tmp_path / "empty").mkdir()
    assert "tinysplat poses" not in refusal(tmp_path / "empty")


# ---- LLFF --------------------------------------------------------------------------------------------------------


def llff(folder: Path, rows: Any) -> Path:
    np.save(folder / "poses_bounds.npy", rows)
    return folder


def row(height: float = 48, width: float = 32, focal: float = 50, near: float = 1.5, far: float = 9.0) -> list[float]:
    pose = np.column_stack([np.eye(3)[1], np.eye(3)[0], -np.eye(3)[2], [1.0, 2, 3], [height, width, focal]])
    return [*pose.ravel(), near, far]


def test_llff_intrinsics_follow_the_pictures_size_on_either_axis(folder: Path) -> None:
    """Photos of 32×24 pixels, of which the file says that they were 32×48."""
    scene = load_scene(llff(folder, [row(), row(near=0.5), row(far=11), row(), row()]))
    np.testing.assert_allclose(scene.cameras[0].K, [[50, 0, 16], [0, 25, 12], [0, 0, 1]])
    np.testing.assert_allclose(scene.cameras[0].c2w[:3], [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3]])
    assert (scene.near, scene.far) == (0.5, 11)
    assert load_scene(llff(folder, [row(1, 1, 2)] * 5)).cameras[0].K[:2, :2].tolist() == [[64, 0], [0, 48]]
    llff(folder, [row(), row(near=0.5), row(far=11), row(), row()])
    assert load_scene(folder, near=0.7).depth_range() == (0.7, 11)
    assert load_scene(folder, far=7.0).depth_range() == (0.5, 7)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (np.zeros((5, 16)), "5 16 17"),
        (np.zeros(17), "17"),
        (np.zeros((0, 17)), "0 17"),
        (np.full((5, 17), "a"), "17"),
        (np.full((5, 17), np.nan), "NaN"),
        ([row(), row(), row(height=0.5), row(), row()], "row 2 32x0.5"),
        ([row(), row(width=0.5), row(), row(), row()], "row 1 0.5x48"),
        ([row(focal=-1)] * 5, "row 0 K"),
        ([row()] * 4, "4 of 5 images/"),
    ],
)
def test_faults_of_llff_files_name_the_row(folder: Path, rows: Any, words: str) -> None:
    assert tells(refusal(llff(folder, rows)), words) and str(folder / "poses_bounds.npy") in refusal(folder)


# ---- COLMAP ------------------------------------------------------------------------------------------------------


def test_points_that_no_photo_observed_still_tell_depths(folder: Path) -> None:
    points = np.array([[0.1, 0.05, 3.0], [-0.2, 0.1, 4.0], [0.0, -0.1, 5.0], [0.3, 0.0, 6.0]])
    (folder / "sparse").mkdir()
    texts = colmap_texts(CAMERAS, points)
    lines = texts["images.txt"].splitlines()
    for name, text in texts.items():
        (folder / "sparse" / name).write_text(text)
    poses = [line for line in lines if line.endswith(".png")]
    assert len(poses) == 5
    (folder / "sparse/images.txt").write_text("".join(f"{line}\n\n" for line in poses))
    tracks = [line.split()[:8] for line in texts["points3D.txt"].splitlines() if line and line[0] != "#"]
    (folder / "sparse/points3D.txt").write_text("".join(" ".join(words) + "\n" for words in tracks))
    near, far = load_scene(folder).depth_range()
    assert 2 < near < 3 and 6 < far < 9
    assert load_scene(folder, near=1.0).depth_range() == (1.0, far)
    assert load_scene(folder, far=20.0).depth_range() == (near, 20.0)
    (folder / "sparse/images.txt").write_text("")
    assert str(folder / "sparse") in refusal(folder)
