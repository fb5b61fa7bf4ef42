"""What `decode` and `convert` write of a capture: for viewers that draw everything, each surface once."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import make_cameras

import tinysplat_runtime as ts
from tinysplat_runtime.cli.run import main
from tinysplat_runtime.cli.written import is_drawn_whole
from tinysplat_runtime.formats.table import save_gaussians
from tinysplat_runtime.gaussian.editing import select_views
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.thin import thinned


@pytest.fixture
def capture(tmp_path):
    """A wall in a file, seen by eight views; the Gaussians and the file's name."""
    cameras = make_cameras(8, 12, 16, turn=0, spacing=0.1)
    y, x = np.mgrid[:12, :16] + 0.5
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(cameras[0].K).T
    means = np.stack([3 * rays + camera.centre for camera in cameras])
    lead = means.shape[:3]
    quats = np.broadcast_to([1.0, 0, 0, 0], (*lead, 4))
    paint = np.sin(4 * means)[..., None, :]
    wall = Gaussians(means, quats, np.full((*lead, 3), 0.1), np.full(lead, 0.8), paint, cameras)
    save_gaussians(tmp_path / "g.npz", wall)
    return wall, str(tmp_path / "g.npz")


def converted(file: str, output: str, *options: str) -> Gaussians:
    assert main(["convert", file, "-o", output, "--force", *options]) == 0
    return ts.load_gaussians(output)


def test_lists_of_points_get_each_surface_of_a_capture_once_and_it_is_said(capture, tmp_path, capsys):
    wall, file = capture
    found = converted(file, str(tmp_path / "g.ply"))
    assert found.count == thinned(wall).count < 0.6 * wall.count
    said = capsys.readouterr().err
    assert f"{found.count} of {wall.count} Gaussians" in said and "--keep-all" in said


def test_what_keeps_views_keeps_all_as_do_few_views_and_whoever_asks(capture, tmp_path):
    wall, file = capture
    assert converted(file, str(tmp_path / "all.npz")).count == wall.count
    assert converted(file, str(tmp_path / "all.ply"), "--keep-all", "-q").count == wall.count
    few = converted(file, str(tmp_path / "few.ply"), "--views", "0-5", "-q")
    assert few.count == select_views(wall, range(6)).count
    trimmed = converted(file, str(tmp_path / "trimmed.ply"), "--trim-border", "1", "-q")
    assert trimmed.count == 8 * 10 * 14


@pytest.mark.parametrize("ending", [".ply", ".glb", ".tsplat"])
def test_fuse_is_done_for_so_many_seconds_says_what_it_did_and_writes_cameras_along(capture, tmp_path, capsys, ending):
    pytest.importorskip("numba")
    wall, file = capture
    found = converted(file, str(tmp_path / f"g{ending}"), "--fuse", "0.3", "--threads", "1")
    assert 0 < found.count <= thinned(wall).count
    assert "fused to" in capsys.readouterr().err
    assert len(found.viewpoints) == 8
    assert [path.name for path in tmp_path.glob("*.json")] == (["g.cameras.json"] if ending == ".ply" else [])


def test_fuse_needs_views(capture, tmp_path, capsys):
    pytest.importorskip("numba")
    _, file = capture
    assert main(["convert", file, "-o", str(tmp_path / "g.ply"), "--fuse", "1", "--trim-border", "1"]) == 2
    assert "expected per-pixel Gaussians of two or more" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "is_whole"),
    [("a.ply", True), ("a.SPZ", True), ("-.ply", True), ("-", False), ("-.npz", False), ("a.tsplat", False)],
)
def test_which_names_are_of_files_that_know_no_views(name, is_whole):
    assert is_drawn_whole(name) == is_whole
