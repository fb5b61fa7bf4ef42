"""Scenes that lack photos, have them turned, or come from two lenses; cameras of the reference code of 3DGS."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scenes import make_cameras, make_photo, transforms_document, write_scene

from tinysplat_runtime.errors import InputWarning
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.scenes import Scene

HEIGHT, WIDTH = 24, 32
CAMERAS = make_cameras(3, HEIGHT, WIDTH)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Photos of three cameras without a cameras.json."""
    scene = write_scene(tmp_path / "desk", 3, HEIGHT, WIDTH)
    (scene / "cameras.json").unlink()
    return scene


def transforms(**changes: Any) -> dict[str, Any]:
    return {**transforms_document(CAMERAS), **changes}


def write_transforms(folder: Path, document: dict[str, Any]) -> Path:
    (folder / "transforms.json").write_text(json.dumps(document))
    return folder


def assert_cameras(scene: Scene, expected: list[Camera]) -> None:
    assert len(scene.frames) == len(expected)
    for found, camera in zip(scene.cameras, expected, strict=True):
        np.testing.assert_allclose(found.K, camera.K, atol=1e-9)
        np.testing.assert_allclose(found.c2w, camera.c2w, atol=1e-9)


def test_photos_that_are_not_there_are_left_out_and_counted(folder: Path) -> None:
    (folder / "images/0001.png").unlink()
    with pytest.warns(InputWarning, match=r"transforms\.json: 1 of 3 photos are not there and left out \(0001\.png\)"):
        scene = load_scene(write_transforms(folder, transforms()))
    assert_cameras(scene, [CAMERAS[0], CAMERAS[2]])
    for photo in (folder / "images").iterdir():
        photo.unlink()
    assert len(load_scene(folder).frames) == 3  # as beside a video


def test_photos_are_taken_as_stored_where_their_cameras_are_of_that_size(folder: Path) -> None:
    stored = make_photo(HEIGHT, WIDTH, seed=1)
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(stored).save(folder / "images/0001.png", exif=exif)
    scene = load_scene(write_transforms(folder, transforms()))
    with pytest.warns(InputWarning, match=r"0001\.png: taken as stored, 32x24"):
        np.testing.assert_array_equal(scene.images()[1], stored / np.float32(255))


def test_undistorted_photos_of_two_lenses_have_one_size(folder: Path) -> None:
    document = transforms(k1=-0.3)
    document["frames"][1].update(k1=-0.2)
    scene = load_scene(write_transforms(folder, document))
    sizes = {(frame.camera.height, frame.camera.width) for frame in scene.frames}
    alone = [load_scene(write_transforms(folder, transforms(k1=k1))).cameras[0] for k1 in (-0.3, -0.2)]
    assert len({(c.height, c.width) for c in alone}) == 2  # each for itself they differ
    assert sizes == {(min(c.height for c in alone), min(c.width for c in alone))}
    assert len(scene.images()) == 3
