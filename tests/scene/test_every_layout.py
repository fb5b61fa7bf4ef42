"""One contract for all that `load_scene` reads: the same scene, however it is written, and no fault but InputError."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pycolmap
import pytest
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


def metashape(folder: Path) -> Path:
    """Camera to chunk with OpenCV axes, of which a component has the scale; the principal point from the middle."""
    K, scale = CAMERAS[0].K, 2.5
    poses = [np.column_stack([c.c2w[:3, :3], c.centre / scale]) for c in CAMERAS]
    cameras = [
        f'<camera id="{i}" sensor_id="0" component_id="0" label="{i:04}">'
        f"<transform>{' '.join(map(repr, [*pose.ravel().tolist(), 0, 0, 0, 1]))}</transform></camera>"
        for i, pose in enumerate(poses)
    ]
    lens = f"<f>{K[1, 1]}</f><b1>{K[0, 0] - K[1, 1]}</b1><cx>{K[0, 2] - WIDTH / 2}</cx><cy>{K[1, 2] - HEIGHT / 2}</cy>"
    (folder / "cameras.xml").write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0"><chunk label="Chunk 1" enabled="true">'
        f'<sensors next_id="1"><sensor id="0" label="X" type="frame"><resolution width="{WIDTH}" height="{HEIGHT}"/>'
        f'<calibration type="frame" class="adjusted">{lens}</calibration></sensor></sensors><components>'
        f'<component id="0"><transform><scale>{scale}</scale></transform></component></components>'
        f'<cameras>{"".join(cameras)}<camera id="9" sensor_id="0" label="lost"/></cameras></chunk></document>'
    )
    return folder / "cameras.xml"


def realityscan(folder: Path) -> Path:
    """Angles about z, x and y of a camera that looks down; lengths of a picture 36 wide along its longer side."""
    K, longer = CAMERAS[0].K, max(HEIGHT, WIDTH)
    lens = [K[0, 0] * 36 / longer, (K[0, 2] - WIDTH / 2) / longer, (K[1, 2] - HEIGHT / 2) / longer, 0, 0, 0, 0, 0, 0]
    lines = ["#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"]
    for i, c in enumerate(CAMERAS):
        yaw, pitch, roll = Rotation.from_matrix(c.c2w[:3, :3] * [1, -1, -1]).as_euler("ZXY", degrees=True)
        lines.append(",".join(map(str, [f"{i:04}.png", *c.centre, -yaw, pitch, roll, *lens])))
    (folder / "cameras.csv").write_text("\n".join(lines) + "\n")
    return folder / "cameras.csv"


def bundler(folder: Path) -> Path:
    """Into a camera whose y points up and z backward; one that was not placed; points with a line of views."""
    blocks, flip = [], np.diag([1.0, -1, -1])
    for c in CAMERAS:
        rows = np.vstack([[c.focal, 0, 0], flip @ c.w2c[:3, :3], flip @ c.w2c[:3, 3]])
        blocks += [" ".join(map(repr, row)) for row in rows.tolist()]
    blocks += ["0 0 0"] * 5
    for point in POINTS:
        blocks += [" ".join(map(str, point)), "9 9 9", "2 0 0 1.0 1.0 1 0 1.0 1.0"]
    (folder / "bundle.out").write_text("\n".join(["# Bundle file v0.3", f"4 {len(POINTS)}", *blocks]) + "\n")
    (folder / "list.txt").write_text("".join(f"./images/{i:04}.png 0 35.2\n" for i in range(3)) + "lost.png\n")
    return folder / "bundle.out"


def meshroom(folder: Path) -> Path:
    """The rotation out of the camera row by row, words in place of numbers, millimetres of the sensor's width."""
    K = CAMERAS[0].K
    lens = {"intrinsicId": "7", "width": str(WIDTH), "height": str(HEIGHT), "type": "pinhole", "sensorWidth": "36"}
    lens |= {"focalLength": str(K[0, 0] * 36 / WIDTH), "pixelRatio": "1", "distortionType": "none"}
    lens |= {"principalPoint": [str(K[0, 2] - WIDTH / 2), str(K[1, 2] - HEIGHT / 2)]}
    views = [
        {"viewId": str(i), "poseId": str(i), "intrinsicId": "7", "path": f"/home/jo/shots/{i:04}.png"} for i in range(4)
    ]
    poses = [
        {
            "poseId": str(i),
            "pose": {
                "transform": {
                    "rotation": [str(value) for value in c.c2w[:3, :3].ravel()],
                    "center": [str(value) for value in c.centre],
                }
            },
        }
        for i, c in enumerate(CAMERAS)
    ]
    landmarks = [{"X": [str(value) for value in point]} for point in POINTS]
    document = {"version": ["1", "2", "8"], "views": views, "intrinsics": [lens], "poses": poses}
    (folder / "cameras.sfm").write_text(json.dumps({**document, "structure": landmarks}))
    return folder / "cameras.sfm"


pytestmark = pytest.mark.filterwarnings("ignore::tinysplat_runtime.errors.InputWarning")
"""Of photos that are not there: left out, and counted."""

LAYOUTS: list[Callable[[Path], Path]] = [
    ours, nerfstudio, inria, llff, colmap_text, colmap_binary, realestate, polycam, record3d, opensfm, metashape,
    realityscan, bundler, meshroom,
]  # fmt: skip


@pytest.fixture(params=LAYOUTS, ids=lambda write: write.__name__)
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
