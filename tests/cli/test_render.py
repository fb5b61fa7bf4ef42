"""`render`: which cameras look, what depths become, and what is said of pictures and videos."""

import json
from pathlib import Path

import av
import console
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scenes import make_cameras, make_list, make_smooth_gaussians, scene_document, tells

import tinysplat_runtime as ts
from tinysplat_runtime.cli.render import depth_colours, depth_map
from tinysplat_runtime.render.paths import outside
from tinysplat_runtime.scene.images import read_image


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two views in `g.tsplat` and `g.npz`, Gaussians of no views in `far/free.ply` and beside five cameras."""
    path = tmp_path_factory.mktemp("render")
    g = make_smooth_gaussians(2, 16, 24, degree=0)
    ts.save_gaussians(path / "g.npz", g)
    (path / "g.tsplat").write_bytes(ts.compress(g))
    free = make_list(40, 0, np.random.default_rng(1))
    (path / "far").mkdir()
    for name in ("free.ply", "far/free.ply"):  # the first beside cameras
        ts.save_gaussians(path / name, free)
    (path / "cameras.json").write_text(json.dumps(scene_document(make_cameras(5, 16, 24))))
    return path


def test_depths_become_numbers_and_what_reaches_beyond_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    found = depth_map("o.png", np.array([[0, 0.0001, 0.0006, 1.0004], [1.0006, 65.535, 65.536, 70]], np.float32), 1000)
    assert found.dtype == np.uint16
    assert found.tolist() == [[0, 0, 1, 1000], [1001, 65535, 65535, 65535]]
    said = capsys.readouterr().err
    assert tells(said, "o.png 2 --depth-scale")
    assert depth_map("o.png", np.array([[65.535, 1]], np.float32), 1000).tolist() == [[65535, 1000]]
    assert capsys.readouterr().err == ""


def test_depths_are_red_near_blue_far_and_green_halfway_in_inverse_depth() -> None:
    inverse = np.linspace(1, 1 / 3, 201)
    near, middle, far, nothing = depth_colours(np.append(1 / inverse, 0).astype(np.float32)[None])[
        0, [3, 100, 197, 201]
    ]
    assert [found.argmax() for found in (near, middle, far)] == [0, 1, 2] and not nothing.any()


def test_where_nothing_is_the_background_shows(folder: Path, tmp_path: Path) -> None:
    def picture(*words: object) -> NDArray:
        console.succeed("render", folder / "free.ply", "-o", tmp_path / "o.png", "--force", "-q", *words)
        return read_image(tmp_path / "o.png")

    black, white, named = picture(), picture("--background", "white"), picture("--background", "#ff8000")
    nothing = (white == 255).all(axis=2) & ~black.any(axis=2)
    assert 0.05 < nothing.mean() < 1 and (np.abs(named[nothing] - np.float64((255, 128, 0))) <= 2).all()


def test_a_video_has_the_frames_asked_for_and_of_more_views_more(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "many.json").write_text(json.dumps(scene_document(make_cameras(12, 16, 24))))

    def frames(*words: object) -> int:
        console.succeed("render", folder / "g.npz", "-o", tmp_path / "o.mp4", "--force", "-q", *words)
        with av.open(str(tmp_path / "o.mp4")) as video:
            return sum(1 for _ in video.decode(video=0))

    assert frames("--frames", "7") == frames("--frames", "7", "--path", "orbit") == 7
    assert frames("--camera", f"{tmp_path / 'many.json'}:0") > frames()


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("g.npz -o o.gif", "o.gif"),
        ("g.npz -o o.mp4 --depth", "o.mp4"),
        ("g.npz -o o.mp4 --depth-values", "o.mp4"),
        ("g.npz -o o.png --path orbit", "o.png"),
        ("g.npz -o o.png --camera 2", "--camera 2 0 1"),
        ("g.npz -o o.png --camera=-1", "--camera"),
        ("g.npz -o o.png --camera a:b", "--camera"),
        ("g.npz -o o.png --camera cameras.json:5", "--camera"),
        ("g.npz -o o.mp4 --camera 1", "--camera"),
        ("far/free.ply -o o.mp4 --path between", "--path"),
        ("g.npz -o o.png --panorama --size 64x48", "--size"),
        ("g.npz -o o.mp4 --panorama", "--panorama .png"),
        ("g.npz -o o.png --background greenish", "--background 'greenish' #rrggbb"),
    ],
)
def test_what_cannot_be_drawn_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch, words: str, line: str) -> None:
    monkeypatch.chdir(folder)
    assert tells(console.fail("render", *words.split()), line)


@pytest.mark.parametrize(
    ("words", "which"),
    [((), 0), (("--camera", "1"), 1), (("--camera", "CAMERAS:4"), 4), (("--camera", "CAMERAS:0"), 0)],
)
def test_the_camera_is_one_of_the_file_or_of_another(folder: Path, tmp_path: Path, words, which: int) -> None:
    given = [word.replace("CAMERAS", str(folder / "cameras.json")) for word in words]
    console.succeed("render", folder / "g.npz", "-o", tmp_path / "o.png", *given, "--report", tmp_path / "r.json")
    scene = ts.load_gaussians(folder / "g.npz")
    cameras = make_cameras(5, 16, 24) if "CAMERAS" in str(words) else scene.cameras
    wanted = ts.render(scene, cameras[which])
    assert np.abs(read_image(tmp_path / "o.png") / 255 - wanted).max() < 0.51 / 255 + 1e-5
    report = json.loads((tmp_path / "r.json").read_text())
    assert (report["gaussians"], report["sh_degree"]) == (768, 0) and report["seconds"]["render"] > 0


def test_a_360_picture_has_what_lies_ahead_in_its_middle(folder: Path, tmp_path: Path) -> None:
    console.succeed("render", folder / "g.npz", "-o", tmp_path / "o.png", "--panorama", "--size", "256x128")
    picture = read_image(tmp_path / "o.png")
    assert picture.shape == (128, 256, 3)
    rows, columns = np.nonzero(picture.max(axis=2) > 60)
    assert (
        abs(rows.mean() - 64) < 20 and abs(columns.mean() - 128) < 20 and 0.01 < len(rows) / picture[..., 0].size < 0.5
    )


def test_gaussians_of_no_views_are_seen_from_outside(folder: Path, tmp_path: Path) -> None:
    free = ts.load_gaussians(folder / "far/free.ply")
    wanted = ts.render(free, outside(free), (60, 80))
    console.succeed("render", folder / "far/free.ply", "-o", tmp_path / "o.png", "--size", "80x60")
    assert np.abs(read_image(tmp_path / "o.png") / 255 - wanted).max() < 0.51 / 255 + 1e-5 and wanted.max() > 0.3


def test_a_list_is_seen_from_where_its_photos_were_taken(folder: Path, tmp_path: Path) -> None:
    free, cameras = ts.load_gaussians(folder / "free.ply"), make_cameras(5, 16, 24)
    console.succeed("render", folder / "free.ply", "-o", tmp_path / "o.png", "--camera", "3")
    assert np.abs(read_image(tmp_path / "o.png") / 255 - ts.render(free, cameras[3])).max() < 0.51 / 255 + 1e-5
    console.succeed("render", folder / "free.ply", "-o", tmp_path / "o.mp4", "--path", "between")


@pytest.mark.parametrize("scale", [1000, 7])
def test_depth_values_are_z_in_the_scale_asked_for(folder: Path, tmp_path: Path, scale: int) -> None:
    console.succeed("render", folder / "g.npz", "-o", tmp_path / "o.png", "--depth-values", "--depth-scale", scale)
    scene = ts.load_gaussians(folder / "g.npz")
    depth = ts.render(scene, scene.cameras[0], outputs=("depth",))["depth"]
    found = np.asarray(Image.open(tmp_path / "o.png"))
    assert found.dtype == np.uint16 and np.abs(found - scale * depth.astype(np.float64)).max() <= 0.51
