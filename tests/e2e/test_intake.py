"""The command line on what users bring: stereo pairs, many photos, photos without cameras."""

import json
from pathlib import Path

import av
import numpy as np
import pillow_heif
import pytest
from console import fail, tinysplat
from PIL import Image
from poses.walls import FOCAL, HEIGHT, WIDTH, write_photos_of_walls
from scenes import tells, write_scene

from tinysplat_runtime.scene.images import read_image
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.pictures import write_png


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scene(tmp_path_factory.mktemp("many") / "desk", views=8, height=48, width=64)


def test_views_are_chosen_from_many_photos(scene: Path, tmp_path: Path) -> None:
    done = tinysplat("encode", scene, "-o", tmp_path / "a.tsplat", "--views", "auto:3")
    assert done.returncode == 0, done.stderr
    described = json.loads(tinysplat("info", tmp_path / "a.tsplat", "--json").stdout)
    assert len(described["viewpoints"]) == 3
    done = tinysplat("encode", scene, "-o", tmp_path / "b.tsplat", "-q")
    described = json.loads(tinysplat("info", tmp_path / "b.tsplat", "--json").stdout)
    assert len(described["viewpoints"]) == 8, done.stderr
    assert "auto:1" in fail("encode", scene, "-o", tmp_path / "c.tsplat", "--views", "auto:1")
    assert tells(fail("encode", scene, "-o", tmp_path / "c.tsplat", "--views", "auto:9"), "9 8")


def test_a_stereo_pair_is_encoded_with_focal_length_and_baseline(tmp_path: Path) -> None:
    wall = np.random.default_rng(0).integers(256, size=(12, 17, 3), dtype=np.uint8).repeat(4, 0).repeat(4, 1)
    pair = (tmp_path / "left.png", tmp_path / "right.png")
    write_png(pair[0], wall[:, :64])
    write_png(pair[1], wall[:, 4:])
    options = ("-o", tmp_path / "s.tsplat", "--focal", "70", "--baseline", "0.2", "--near", "1.5", "--far", "8")
    done = tinysplat("encode", *pair, *options)
    assert done.returncode == 0, done.stderr
    cameras = json.loads(tinysplat("info", tmp_path / "s.tsplat", "--json").stdout)["cameras"]
    np.testing.assert_allclose(cameras[1]["c2w"][0][3], 0.2, rtol=1e-5)
    assert "baseline" in fail("encode", *pair, "-o", tmp_path / "t.tsplat", "--focal", "70")
    done = tinysplat("encode", *pair, *options[:6], "--force")
    assert done.returncode == 0 and "near" in done.stderr  # estimated, and said


def test_photos_without_cameras_become_a_scene(tmp_path: Path) -> None:
    (tmp_path / "room").mkdir()
    photos = tmp_path / "room/images"
    cameras = write_photos_of_walls(photos, views=5)
    write_png(photos / "wall.png", np.full((HEIGHT, WIDTH, 3), 200, np.uint8))
    mask = np.full((HEIGHT, WIDTH), 255, np.uint8)
    mask[: HEIGHT // 4] = 0
    write_png(photos / "1.mask.png", mask)
    done = tinysplat("poses", tmp_path / "room", "-o", tmp_path / "scene")
    assert done.returncode == 0, done.stderr
    assert "wall.png" in done.stderr and "5 of 6 photos have no mask" in done.stderr
    scene = load_scene(tmp_path / "scene")
    assert len(scene.images()) == 5
    known = [frame.known() for frame in scene.frames]
    assert [v for v, its in enumerate(known) if its is not None] == [1]
    np.testing.assert_allclose(known[1].mean(axis=1)[[10, HEIGHT // 4 + 10]], [0, 1], atol=0.05)
    found = np.stack([camera.centre for camera in scene.cameras])
    truth = np.stack([camera.centre for camera in cameras])
    unit = np.linalg.norm(truth[4] - truth[0]) / np.linalg.norm(found[4] - found[0])
    steps = unit * np.linalg.norm(np.diff(found, axis=0), axis=1)
    np.testing.assert_allclose(steps, 0.35, rtol=0.05)
    near, far = (unit * depth for depth in scene.depth_range())
    assert 2.5 < near < 4 < 5 < far < 9  # calibrated by itself


@pytest.mark.parametrize("says", ["focal length", "of 35 mm", "digital zoom", "nothing"])
def test_photos_of_two_lenses_have_two_cameras(tmp_path: Path, says: str) -> None:
    focals = (FOCAL, 1.6 * FOCAL)
    cameras = write_photos_of_walls(tmp_path / "photos", views=8, focals=focals)
    for i in range(8):
        exif, zoom = Image.Exif(), focals[i % 2] / FOCAL
        exif.get_ifd(0x8769).update({"focal length": {0x920A: 5.7 * zoom}, "of 35 mm": {0xA405: round(34 * zoom)},
                              "digital zoom": {0x920A: 5.7, 0xA404: zoom}, "nothing": {}}[says])  # fmt: skip
        Image.open(tmp_path / f"photos/{i}.png").save(tmp_path / f"photos/{i}.jpg", quality=95, exif=exif)
        (tmp_path / f"photos/{i}.png").unlink()
    done = tinysplat("poses", tmp_path / "photos", "-o", tmp_path / "scene")
    assert done.returncode == 0 and "2 lenses" in done.stderr, done.stderr
    found = load_scene(tmp_path / "scene").cameras
    for camera, other in zip(found[::2], found[1::2], strict=True):
        assert abs(other.focal / camera.focal / 1.6 - 1) < 0.02
    steps = np.linalg.norm(np.diff([camera.centre for camera in found], axis=0), axis=1)
    truth = np.linalg.norm(np.diff([camera.centre for camera in cameras], axis=0), axis=1)
    np.testing.assert_allclose(steps / steps.mean(), truth / truth.mean(), rtol=0.1)


def write_clip(path: Path, photos: Path, count: int) -> None:
    """A video of photos 0.png, 1.png …, with one key frame and x264's default loss."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for i in range(count):
            frame = av.VideoFrame.from_ndarray(read_image(photos / f"{i}.png"))
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def test_every_frame_of_a_clip_is_placed_as_its_photo_would_be(tmp_path: Path) -> None:
    cameras = write_photos_of_walls(tmp_path / "photos", views=9, spacing=0.5)
    write_clip(tmp_path / "clip.mp4", tmp_path / "photos", 9)
    done = tinysplat("poses", tmp_path / "clip.mp4", "-o", tmp_path / "scene")
    assert done.returncode == 0 and "9 of 9 frames" in done.stderr, done.stderr
    found = np.stack([camera.centre for camera in load_scene(tmp_path / "scene").cameras])
    truth = np.stack([camera.centre for camera in cameras])
    unit = np.linalg.norm(truth[8] - truth[0]) / np.linalg.norm(found[8] - found[0])
    np.testing.assert_allclose(unit * np.linalg.norm(np.diff(found, axis=0), axis=1), 0.5, rtol=0.1)


def test_a_clip_that_shows_no_depth_writes_nothing_and_says_what_to_film(tmp_path: Path) -> None:
    write_photos_of_walls(tmp_path / "photos", views=4, spacing=0.005)
    write_clip(tmp_path / "clip.mp4", tmp_path / "photos", 4)
    said = fail("poses", tmp_path / "clip.mp4", "-o", tmp_path / "scene", "-q")
    assert "clip.mp4" in said and "sideways" in said and not (tmp_path / "scene").exists()


def test_photos_of_every_kind_and_nobody_s_files(tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    write_photos_of_walls(photos, views=5)
    pixels = read_image(photos / "1.png")
    (photos / "1.png").unlink()
    pillow_heif.from_bytes("RGB", (WIDTH, HEIGHT), pixels.tobytes()).save(photos / "IMG 1.HEIC", quality=90)
    for name, kind in (("2", "webp"), ("3", "tif")):
        Image.open(photos / f"{name}.png").save(photos / f"{name}.{kind}", lossless=True)
        (photos / f"{name}.png").unlink()
    (photos / "4.dng").write_bytes(b"raw")
    for name in ("._0.png", "._IMG 1.HEIC", ".DS_Store", "Thumbs.db", "desktop.ini"):
        (photos / name).write_bytes(bytes.fromhex("00051607000200004d6163204f532058") + bytes(99))
    done = tinysplat("poses", photos, "-o", tmp_path / "scene")
    assert done.returncode == 0 and "1 of 6 photos (1 .dng)" in done.stderr, done.stderr
    assert "apart" in done.stderr and len(load_scene(tmp_path / "scene").images()) == 5


def test_a_folder_without_photos_says_which_folders_in_it_have_some(tmp_path: Path) -> None:
    (tmp_path / "DCIM").mkdir()
    for name in ("DCIM/100APPLE", "DCIM/101APPLE"):
        write_photos_of_walls(tmp_path / name, views=2)
    said = fail("poses", tmp_path, "-o", tmp_path / "scene")
    assert "DCIM/100APPLE/ has 2" in said and "DCIM/101APPLE/ has 2" in said
    (tmp_path / "raw").mkdir()
    (tmp_path / "raw/a.NEF").touch()
    assert "1 .nef" in fail("poses", tmp_path / "raw", "-o", tmp_path / "scene")


def test_a_part_of_a_sphere_is_refused(tmp_path: Path) -> None:
    said = "".join(
        f'GPano:{kind}{side}Pixels="{pixels}" '
        for kind, factor in (("FullPano", 2), ("CroppedAreaImage", 1))
        for side, pixels in (("Width", 64 * factor), ("Height", 32 * factor))
    )
    (tmp_path / "photos").mkdir()
    for i in range(2):
        pixels = np.full((32, 64, 3), i, np.uint8)
        xmp = f'<x GPano:ProjectionType="equirectangular" {said}/>'.encode()
        Image.fromarray(pixels).save(tmp_path / f"photos/{i}.jpg", xmp=xmp)
    assert "64x32 of 128x64" in fail("poses", tmp_path / "photos", "-o", tmp_path / "scene")


def test_bad_input_of_poses_is_one_line(tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    said = [fail("poses", photos, "-o", tmp_path / "s")]
    photos.mkdir()
    write_png(photos / "a.png", np.zeros((40, 40, 3), np.uint8))
    said.append(fail("poses", photos, "-o", tmp_path / "s"))
    for value in (0, 1):  # a copy, and another photo that shows nothing
        write_png(photos / "b.png", np.full((40, 40, 3), value, np.uint8))
        said.append(fail("poses", photos, "-o", tmp_path / "s"))
    said.append(fail("poses", photos, "-o", photos))
    (photos / "b.png").write_bytes(b"GIF89a")
    said.append(fail("poses", photos, "-o", tmp_path / "s"))
    assert all(str(photos) in line for line in said) and len(set(said)) == 6
    assert "b.png" in said[-1] and "GIF" in said[-1] and not (tmp_path / "s").exists()
