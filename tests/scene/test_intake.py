"""Scenes of other tools: cameras and photos arrive as those tools mean them, and faults are one line."""

import json
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import plyfile
import pycolmap
import pytest
from scenes import (
    colmap_texts,
    make_cameras,
    make_photo,
    realestate_line,
    refusing,
    tells,
    transforms_document,
    write_scene,
)

from tinysplat_runtime.errors import InputError, InputWarning
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.intake.depths import depth_range, depth_range_in_view
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.intake.stereo import stereo_scene
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.scene.scenes import Scene

HEIGHT, WIDTH = 24, 32
CAMERAS = make_cameras(3, HEIGHT, WIDTH)
POINTS = np.array([[0.1, 0.05, 3.0], [-0.2, 0.1, 4.0], [0.0, -0.1, 5.0], [0.3, 0.0, 6.0]])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Photos of three cameras without a cameras.json."""
    scene = write_scene(tmp_path / "desk", 3, HEIGHT, WIDTH)
    (scene / "cameras.json").unlink()
    return scene


def transforms(**changes: Any) -> dict[str, Any]:
    """A document as nerfstudio writes it, of CAMERAS; y and z of each camera point up and backward."""
    return {**transforms_document(CAMERAS), **changes}


def write_transforms(folder: Path, document: dict[str, Any]) -> Path:
    (folder / "transforms.json").write_text(json.dumps(document))
    return folder


def refusal(path: Any) -> str:
    with pytest.raises(InputError) as caught:
        load_scene(path).depth_range()
    message = str(caught.value)
    if isinstance(path, Path):
        assert message.startswith(str(path))
    assert "\n" not in message and len(message) < 1000
    return message


def assert_cameras(scene: Scene, expected: list[Camera]) -> None:
    assert len(scene.frames) == len(expected)
    for found, camera in zip(scene.cameras, expected, strict=True):
        np.testing.assert_allclose(found.K, camera.K, atol=1e-9)
        np.testing.assert_allclose(found.c2w, camera.c2w, atol=1e-9)
        assert (found.height, found.width) == (camera.height, camera.width)


# ---- transforms.json ---------------------------------------------------------------------------------------------


def test_an_angle_of_view_and_the_photo_itself_replace_intrinsics(folder: Path) -> None:
    document = transforms(camera_angle_x=2 * np.arctan(WIDTH / 2 / 40))
    for name in ("fl_x", "fl_y", "cx", "cy", "w", "h"):
        del document[name]
    for frame in document["frames"]:
        frame["file_path"] = frame["file_path"].removesuffix(".png")
    K = load_scene(write_transforms(folder, document)).cameras[0].K
    np.testing.assert_allclose(K, [[40, 0, WIDTH / 2], [0, 40, HEIGHT / 2], [0, 0, 1]])


def test_intrinsics_of_a_frame_win_over_those_of_the_document(folder: Path) -> None:
    document = transforms()
    document["frames"][1].update(fl_x=70.0)
    assert [c.K[0, 0] for c in load_scene(write_transforms(folder, document)).cameras] == [35.2, 70.0, 35.2]


@pytest.mark.parametrize("fisheye", [False, True])
def test_distorted_photos_show_points_where_the_pinhole_camera_does(tmp_path: Path, fisheye: bool) -> None:
    """Dots are painted where the distortion's own formula puts them; after loading they lie where K projects them."""
    k1, f, size = -0.12, 90.0, (120, 160)
    rays = np.array([[x, y, 1] for x in (-0.5, 0.0, 0.45) for y in (-0.35, 0.3)])
    photo = np.zeros((*size, 3), np.uint8)
    r = np.linalg.norm(rays[:, :2], axis=1)
    angle = np.arctan(r) if fisheye else r
    bent = rays[:, :2] * ((angle * (1 + k1 * angle**2)) / r)[:, None]
    for x, y in bent * f + (80, 60):
        v, u = np.mgrid[: size[0], : size[1]] + 0.5
        photo[np.hypot(u - x, v - y) < 2.5] = 255
    write_png(tmp_path / "0.png", photo)
    entry = {"file_path": "0.png", "transform_matrix": np.diag([1, -1, -1, 1]).tolist()}
    model = "OPENCV_FISHEYE" if fisheye else "OPENCV"
    document = {"fl_x": f, "fl_y": f, "cx": 80, "cy": 60, "w": 160, "h": 120, "k1": k1, "camera_model": model}
    frame = load_scene(write_transforms(tmp_path, {**document, "frames": [entry]})).frames[0]
    image = frame.image()
    assert image.shape == (frame.camera.height, frame.camera.width, 3)
    for u, v in (rays @ frame.camera.K.T)[:, :2]:
        weight = image[int(v) - 4 : int(v) + 5, int(u) - 4 : int(u) + 5, 0]
        centre = (np.argwhere(weight > 0.5) + 0.5).mean(axis=0) + np.array([int(v) - 4, int(u) - 4])
        assert np.hypot(centre[1] - u, centre[0] - v) < 0.6
    small = frame.resized(40, 40)
    assert small.image().shape == (40, 40, 3)


def test_depths_are_those_of_points_in_some_picture() -> None:
    camera = Camera([[20.0, 0, 16], [0, 20, 12], [0, 0, 1]], np.eye(4), WIDTH, HEIGHT)
    c2w = np.eye(4)
    c2w[2, 3] = -4.0  # the same view from farther back
    behind = Camera(camera.K, c2w, WIDTH, HEIGHT)

    def point(u: float, v: float, z: float) -> list[float]:
        return [(u - 16) / 20 * z, (v - 12) / 20 * z, z]

    inside = [point(0, 0, 2.0), point(31.9, 23.9, 2.5), point(16, 12, 8.0)]
    outside = [point(-0.1, 12, 1.0), point(32, 12, 1.1), point(16, -0.1, 9.0), point(16, 24, 9.5), point(16, 12, -1)]
    assert depth_range_in_view(np.array(inside + outside), [camera]) == depth_range(np.array([2, 2.5, 8]))
    assert depth_range_in_view(np.array(outside[:4]), [camera]) == (None, None)
    both = depth_range_in_view(np.array(inside[2:]), [camera, behind])
    assert both == depth_range(np.array([8.0, 12.0]))


def test_depths_come_from_the_point_cloud(folder: Path) -> None:
    vertex = np.array([tuple(p) for p in POINTS], dtype=[(axis, "f4") for axis in "xyz"])
    plyfile.PlyData([plyfile.PlyElement.describe(vertex, "vertex")]).write(str(folder / "sparse_pc.ply"))
    document = transforms(ply_file_path="sparse_pc.ply", near=None, far=None)
    near, far = load_scene(write_transforms(folder, document)).depth_range()
    assert 2 < near < 3.1 and 5.9 < far < 9
    assert load_scene(folder, near=1.5).depth_range() == (1.5, far)


@pytest.mark.parametrize("points", ["missing", "cut", "lfs", "another", 3])
def test_a_scene_goes_on_without_points_that_cannot_be_read(folder: Path, points: Any) -> None:
    vertex = np.array([tuple(p) for p in POINTS], dtype=[(axis, "f4") for axis in "xyz"])
    path = folder / "pc.ply"
    plyfile.PlyData([plyfile.PlyElement.describe(vertex, "vertex")]).write(str(path))
    if points == "missing":
        path.unlink()
    elif points == "cut":
        path.write_bytes(path.read_bytes()[:-5])
    elif points == "lfs":
        path.write_text("version https://git-lfs.github.com/spec/v1\n")
    elif points == "another":
        path.write_bytes(path.read_bytes().replace(b"float x", b"float q"))
    document = transforms(ply_file_path=points if points == 3 else "pc.ply", near=None, far=None)
    with pytest.warns(InputWarning, match="points"):
        scene = load_scene(write_transforms(folder, document))
    assert (scene.near, scene.far) == (None, None) and len(scene.frames) == 3


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"frames": []}, "frames"),
        ({"fl_x": None, "fl_y": None}, "fl_x None"),
        ({"camera_model": "EQUIRECTANGULAR"}, "camera_model EQUIRECTANGULAR OPENCV"),
        ({"k1": "a"}, "k1"),
        ({"w": 31.5}, "31.5"),
        ({"near": None}, "--near"),
        ({"fl_x": True}, "fl_x True"),
        ({"fl_x": 0, "fl_y": 0, "camera_angle_x": 3.15}, "camera_angle_x 3.15"),
        ({"p2": 0.1, "is_fisheye": True}, "p2 0.1"),
        ({"transform_matrix": [[1, 0], [0, 1]]}, "frames[1].transform_matrix"),
        ({"transform_matrix": (2 * np.eye(4)).tolist()}, "frames[1]"),
        ({"transform_matrix": [[float("inf")] * 4] * 4}, "frames[1].transform_matrix"),
        ({"file_path": "../../etc/passwd"}, "frames[1].file_path '../../etc/passwd'"),
        ({"file_path": "x" * 5000}, "frames[1].file_path 5000"),
    ],
)
def test_faults_of_transforms_name_the_field_and_the_frame(folder: Path, changes: dict[str, Any], words: str) -> None:
    document = transforms()
    (document["frames"][1] if "frames[1]" in words else document).update(changes)
    assert tells(refusal(write_transforms(folder, document)), words)


# ---- COLMAP ------------------------------------------------------------------------------------------------------


def write_text_model(folder: Path, camera: str | None = None) -> Path:
    """A model in COLMAP's text format of CAMERAS, in which every photo observes POINTS."""
    folder.mkdir(parents=True)
    for name, text in colmap_texts(CAMERAS, POINTS, camera).items():
        (folder / name).write_text(text)
    return folder


def make_binary(text: Path, folder: Path) -> Path:
    folder.mkdir(parents=True)
    pycolmap.Reconstruction(text).write_binary(folder)
    shutil.rmtree(text)
    return folder


@pytest.mark.parametrize("place", ["sparse", "colmap/sparse/0"])
def test_colmap_projects_are_found_where_tools_put_them(folder: Path, place: str) -> None:
    write_text_model(folder / place)
    scene = load_scene(folder)
    assert_cameras(scene, CAMERAS)
    near, far = scene.depth_range()
    assert 2 < near < 3 and 6 < far < 9  # about the nearest and farthest point
    np.testing.assert_array_equal(scene.images()[0], make_photo(HEIGHT, WIDTH, seed=0) / np.float32(255))


@pytest.mark.parametrize("place", ["sparse/0", "distorted/sparse/0"])
def test_photos_of_3dgs_lie_in_input(folder: Path, place: str) -> None:
    write_text_model(folder / place)
    (folder / "images").rename(folder / "input")
    assert len(load_scene(folder).images()) == 3
    shutil.copytree(folder / "input", folder / "images")  # without distortion, as its convert.py writes them
    assert load_scene(folder).frames[0].path.parent.name == ("input" if "distorted" in place else "images")
    write_text_model(folder / "sparse/1")
    assert load_scene(folder).frames[0].path.parent.name == "images"


def test_half_of_a_model_names_the_file_that_is_lacking(folder: Path) -> None:
    make_binary(write_text_model(folder / "text"), folder / "sparse/0")
    (folder / "sparse/0/images.bin").unlink()
    assert tells(refusal(folder), "sparse/0 images.bin")


def change_text(file: Path, *changes: tuple[str, str]) -> None:
    text = file.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file.write_text(text)


@pytest.mark.parametrize(
    ("small", "large"),
    [("sparse/0", "sparse/1"), ("sparse/0", "sparse"), ("sparse/0", "dense/0/sparse"), (None, "colmap/sparse/3")],
)
def test_of_colmap_models_the_largest_is_read(folder: Path, small: str | None, large: str) -> None:
    write_text_model(folder / large)
    if small is None:
        (folder / "sparse/0").mkdir(parents=True)
        assert_cameras(load_scene(folder), CAMERAS)
        return
    write_text_model(folder / small)
    lines = (folder / small / "images.txt").read_text().splitlines(keepends=True)
    (folder / small / "images.txt").write_text("".join(lines[:2]))
    (folder / small / "points3D.txt").write_text("")
    with pytest.warns(InputWarning, match=f"{large}, with 3 photos.*{small} has 1"):
        assert_cameras(load_scene(folder), CAMERAS)


@pytest.mark.parametrize("name", ["my shot, (1).png", "sub folder/Gelände 场景.png", "#1.png", "a\\b c.png"])
@pytest.mark.parametrize("is_binary", [False, True])
def test_colmap_photos_may_have_any_name(folder: Path, name: str, is_binary: bool) -> None:
    model = write_text_model(folder / "sparse/0")
    if is_binary:
        model = make_binary(write_text_model(folder / "text"), folder / "sparse/1")
        shutil.rmtree(folder / "sparse/0")
        data = (model / "images.bin").read_bytes()
        (model / "images.bin").write_bytes(data.replace(b"0001.png", name.encode()))
    else:
        change_text(model / "images.txt", ("0001.png", name))
    target = folder / "images" / name.replace("\\", "/")
    target.parent.mkdir(exist_ok=True)
    (folder / "images/0001.png").rename(target)
    scene = load_scene(folder)
    (frame,) = (frame for frame in scene.frames if frame.path == target)
    np.testing.assert_allclose(frame.camera.c2w, CAMERAS[1].c2w, atol=1e-9)
    assert len(scene.images()) == 3


def test_names_that_are_not_utf_8_are_those_of_windows(folder: Path) -> None:
    model = make_binary(write_text_model(folder / "text"), folder / "sparse/0")
    data = (model / "images.bin").read_bytes()
    (model / "images.bin").write_bytes(data.replace(b"0001.png", "Gelände.png".encode("latin-1")))
    (folder / "images/0001.png").rename(folder / "images/Gelände.png")
    assert "Gelände.png" in [frame.path.name for frame in load_scene(folder).frames if frame.path.is_file()]


@pytest.mark.parametrize("is_binary", [False, True])
def test_colmap_models_may_lack_points_and_have_other_models_rigs(folder: Path, is_binary: bool) -> None:
    model = write_text_model(folder / "text")
    if is_binary:
        model = make_binary(model, folder / "sparse/0")
        (model / "rigs.bin").write_bytes(bytes(8))
    else:
        model = model.rename(folder / "sparse")
        poses = [line for line in (model / "images.txt").read_text().splitlines() if line.endswith(".png")]
        (model / "images.txt").write_text("".join(f"{line}\n\n" for line in poses))
    next(model.glob("points3D.*")).unlink()
    scene = load_scene(folder)
    assert_cameras(scene, CAMERAS)
    assert (scene.near, scene.far) == (None, None)


def test_photos_of_a_folder_without_a_camera_and_a_headers_promise_are_counted(folder: Path) -> None:
    model = write_text_model(folder / "sparse/0")
    header = "# Number of images: 75, mean observations per image: 2\n"
    (model / "images.txt").write_text(header + (model / "images.txt").read_text())
    for name in ("0003.png", "0004.png"):
        shutil.copy(folder / "images/0000.png", folder / "images" / name)
    with pytest.warns(InputWarning) as caught:
        load_scene(folder)
    said = " ".join(str(entry.message) for entry in caught)
    assert "3 of 5 photos in images/" in said and "75" in said


@pytest.mark.parametrize(("copies", "layout"), [("images_2", "colmap"), ("images_4", "colmap"), ("images_2", "ns")])
def test_smaller_copies_stand_in_for_photos(folder: Path, copies: str, layout: str) -> None:
    if layout == "colmap":
        write_text_model(folder / "sparse/0")
    else:
        write_transforms(folder, transforms())
    shutil.rmtree(folder / "images")
    (folder / copies).mkdir()
    factor = int(copies[-1])
    for i in range(3):
        write_png(folder / copies / f"{i:04}.png", np.zeros((HEIGHT // factor, WIDTH // factor, 3), np.uint8))
    scene = load_scene(folder)
    np.testing.assert_allclose(scene.cameras[1].K[:2], CAMERAS[1].K[:2] / factor)
    assert scene.images().shape == (3, HEIGHT // factor, WIDTH // factor, 3)
    for i in range(3):  # of another shape: they are no copies
        write_png(folder / copies / f"{i:04}.png", np.zeros((HEIGHT // factor, WIDTH // factor + 2, 3), np.uint8))
    with refusing(InputError, f"{WIDTH}x{HEIGHT}"):
        load_scene(folder).images()


@pytest.mark.parametrize(
    ("file", "change", "words"),
    [
        ("cameras.txt", ("PINHOLE", "OPENCV"), "cameras: parameters"),
        ("cameras.txt", ("1 PINHOLE", "7 PINHOLE"), "images name a camera"),
        ("images.txt", ("0001.png", ""), "number"),
    ],
)
def test_faults_of_colmap_models_are_in_our_words(folder: Path, file: str, change: tuple[str, str], words: str) -> None:
    model = write_text_model(folder / "sparse/0")
    change_text(model / file, change)
    message = refusal(folder)
    assert tells(message, words) and "Check failed" not in message and ".cc" not in message


def test_colmap_photos_are_in_the_order_of_their_names_whatever_their_ids(folder: Path) -> None:
    """COLMAP numbers photos as it met them, not as they are called."""
    model = write_text_model(folder / "sparse/0")
    text = (model / "images.txt").read_text()
    renamed = {"0000.png": "0002.png", "0001.png": "0000.png", "0002.png": "0001.png"}
    lines = [" ".join(renamed.get(word, word) for word in line.split(" ")) for line in text.splitlines()]
    (model / "images.txt").write_text("\n".join(lines) + "\n")
    scene = load_scene(folder)
    assert [frame.path.name for frame in scene.frames] == ["0000.png", "0001.png", "0002.png"]
    assert_cameras(scene, [CAMERAS[1], CAMERAS[2], CAMERAS[0]])


def test_colmap_without_distortion_needs_no_package(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    model = write_text_model(folder / "sparse/0")
    assert_cameras(load_scene(folder), CAMERAS)
    shutil.rmtree(model)
    write_text_model(model, f"SIMPLE_RADIAL {WIDTH} {HEIGHT} 37 16 12 0.2")
    assert 'pip install "tinysplat[poses]"' in refusal(folder)


def test_colmap_photos_stay_inside_their_folder(folder: Path) -> None:
    model = write_text_model(folder / "sparse/0")
    (model / "images.txt").write_text((model / "images.txt").read_text().replace("0001.png", "../../secret.png"))
    assert "../../secret.png" in refusal(folder)


def test_points_that_no_photo_observed_still_tell_depths(folder: Path) -> None:
    model = write_text_model(folder / "sparse")
    poses = [line for line in (model / "images.txt").read_text().splitlines() if line.endswith(".png")]
    (model / "images.txt").write_text("".join(f"{line}\n\n" for line in poses))
    points = [line.split()[:8] for line in (model / "points3D.txt").read_text().splitlines()]
    (model / "points3D.txt").write_text("".join(" ".join(words) + "\n" for words in points))
    near, far = load_scene(folder).depth_range()
    assert 2 < near < 3 and 6 < far < 9
    assert load_scene(folder, near=1.0).depth_range() == (1.0, far)
    assert load_scene(folder, far=20.0).depth_range() == (near, 20.0)
    (model / "images.txt").write_text("")
    assert str(model) in refusal(folder)


# ---- RealEstate10K -----------------------------------------------------------------------------------------------


def write_realestate(folder: Path) -> Path:
    lines = ["https://www.youtube.com/watch?v=x"]
    for i, camera in enumerate(CAMERAS):
        (folder / "images" / f"{i:04}.png").rename(folder / "images" / f"{i * 33367000}.png")
        lines.append(realestate_line(i * 33367000, camera))
    lines.append(realestate_line(5, CAMERAS[0]))  # without a photo
    (folder / "clip.txt").write_text("\n".join(lines) + "\n")
    return folder / "clip.txt"


def test_realestate_files_load_the_frames_that_have_photos(folder: Path) -> None:
    assert_cameras(load_scene(write_realestate(folder)), CAMERAS)
    (folder / "images").rename(folder / "clip")
    assert_cameras(load_scene(folder / "clip.txt"), CAMERAS)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("33 0.5 0.5", "line 6 33 0.5 18"),
        ("0 0.5 0.5 0.5 0.5 0 0" + " 0" * 12, "line 6"),
        ("0 0.5 0.5 0.5 0.5 0 0 2 0 0 0 0 1 0 0 0 0 1 0", "line 6"),
    ],
)
def test_faults_of_realestate_files_name_the_line(folder: Path, line: str, words: str) -> None:
    path = write_realestate(folder)
    path.write_text(path.read_text() + line + "\n")
    assert tells(refusal(path), words)


def test_realestate_files_without_photos_say_where_they_were_sought(folder: Path) -> None:
    path = write_realestate(folder)
    shutil.rmtree(folder / "images")
    assert tells(refusal(path), f"{folder}/clip {folder}/images")
    path.write_bytes(b"\xff\xfe\x00")
    refusal(path)


# ---- stereo ------------------------------------------------------------------------------------------------------


def test_a_stereo_pair_becomes_two_parallel_cameras(folder: Path) -> None:
    left, right = folder / "images/0000.png", folder / "images/0001.png"
    scene = stereo_scene(left, right, focal=40.0, baseline=0.12, near=1.0, far=5.0)
    np.testing.assert_allclose([c.centre for c in scene.cameras], [[0, 0, 0], [0.12, 0, 0]])
    np.testing.assert_allclose(scene.cameras[1].K, [[40, 0, 16], [0, 40, 12], [0, 0, 1]])
    assert scene.images().shape == (2, HEIGHT, WIDTH, 3)


def test_a_folder_of_nothing_known_says_what_is_accepted(tmp_path: Path) -> None:
    assert tells(refusal(tmp_path), "cameras.json transforms.json COLMAP")


# ---- LLFF and Blender ------------------------------------------------------------------------------------------------


def write_llff(folder: Path, rows: Any) -> Path:
    np.save(folder / "poses_bounds.npy", rows)
    return folder


def row(height: float = 48, width: float = 32, focal: float = 50, near: float = 1.5, far: float = 9.0) -> list[float]:
    pose = np.column_stack([np.eye(3)[1], np.eye(3)[0], -np.eye(3)[2], [1.0, 2, 3], [height, width, focal]])
    return [*pose.ravel(), near, far]


def test_llff_intrinsics_follow_the_pictures_size_on_either_axis(folder: Path) -> None:
    """Photos of 32×24 pixels, of which the file says that they were 32×48."""
    scene = load_scene(write_llff(folder, [row(), row(near=0.5), row(far=11)]))
    np.testing.assert_allclose(scene.cameras[0].K, [[50, 0, 16], [0, 25, 12], [0, 0, 1]])
    np.testing.assert_allclose(scene.cameras[0].c2w[:3], [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3]])
    assert (scene.near, scene.far) == (0.5, 11)
    assert load_scene(write_llff(folder, [row(1, 1, 2)] * 3)).cameras[0].K[:2, :2].tolist() == [[64, 0], [0, 48]]
    write_llff(folder, [row(), row(near=0.5), row(far=11)])
    assert load_scene(folder, near=0.7).depth_range() == (0.7, 11)
    assert load_scene(folder, far=7.0).depth_range() == (0.5, 7)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (np.zeros((3, 16)), "3 16 17"),
        (np.full((3, 17), "a"), "17"),
        (np.full((3, 17), np.nan), "NaN"),
        ([row(), row(), row(height=0.5)], "row 2 32x0.5"),
        ([row(focal=-1)] * 3, "row 0 K"),
        ([row()] * 2, "2 of 3 images/"),
    ],
)
def test_faults_of_llff_files_name_the_row(folder: Path, rows: Any, words: str) -> None:
    assert tells(refusal(write_llff(folder, rows)), words) and str(folder / "poses_bounds.npy") in refusal(folder)


def test_a_blender_scene_needs_no_option(tmp_path: Path) -> None:
    (tmp_path / "train").mkdir()
    frames = []
    for i in range(2):
        write_png(tmp_path / f"train/r_{i}.png", np.zeros((20, 20, 3), np.uint8))
        matrix = np.eye(4)
        matrix[0, 3] = i
        frames.append({"file_path": f"./train/r_{i}", "transform_matrix": matrix.tolist()})
    document = {"camera_angle_x": 2 * np.arctan(0.5), "frames": frames}
    (tmp_path / "transforms_train.json").write_text(json.dumps(document))
    scene = load_scene(tmp_path)
    np.testing.assert_allclose(scene.cameras[1].K, [[20, 0, 10], [0, 20, 10], [0, 0, 1]])
    np.testing.assert_allclose(scene.cameras[1].c2w[:3, :3], np.diag([1, -1, -1]))
    assert scene.images().shape == (2, 20, 20, 3)


# ---- what is no scene --------------------------------------------------------------------------------------------


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
        assert f"tinysplat poses {folder / 'images'}" in refusal(named)
    (folder / "desk.psx").write_text("")
    assert "Export Cameras" in refusal(folder) and f"tinysplat poses {folder / 'images'}" in refusal(folder)
    (tmp_path / "empty").mkdir()
    assert "tinysplat poses" not in refusal(tmp_path / "empty")


# ---- photos that are missing or turned --------------------------------------------------------------------------


def test_photos_that_are_not_there_are_left_out_and_counted(folder: Path) -> None:
    (folder / "images/0001.png").unlink()
    with pytest.warns(InputWarning) as told:
        scene = load_scene(write_transforms(folder, transforms()))
    assert tells(str(told[0].message), "transforms.json 1 of 3 0001.png")
    assert_cameras(scene, [CAMERAS[0], CAMERAS[2]])
    for photo in (folder / "images").iterdir():
        photo.unlink()
    assert len(load_scene(folder).frames) == 3  # as beside a video


def test_undistorted_photos_of_two_lenses_have_one_size(folder: Path) -> None:
    document = transforms(k1=-0.3)
    document["frames"][1].update(k1=-0.2)
    scene = load_scene(write_transforms(folder, document))
    sizes = {(frame.camera.height, frame.camera.width) for frame in scene.frames}
    alone = [load_scene(write_transforms(folder, transforms(k1=k1))).cameras[0] for k1 in (-0.3, -0.2)]
    assert len({(c.height, c.width) for c in alone}) == 2  # each for itself they differ
    assert len(sizes) == 1
    assert len(scene.images()) == 3
