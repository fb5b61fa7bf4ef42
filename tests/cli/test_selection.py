"""What `decode` and `convert` write of a capture."""

import numpy as np
import pytest
from scenes import make_cameras

import tinysplat_runtime as ts
from tinysplat_runtime.cli.run import main
from tinysplat_runtime.formats.table import save_gaussians
from tinysplat_runtime.gaussian.editing import select_views
from tinysplat_runtime.gaussian.gaussians import Gaussians


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


def test_all_gaussians_are_written_of_the_views_that_are_chosen(capture, tmp_path):
    wall, file = capture
    assert converted(file, str(tmp_path / "all.npz")).count == wall.count
    assert converted(file, str(tmp_path / "all.ply")).count == wall.count
    few = converted(file, str(tmp_path / "few.ply"), "--views", "0-5", "-q")
    assert few.count == select_views(wall, range(6)).count
    trimmed = converted(file, str(tmp_path / "trimmed.ply"), "--trim-border", "1", "-q")
    assert trimmed.count == 8 * 10 * 14


@pytest.mark.parametrize(
    ("ending", "words", "options"),
    [
        (".ply", (), {}),
        (".spz", ("--min-opacity", "0.3", "--sh-bits", "8,8"), {"min_opacity": 0.3, "sh_bits": (8, 8)}),
        (".glb", ("--rotate", "x,90", "--scale", "2"), {"rotate": "x,90", "scale": 2}),
        (".ply", ("--crop=-9,-9,-9,0,9,9", "--unit", "metre"), {"crop": (-9, -9, -9, 0, 9, 9), "unit": "metre"}),
        (".ply", ("--prune", "0.5"), {"prune": 0.5}),
        (".tsplat", ("--views", "0,2"), {"views": (0, 2)}),
        (".tsplat", ("--translate", "1,2,3"), {"translate": (1, 2, 3)}),
        (".ply", ("--points",), {"points": True}),
    ],
)
@pytest.mark.parametrize("source", ["g.npz", "g.tsplat"])
def test_python_writes_the_very_bytes_of_the_command(capture, tmp_path, source, ending, words, options):
    if "prune" in options:
        pytest.importorskip("numba")
    ts.convert(tmp_path / "g.npz", tmp_path / "g.tsplat")
    by_command, by_python = (tmp_path / f"{name}{ending}" for name in ("command", "python"))
    assert main(["convert", str(tmp_path / source), "-o", str(by_command), "-q", *words]) == 0
    ts.convert(tmp_path / source, by_python, **options)
    assert by_python.read_bytes() == by_command.read_bytes()
    if source == "g.tsplat" and "crop" not in options and not {"rotate", "translate"} & options.keys():
        assert main(["decode", str(tmp_path / source), "-o", str(by_command), "-q", "--force", *words]) == 0
        assert by_python.read_bytes() == by_command.read_bytes()


def test_joined_files_and_saved_gaussians_are_the_commands_too(capture, tmp_path):
    wall, file = capture
    assert main(["convert", file, file, "-o", str(tmp_path / "a.ply"), "-q", "--rotate", "z,30"]) == 0
    ts.convert([file, file], tmp_path / "b.ply", rotate="z,30")
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
    assert main(["convert", file, "-o", str(tmp_path / "c.ply"), "-q"]) == 0
    ts.save_gaussians(tmp_path / "d.ply", wall)
    assert (tmp_path / "c.ply").read_bytes() == (tmp_path / "d.ply").read_bytes()
    ts.save_gaussians(tmp_path / "e.tsplat", wall, views=[0, 2, 5], min_opacity=0.1, unit="metre", profile="fast")
    ts.convert(file, tmp_path / "chosen.npz", views=[0, 2, 5], min_opacity=0.1, unit="metre")
    chosen = ts.load_gaussians(tmp_path / "chosen.npz")
    assert (tmp_path / "e.tsplat").read_bytes() == ts.compress(chosen, "fast")
    ts.save_gaussians(tmp_path / "some.npz", wall, views=[0, 2, 5], min_opacity=0.1, unit="metre")
    assert (tmp_path / "some.npz").read_bytes() == (tmp_path / "chosen.npz").read_bytes()
    with pytest.raises(ts.InputError, match="sh_bits"):
        ts.save_gaussians(tmp_path / "f.tsplat", wall, sh_bits=(5, 4))
