"""`render`: which cameras look, what depths become, and what is said of pictures and videos."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import console
import numpy as np
import pytest
from scenes import make_cameras, make_free_gaussians, make_smooth_gaussians, scene_document

import tinysplat_runtime as ts
from tinysplat_runtime.cli import render as module
from tinysplat_runtime.cli.render import depth_colours, depth_map
from tinysplat_runtime.render.paths import orbit, outside
from tinysplat_runtime.scene.images import read_image


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two views in `g.tsplat` and `g.npz`, Gaussians of no views in `free.ply`, five cameras in `cameras.json`."""
    path = tmp_path_factory.mktemp("render")
    g = make_smooth_gaussians(2, 16, 24, degree=0)
    ts.save_gaussians(path / "g.npz", g)
    (path / "g.tsplat").write_bytes(ts.compress(g))
    ts.save_gaussians(path / "free.ply", make_free_gaussians(40, 0, np.random.default_rng(1)))
    (path / "cameras.json").write_text(json.dumps(scene_document(make_cameras(5, 16, 24))))
    return path


def test_depths_become_colours_even_in_one_over_z() -> None:
    """1/z of 0 to 1 in 101 steps: the percentiles 2 and 98 are 0.02 and 0.98, between them red falls, blue rises."""
    inverse = np.linspace(0, 1, 101)[1:]
    depth = np.concatenate([[0, -1], 1 / inverse]).astype(np.float32).reshape(2, 51)
    colours = depth_colours(depth)
    low, high = np.percentile(inverse, 2), np.percentile(inverse, 98)
    t = (inverse - low) / (high - low)
    expected = [[np.clip(1.5 - 3 * abs(v - at), 0, 1) for at in (0.75, 0.5, 0.25)] for v in t]
    assert colours.dtype == np.float32 and colours.shape == (2, 51, 3)
    np.testing.assert_allclose(colours.reshape(-1, 3)[2:], expected, atol=1e-4)
    assert (colours.reshape(-1, 3)[:2] == 0).all()
    near, middle, far = depth_colours(np.array([[1.0, 4 / 3, 2.0]], np.float32))[0]
    assert near[0] > 0.6 and near[2] == 0 and middle[1] == 1 and far[2] > 0.6 and far[0] == 0


def test_one_depth_alone_and_none_have_colours() -> None:
    assert (depth_colours(np.zeros((2, 3), np.float32)) == 0).all()
    same = depth_colours(np.full((2, 3), 2, np.float32))
    np.testing.assert_allclose(same, np.broadcast_to([0, 0, 0.75], (2, 3, 3)), atol=1e-6)


def test_depths_become_numbers_and_what_reaches_beyond_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    found = depth_map("o.png", np.array([[0, 0.0001, 0.0006, 1.0004], [1.0006, 65.535, 65.536, 70]], np.float32), 1000)
    assert found.dtype == np.uint16
    assert found.tolist() == [[0, 0, 1, 1000], [1001, 65535, 65535, 65535]]
    assert capsys.readouterr().err == (
        "o.png: 2 pixels deeper than 65.535 units written as 65.535; a smaller --depth-scale reaches farther\n"
    )
    assert depth_map("o.png", np.array([[65.535, 1]], np.float32), 1000).tolist() == [[65535, 1000]]
    assert capsys.readouterr().err == ""


class Spy:
    """Notes what a renderer is asked for, and draws black."""

    def __init__(self, gaussians: ts.Gaussians, threads: int | None, **options: object) -> None:
        self.options, self.drawn = options, list[object]()
        spies.append(self)

    def render(self, camera: ts.Camera, size: object = None, outputs: Sequence[str] = ("rgb",)) -> object:
        height, width = size or (camera.height, camera.width)
        self.drawn.append((camera, size, tuple(outputs)))
        return {"depth": np.ones((height, width), np.float32)} if "depth" in outputs else np.zeros((height, width, 3))


spies: list[Spy] = []


@pytest.fixture
def spy(monkeypatch: pytest.MonkeyPatch) -> list[Spy]:
    monkeypatch.setattr(module, "Renderer", Spy)
    spies.clear()
    return spies


@pytest.mark.parametrize(
    ("words", "which"),
    [((), 0), (("--camera", "1"), 1), (("--camera", "CAMERAS:4"), 4), (("--camera", "CAMERAS:0"), 0)],
)
def test_the_camera_is_one_of_the_file_or_of_another(folder: Path, tmp_path: Path, spy, words, which: int) -> None:
    words = [word.replace("CAMERAS", str(folder / "cameras.json")) for word in words]
    console.succeed("render", folder / "g.npz", "-o", tmp_path / "o.png", *words)
    camera, size, outputs = spy[0].drawn[0]
    cameras = (
        make_cameras(5, 16, 24) if "cameras.json" in str(words) else make_smooth_gaussians(2, 16, 24, degree=0).cameras
    )
    np.testing.assert_allclose(camera.c2w, cameras[which].c2w, atol=1e-6)
    assert size is None and outputs == ("rgb",)
    assert spy[0].options == {"dilation": "own", "order": "near", "compiled": False, "keep": False}


def test_gaussians_of_no_views_are_seen_from_outside(folder: Path, tmp_path: Path, spy) -> None:
    console.succeed("render", folder / "free.ply", "-o", tmp_path / "o.png", "--size", "6x8", "--order", "depth")
    camera, size, _ = spy[0].drawn[0]
    np.testing.assert_allclose(camera.c2w, outside(ts.load_gaussians(folder / "free.ply")).c2w)
    assert size == (6, 8) and spy[0].options["order"] == "depth"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("g.npz -o o.gif", "o.gif: '.gif', accepted are .png and .mp4"),
        ("g.npz -o o.mp4 --depth", "o.mp4: a depth map is a picture; expected an output that ends in .png"),
        ("g.npz -o o.mp4 --depth-values", "o.mp4: a depth map is a picture; expected an output that ends in .png"),
        ("g.npz -o o.png --path orbit", "o.png: a path makes a video; expected an output that ends in .mp4"),
        ("g.npz -o o.png --camera 2", "--camera: 2, accepted are 0 to 1"),
        ("g.npz -o o.png --camera=-1", "--camera: -1, accepted are 0 to 1"),
        ("g.npz -o o.png --camera a:b", "--camera: 'a:b', expected INDEX or cameras.json:INDEX"),
        ("g.npz -o o.png --camera cameras.json:5", "--camera: 5, accepted are 0 to 4"),
        ("g.npz -o o.mp4 --camera 1", "--camera: a video takes all views, those of --camera cameras.json:INDEX"),
        ("free.ply -o o.mp4 --path between",
         "--path: free.ply has no views to fly between; --path orbit, or --camera cameras.json:0"),
    ],
)  # fmt: skip
def test_what_cannot_be_drawn_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch, words: str, line: str) -> None:
    monkeypatch.chdir(folder)
    assert console.fail("render", *words.split()) == f"tinysplat: {line}\n"


def film(monkeypatch: pytest.MonkeyPatch, *words: object) -> tuple[list[object], str]:
    """The cameras of a video that is not written, and what is said of it."""
    from tinysplat_runtime.render import video

    monkeypatch.setattr(video, "write_video", lambda output, frames: [None for _ in frames])
    said = console.succeed("render", *words)
    return spies[-1].drawn, said


@pytest.mark.parametrize(
    ("file", "words", "frames"),
    [
        ("g.npz", (), 60), ("g.npz", ("--frames", 7), 7), ("g.npz", ("--path", "orbit"), 60),
        ("free.ply", (), 60), ("free.ply", ("--frames", 3, "--path", "orbit"), 3),
        ("g.npz", ("--camera", "nine.json:0"), 64), ("g.npz", ("--camera", "cameras.json:0"), 60),
    ],
)  # fmt: skip
def test_videos_have_sixty_frames_or_eight_from_view_to_view(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spy, file: str, words, frames: int
) -> None:
    monkeypatch.chdir(folder)
    (folder / "nine.json").write_text(json.dumps(scene_document(make_cameras(9, 16, 24))))
    drawn, said = film(monkeypatch, file, "-o", tmp_path / "o.mp4", *words)
    assert len(drawn) == frames
    found = re.fullmatch(rf".*o\.mp4: (\d+\.\d{{3}}) s, {frames} frames, (\d+\.\d) frames/s\n", said)
    assert found and float(found[2]) >= frames / (float(found[1]) + 6e-4) - 0.06
    assert spy[-1].options == {"dilation": "own", "order": "near", "compiled": None, "keep": True}


@pytest.mark.parametrize("shift", [0, -100])
def test_an_orbit_goes_about_the_median_of_what_lies_in_front(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spy, shift: int
) -> None:
    """Of Gaussians at z of 1, 2, 6, 7 and 8 about an origin, of which one lies behind; of none in front, 1 unit."""
    camera = ts.Camera([[20, 0, 2], [0, 20, 0], [0, 0, 1]], np.eye(4), 5, 1)
    means = np.zeros((1, 1, 5, 3))
    means[..., 2] = np.array([-9, 2, 6, 7, 8]) + shift
    lead = means.shape[:3]
    g = ts.Gaussians(
        means, np.tile([1.0, 0, 0, 0], (*lead, 1)), np.full((*lead, 3), 0.1), np.full(lead, 0.5),
        np.zeros((*lead, 1, 3)), (camera,),
    )  # fmt: skip
    ts.save_gaussians(tmp_path / "g.npz", g)
    drawn, _ = film(monkeypatch, tmp_path / "g.npz", "-o", tmp_path / "o.mp4", "--path", "orbit", "--frames", 4)
    expected = orbit([camera], 4, 6.5 if shift == 0 else 1.0)
    for (found, *_), wanted in zip(drawn, expected, strict=True):
        np.testing.assert_allclose(found.c2w, wanted.c2w, atol=1e-9)


def test_depth_values_are_z_in_the_scale_asked_for_and_depth_alone_is_in_colours(folder: Path, tmp_path: Path, spy):
    for options, expected in ((("--depth-values",), 1000), (("--depth-values", "--depth-scale", 7), 7)):
        console.succeed("render", folder / "g.npz", "-o", tmp_path / "o.png", "--force", *options)
        assert spy[-1].drawn[0][2] == ("depth",)
        data = (tmp_path / "o.png").read_bytes()
        assert data[24:26] == bytes([16, 0])  # bits and colours of PNG's header: one channel of 16
        from PIL import Image

        with Image.open(tmp_path / "o.png") as picture:
            assert (np.asarray(picture) == expected).all()
    console.succeed("render", folder / "g.npz", "-o", tmp_path / "o.png", "--force", "--depth")
    assert read_image(tmp_path / "o.png").shape == (16, 24, 3)


@pytest.mark.parametrize("file", ["g.tsplat", "g.npz"])
def test_reports_say_what_was_drawn(folder: Path, tmp_path: Path, spy, file: str) -> None:
    words = console.succeed("render", folder / file, "-o", tmp_path / "o.png", "--report", tmp_path / "r.json")
    assert re.fullmatch(r".*o\.png: \d+\.\d{3} s\n", words)
    text = (tmp_path / "r.json").read_text()
    report = json.loads(text)
    assert text == json.dumps(report, indent=2) + "\n"
    assert (report["gaussians"], report["sh_degree"]) == (768, 0) and report["peak_rss_bytes"] > 1e7
    assert report["seconds"]["render"] > 0
    assert ("bytes" in report) == (file == "g.tsplat") and report.get("bytes") in (None, (folder / file).stat().st_size)
