"""`convert`, `decode`, `render --depth`: files that other programs' readers open, and what cannot be kept is said."""

import re
import subprocess
from pathlib import Path

import numpy as np
import plyfile
import pytest
from console import fail, tinysplat
from PIL import Image
from scenes import make_smooth_gaussians, tells

import tinysplat_runtime as ts


def succeed(*arguments: object) -> subprocess.CompletedProcess[str]:
    done = tinysplat(*arguments)
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("convert")
    ts.save_gaussians(folder / "g.npz", make_smooth_gaussians(2, 20, 24, degree=4))
    succeed("compress", folder / "g.npz", "-o", folder / "g.tsplat")
    return {"folder": folder, "npz": folder / "g.npz", "tsplat": folder / "g.tsplat"}


@pytest.mark.parametrize("suffix", [".ply", ".spz"])
def test_a_coded_scene_goes_out_and_its_loss_is_said(files: dict[str, Path], tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"g{suffix}"
    options = ("--views", "1", "--trim-border", "2", "--min-opacity", "0.2", "--sh-degree", "3")
    done = succeed("decode", files["tsplat"], "-o", out, *options)
    assert done.stderr == ""
    count = ts.load_gaussians(out).count
    assert 0 < count <= 16 * 20 and str(count) in done.stdout
    done = succeed("convert", files["npz"], "-o", out, "--force")
    assert tells(done.stderr, "SH 4 3") and done.stderr.count("\n") == 1


def test_gaussians_go_out_widened_and_are_drawn_as_one_likes(files: dict[str, Path], tmp_path: Path) -> None:
    succeed("convert", files["npz"], "-o", tmp_path / "wide.npz", "--dilate")
    assert (ts.load_gaussians(tmp_path / "wide.npz").scales > ts.load_gaussians(files["npz"]).scales).all()
    succeed("convert", files["npz"], "-o", tmp_path / "g.ply")
    assert "dilate" in fail("convert", tmp_path / "g.ply", "-o", tmp_path / "wide.ply", "--dilate", "0.2")
    pictures = []
    for options in ((), ("--dilation", "screen"), ("--order", "depth"), ("--dilation", "screen", "--order", "depth")):
        succeed("render", files["npz"], "-o", tmp_path / "x.png", "--size", "48x40", "--force", *options)
        pictures.append(np.array(Image.open(tmp_path / "x.png"), int))
    assert all((a != b).any() for i, a in enumerate(pictures) for b in pictures[:i])
    found = ts.load_gaussians(files["npz"])
    plain = ts.render(found.flat(), found.cameras[0], (40, 48), dilation="screen")
    assert np.abs(pictures[-1] - 255 * plain).max() <= 0.51


def test_files_are_joined_turned_enlarged_and_moved(files: dict[str, Path], tmp_path: Path) -> None:
    moves = ("--rotate", "y,90", "--scale", "2", "--translate", "1,0,0")
    succeed("convert", files["npz"], files["tsplat"], "-o", tmp_path / "g.ply", *moves, "--sh-degree", "1")
    raw = ts.load_gaussians(files["npz"]).flat()
    vertex = plyfile.PlyData.read(tmp_path / "g.ply")["vertex"]
    assert len(vertex.data) == 2 * raw.count and "f_rest_8" in vertex and "f_rest_9" not in vertex
    x, y, z = (vertex[axis][: raw.count] for axis in "xyz")
    np.testing.assert_allclose(np.stack([x, y, z], 1), raw.means[:, [2, 1, 0]] * (2, 2, -2) + (1, 0, 0), atol=1e-5)


def test_a_measured_length_makes_units_metres(files: dict[str, Path], tmp_path: Path) -> None:
    scene = ts.load_gaussians(files["npz"])
    camera, depth = scene.cameras[1], ts.render(scene, scene.cameras[1], outputs=("depth",))["depth"]
    one, other = (
        camera.centre + np.linalg.solve(camera.K, (u, 10.5, 1)) * depth[10, int(u)] @ camera.rotation
        for u in (4.5, 19.5)
    )
    units = np.linalg.norm(other - one)
    done = succeed("convert", files["npz"], "-o", tmp_path / "view.npz", "--length", "1:4.5,10.5,19.5,10.5=74cm")
    found = ts.load_gaussians(tmp_path / "view.npz")
    scales = np.array([camera.centre for camera in found.cameras]) / [camera.centre for camera in scene.cameras]
    np.testing.assert_allclose(scales[:, 0], 0.74 / units, rtol=0.02)
    assert found.notes.unit == "metre" and tells(done.stderr, "0.74")
    points = ",".join(map(str, [*one, *other]))
    succeed("decode", files["tsplat"], "-o", tmp_path / "points.ply", f"--length={points}=2.5ft", "--level")
    assert ts.load_gaussians(tmp_path / "points.ply").notes.unit == "metre"


@pytest.mark.parametrize(
    ("length", "fault"),
    [
        ("1:4,10,19=1m", "1:4,10,19=1m"),
        ("1:4,10,19,10=1", "1:4,10,19,10=1"),
        ("1:4,10,19,10=-1m", "1:4,10,19,10=-1m"),
        ("2:4,10,19,10=1m", "view 2 0 1"),
        ("1:4,10,99,10=1m", "99,10 24x20"),
        ("1:4,10,4,10=1m", "one point"),
    ],
)
def test_lengths_that_measure_nothing_are_refused(files: dict[str, Path], length: str, fault: str) -> None:
    said = fail("convert", files["npz"], "-o", files["folder"] / "no.ply", "--length", length)
    assert "--length" in said and tells(said, fault)


def test_a_moved_coded_scene_keeps_pixels_cameras_and_the_quality_it_had(
    files: dict[str, Path], tmp_path: Path
) -> None:
    coarse, moved = tmp_path / "coarse.tsplat", tmp_path / "moved.tsplat"
    succeed("compress", files["npz"], "-o", coarse, "--profile", "fast", "--qp", "6")
    before = ts.load_gaussians(coarse)

    def moved_by(*options: str) -> ts.Gaussians:
        succeed("convert", coarse, "-o", moved, "--force", *options)
        described = ts.inspect(moved.read_bytes())
        assert (described["profile"], described["qp"], described["views"]) == ("fast", 6, 2)
        return ts.load_gaussians(moved)

    after = moved_by("--translate", "-1,0,2")
    for name in ("quats", "scales", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    turned = moved_by("--rotate", "x,180")
    np.testing.assert_allclose(turned.cameras[1].c2w[:3, :3], np.diag((1, -1, -1)) @ before.cameras[1].c2w[:3, :3])
    np.testing.assert_allclose(moved_by("--scale", "2").scales, 2 * before.scales, rtol=0.05)
    succeed("compress", files["npz"], "-o", coarse, "--lossless", "--force")
    succeed("convert", coarse, "-o", moved, "--rotate", "y,90", "--force")
    assert ts.inspect(moved.read_bytes())["mode"] == "lossless"


def test_check_says_bytes_and_loss(files: dict[str, Path], tmp_path: Path) -> None:
    done = succeed("convert", files["npz"], "-o", tmp_path / "g.spz", "--check")
    said = re.search(r"([\d.]+) KB", done.stdout)
    assert said and abs(float(said[1]) - (tmp_path / "g.spz").stat().st_size / 1e3) < 0.5 and " dB" in done.stdout
    assert "--check" in fail("convert", files["npz"], "-o", tmp_path / "p.ply", "--points", "--check")
