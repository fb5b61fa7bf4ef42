"""One contract for all that `load_scene` reads: the same scene, however it is written, and no fault but InputError."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from scene import trackers
from scenes import (
    colmap_texts,
    make_cameras,
    make_photo,
    realestate_line,
    scene_document,
    tells,
    transforms_document,
    write_scene,
)
from scipy.spatial.transform import Rotation

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.intake.layouts import load_cameras, load_scene

HEIGHT, WIDTH = 24, 32
CAMERAS = make_cameras(3, HEIGHT, WIDTH, shift=(0, 0))  # some layouts have no principal point but the middle
POINTS = np.array([[0.1, 0.05, 3.0], [-0.2, 0.1, 4.0], [0.0, -0.1, 5.0], [0.3, 0.0, 6.0]])


def ours(folder: Path) -> Path:
    (folder / "cameras.json").write_text(json.dumps(scene_document(CAMERAS)))
    return folder / "cameras.json"


def nerfstudio(folder: Path) -> Path:
    (folder / "transforms.json").write_text(json.dumps(transforms_document(CAMERAS)))
    return folder / "transforms.json"


def inria(folder: Path) -> Path:
    """What the reference code of 3DGS writes beside its Gaussians."""
    entries = [
        {
            "id": i,
            "img_name": f"{i:04}",
            "width": WIDTH,
            "height": HEIGHT,
            "fx": c.K[0, 0],
            "fy": c.K[1, 1],
            "position": c.centre.tolist(),
            "rotation": c.c2w[:3, :3].tolist(),
        }
        for i, c in enumerate(CAMERAS)
    ]
    (folder / "cameras.json").write_text(json.dumps(entries))
    return folder / "cameras.json"


def llff(folder: Path) -> Path:
    """Axes down, right and back; height, width and focal length behind each pose."""
    rows = []
    for c in CAMERAS:
        x, y, z = c.c2w[:3, :3].T
        pose = np.column_stack([y, x, -z, c.centre, [HEIGHT, WIDTH, c.focal]])
        rows.append([*pose.ravel(), 1.5, 9.0])
    np.save(folder / "poses_bounds.npy", np.array(rows))
    return folder / "poses_bounds.npy"


def colmap_text(folder: Path) -> Path:
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    for name, text in colmap_texts(CAMERAS, POINTS).items():
        (model / name).write_text(text)
    return model / "images.txt"


def colmap_binary(folder: Path) -> Path:
    text = colmap_text(folder).parent
    pycolmap.Reconstruction(text).write_binary(text)
    for file in text.glob("*.txt"):
        file.unlink()
    return text / "images.bin"


def realestate(folder: Path) -> Path:
    lines = ["https://www.youtube.com/watch?v=x"]
    for i, c in enumerate(CAMERAS):
        (folder / "images" / f"{i:04}.png").rename(folder / "images" / f"{i * 1000}.png")
        lines.append(realestate_line(i * 1000, c))
    (folder / "clip.txt").write_text("\n".join(lines) + "\n")
    return folder / "clip.txt"


def polycam(folder: Path) -> Path:
    """A file for each photo; OpenGL axes."""
    keyframes = folder / "keyframes"
    (keyframes / "cameras").mkdir(parents=True)
    (folder / "images").rename(keyframes / "images")
    (folder / "images").symlink_to(keyframes / "images")
    for i, c in enumerate(CAMERAS):
        rows = (c.c2w * [1, -1, -1, 1])[:3]
        pose = {f"t_{r}{column}": rows[r, column] for r in range(3) for column in range(4)}
        lens = {"fx": c.K[0, 0], "fy": c.K[1, 1], "cx": c.K[0, 2], "cy": c.K[1, 2], "width": WIDTH, "height": HEIGHT}
        (keyframes / "cameras" / f"{i:04}.json").write_text(json.dumps({**lens, **pose}))
    return keyframes / "cameras" / "0001.json"


def record3d(folder: Path) -> Path:
    """K by columns, quaternions with the real part last; OpenGL axes."""
    (folder / "rgb").mkdir()
    for i in range(len(CAMERAS)):
        (folder / "images" / f"{i:04}.png").rename(folder / "rgb" / f"{i}.png")
    (folder / "images").rmdir()
    (folder / "images").symlink_to(folder / "rgb")
    poses = [
        [*Rotation.from_matrix(c.c2w[:3, :3] * [1, -1, -1]).as_quat().tolist(), *c.centre.tolist()] for c in CAMERAS
    ]
    document = {"w": WIDTH, "h": HEIGHT, "K": CAMERAS[0].K.T.ravel().tolist(), "poses": poses}
    (folder / "metadata.json").write_text(json.dumps(document))
    return folder / "metadata.json"


def opensfm(folder: Path) -> Path:
    """Angle times axis into the camera; lengths in units of the longer side, from the middle."""
    K = CAMERAS[0].K / max(HEIGHT, WIDTH)
    camera = {"projection_type": "brown", "width": WIDTH, "height": HEIGHT, "focal_x": K[0, 0], "focal_y": K[1, 1]}
    shots = {
        f"{i:04}.png": {
            "camera": "one",
            "rotation": Rotation.from_matrix(c.w2c[:3, :3]).as_rotvec().tolist(),
            "translation": c.w2c[:3, 3].tolist(),
        }
        for i, c in enumerate(CAMERAS)
    }
    smaller = {"cameras": {}, "shots": {"else.png": {}}}
    (folder / "reconstruction.json").write_text(json.dumps([smaller, {"cameras": {"one": camera}, "shots": shots}]))
    return folder / "reconstruction.json"


pytestmark = pytest.mark.filterwarnings("ignore::tinysplat_runtime.errors.InputWarning")
"""Of photos that are not there: left out, and counted."""

LAYOUTS: dict[str, Callable[[Path], Path]] = {
    write.__name__: write
    for write in (ours, nerfstudio, inria, llff, colmap_text, colmap_binary, realestate, polycam, record3d, opensfm)
}
LAYOUTS |= {write.__name__: partial(write, cameras=CAMERAS) for write in (trackers.metashape, trackers.realityscan)}
LAYOUTS |= {
    write.__name__: partial(write, cameras=CAMERAS, points=POINTS) for write in (trackers.bundler, trackers.meshroom)
}


@pytest.fixture(params=LAYOUTS.values(), ids=LAYOUTS)
def written(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, Path]:
    """What is opened, and the file of it that is tampered with."""
    folder = write_scene(tmp_path / "desk", 3, HEIGHT, WIDTH)
    (folder / "cameras.json").unlink()
    file = request.param(folder)
    return (file if request.param is realestate else folder), file


def test_cameras_and_photos_are_those_that_were_written(written: tuple[Path, Path]) -> None:
    scene = load_scene(written[0])
    for cameras in (scene.cameras, load_cameras(written[0])):
        assert len(cameras) == 3
        for found, wanted in zip(cameras, CAMERAS, strict=True):
            np.testing.assert_allclose(found.K, wanted.K, atol=1e-6)
            np.testing.assert_allclose(found.c2w, wanted.c2w, atol=1e-6)
            assert (found.height, found.width) == (HEIGHT, WIDTH)
    photos = np.stack([make_photo(HEIGHT, WIDTH, seed=i) for i in range(3)]) / np.float32(255)
    np.testing.assert_array_equal(scene.images(), photos)


def test_hidden_files_beside_every_file_change_nothing(written: tuple[Path, Path]) -> None:
    """macOS leaves one beside each file on foreign disks; Windows and Finder leave others in each folder."""
    folder = written[0] if written[0].is_dir() else written[0].parent
    before = [frame.path for frame in load_scene(written[0]).frames]
    for file in [path for path in folder.rglob("*") if path.is_file()]:
        (file.parent / f"._{file.name}").write_bytes(bytes.fromhex("0005160700020000") + bytes(500))
        for name in (".DS_Store", "Thumbs.db", "desktop.ini"):
            (file.parent / name).write_bytes(b"x")
    scene = load_scene(written[0])
    assert [frame.path for frame in scene.frames] == before and len(scene.images()) == 3


def test_endings_of_photos_may_be_written_otherwise(written: tuple[Path, Path]) -> None:
    folder = written[0] if written[0].is_dir() else written[0].parent
    wanted = load_scene(written[0]).images()
    for photo in sorted(folder.glob("images/*.png")):
        photo.rename(photo.with_suffix(".PNG"))
    np.testing.assert_array_equal(load_scene(written[0]).images(), wanted)


def test_depths_that_are_given_replace_the_scenes_own(written: tuple[Path, Path]) -> None:
    assert load_scene(written[0], near=1.25, far=20.0).depth_range() == (1.25, 20.0)


def load_or_refuse(path: Path, folder: Path) -> int:
    """How many frames a scene has that may be damaged; 0 where it is refused in a line that names where."""
    try:
        return len(load_scene(path).frames)
    except InputError as error:
        assert "\n" not in str(error) and (str(folder) in str(error) or "frames" in str(error)), error
        return 0


def test_an_empty_file_is_refused(written: tuple[Path, Path]) -> None:
    path, file = written
    file.write_bytes(b"")
    assert load_or_refuse(path, file.parent) == 0


def test_damage_is_refused_in_a_line_or_leaves_fewer_frames(written: tuple[Path, Path]) -> None:
    """Cut anywhere, and with bytes changed."""
    path, file = written
    whole, rng = file.read_bytes(), np.random.default_rng(0)
    tries = 4 if file.suffix in (".bin", ".txt") and path.is_dir() else 40  # COLMAP's are read by a process each
    for cut in rng.integers(0, len(whole) - 2, tries):
        file.write_bytes(whole[:cut])
        assert load_or_refuse(path, file.parent) <= 3
    for at, value in zip(rng.integers(0, len(whole), tries), rng.integers(1, 256, tries), strict=True):
        changed = bytearray(whole)
        changed[at] ^= value
        file.write_bytes(changed)
        load_or_refuse(path, file.parent)


def test_a_photo_that_is_not_there_is_named_or_left_out(written: tuple[Path, Path]) -> None:
    path, _ = written
    gone = sorted((path if path.is_dir() else path.parent).glob("images/*.png"))[1]
    gone.unlink()
    try:
        images = load_scene(path).images()
    except InputError as error:
        assert gone.stem in str(error) or tells(str(error), "2 of 3")
    else:
        assert len(images) == 2
