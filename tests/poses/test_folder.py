"""Scene folders say the same to every reader: ours, nerfstudio's and COLMAP's."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pillow_heif
import pytest
from PIL import Image
from scenes import make_cameras, make_photo, refusing

from tinysplat.poses.copies import encoded, upright_copies
from tinysplat.poses.folder import write_folder
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.images import read_image
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.lenses import Lens
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.scene.resampling import resize_cover

CAMERAS = make_cameras(3, 24, 32)
POINTS = (np.array([[0.1, 0, 3.0], [0, 0.1, 5.0]]), np.array([[1, 2, 3], [255, 0, 9]], np.uint8), np.array([0.5, 1.0]))


def entries() -> list[dict[str, Any]]:
    return [
        {
            "name": f"{i}.png",
            "w2c": camera.w2c[:3].tolist(),
            "camera": {
                "model": "PINHOLE",
                "width": 32,
                "height": 24,
                "params": [camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]],
            },
        }
        for i, camera in enumerate(CAMERAS)
    ]


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    (tmp_path / "photos").mkdir()
    for i in range(3):
        write_png(tmp_path / "photos" / f"{i}.png", make_photo(24, 32, seed=i))
    return tmp_path / "photos"


@pytest.mark.parametrize("layout", ["cameras.json", "transforms.json", "sparse"])
def test_every_layout_says_the_same(tmp_path: Path, photos: Path, layout: str) -> None:
    scene = tmp_path / "scene"
    cameras = write_folder(scene, photos, entries()[::-1], (1.5, 8.0), POINTS)
    assert list(cameras) == ["0.png", "1.png", "2.png"]
    for other in {"cameras.json", "transforms.json", "sparse"} - {layout}:
        path = scene / other
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    loaded = load_scene(scene)
    for found, camera in zip(loaded.cameras, CAMERAS, strict=True):
        np.testing.assert_allclose(found.K, camera.K, rtol=1e-9)
        np.testing.assert_allclose(found.c2w, camera.c2w, atol=1e-9)
    for i, image in enumerate(loaded.images()):
        np.testing.assert_array_equal(image, make_photo(24, 32, seed=i) / np.float32(255))
    near, far = loaded.depth_range()
    assert (near, far) == (1.5, 8.0) if layout != "sparse" else 2.5 < near < 3 < 5 < far < 6


def test_points_keep_their_colours(tmp_path: Path, photos: Path) -> None:
    import pycolmap

    write_folder(tmp_path / "scene", photos, entries(), (None, None), POINTS)
    model = pycolmap.Reconstruction(str(tmp_path / "scene/sparse/0"))
    np.testing.assert_allclose([model.points3D[i].xyz for i in (1, 2)], POINTS[0])
    np.testing.assert_array_equal([model.points3D[i].color for i in (1, 2)], POINTS[1])


def test_nothing_stays_behind_when_a_photo_cannot_be_read(tmp_path: Path, photos: Path) -> None:
    (photos / "2.png").write_bytes(b"")
    (tmp_path / "empty").mkdir()
    for output in (tmp_path / "new", tmp_path / "empty"):
        with refusing(InputError, "2.png"):
            write_folder(output, photos, entries(), (1.5, 8.0), POINTS)
    assert not (tmp_path / "new").exists() and list((tmp_path / "empty").iterdir()) == []


def test_turned_photos_are_copied_as_they_are_seen(tmp_path: Path, photos: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 8
    Image.fromarray(make_photo(24, 32, seed=7)).save(photos / "1.png", exif=exif)
    copies = tmp_path / "copies"
    copies.mkdir()
    assert upright_copies(photos, ["0.png", "1.png"], copies) == ({"0.png": "0.png", "1.png": "1.png"}, 1)
    stored = read_image(copies / "1.png", upright=False)
    np.testing.assert_array_equal(stored, np.rot90(make_photo(24, 32, seed=7)))
    np.testing.assert_array_equal(read_image(copies / "0.png"), read_image(photos / "0.png"))


def test_copies_have_names_of_their_own_that_colmap_reads(tmp_path: Path) -> None:
    photos = [make_photo(24, 32, seed=i) for i in range(4)]
    for name, photo in zip(("a 1.PNG", "a_1.png", "b.png"), photos, strict=False):
        write_png(tmp_path / name, photo)
    pillow_heif.from_bytes("RGB", (32, 24), photos[3].tobytes()).save(tmp_path / "b.HEIC", quality=-1, chroma=444)
    (copies := tmp_path / "copies").mkdir()
    names = ["a 1.PNG", "a_1.png", "b.HEIC", "b.png"]
    called, turned = upright_copies(tmp_path, names, copies)
    assert list(called) == names and turned == 0 and len(set(called.values())) == 4
    assert not any(" " in name for name in called.values()) and called["b.HEIC"].endswith(".jpg")
    for name, copy in called.items():
        assert np.abs(read_image(copies / copy).astype(int) - read_image(tmp_path / name)).mean() < 4


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_very_large_photos_are_kept_half_as_large_with_their_cameras(tmp_path: Path, suffix: str) -> None:
    photo = np.kron(make_photo(20, 30), np.ones((90, 90, 1))).astype(np.uint8)  # 1800 x 2700
    path = tmp_path / f"a{suffix}"
    path.write_bytes(encoded(photo, path.name))
    entry = entries()[0]
    lens = {"model": "SIMPLE_RADIAL", "width": 2700, "height": 1800, "params": [2400.0, 1350.0, 900.0, 0.05]}
    write_folder(tmp_path / "s", tmp_path, [{**entry, "name": path.name, "camera": lens}], (1, 9), POINTS)
    (frame,) = load_scene(tmp_path / "s").frames
    assert (frame.camera.height, frame.camera.width) == (900, 1350)
    whole = Lens("SIMPLE_RADIAL", (2400.0, 1350.0, 900.0, 0.05), 2700, 1800)
    expected = resize_cover(whole.undistort(photo), 900, 1350)
    K = whole.camera(frame.camera.c2w).resized(900, 1350).K
    np.testing.assert_allclose(frame.camera.K, K, rtol=2e-3)
    assert np.abs(frame.image() - expected).mean() < 0.02
