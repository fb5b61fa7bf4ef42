"""Which format a name tells, what is said where a package is missing, point clouds, and the loss of a file."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import make_list, refusing

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians, save_points
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.sh import C0


@pytest.mark.parametrize("grid", [(1, 2), (1, 2, 3, 4), (0, 4, 6), (2, 4, -1)])
def test_grids_are_three_numbers_of_one_or_more(tmp_path: Path, grid: Any) -> None:
    save_gaussians(tmp_path / "g.npz", make_list(24, 0, np.random.default_rng(0)))
    assert load_gaussians(tmp_path / "g.npz", (1, 4, 6)).opacities.shape == (1, 4, 6)
    with refusing(InputError, f"grid: {grid} (V, H, W)"):
        load_gaussians(tmp_path / "g.npz", grid)


def test_point_clouds_are_means_and_colours(tmp_path: Path) -> None:
    import plyfile

    means = np.array([[0, 1, 2], [3, 4, 5]])
    sh = np.array([[[-9, 0, 9]], [[-0.25 / C0, 0.25 / C0, 0]]])
    g = Gaussians(means, np.tile([1.0, 0, 0, 0], (2, 1)), np.ones((2, 3)), np.ones(2), sh)
    save_points(tmp_path / "p.PLY", g)
    vertex = plyfile.PlyData.read(str(tmp_path / "p.PLY"))["vertex"].data
    assert [vertex[axis].tolist() for axis in "xyz"] == means.T.tolist() and vertex["x"].dtype == np.float32
    colours = np.stack([vertex[name] for name in ("red", "green", "blue")], axis=1)
    assert colours.tolist() == [[0, 128, 255], [64, 191, 128]] and colours.dtype == np.uint8
    far = Gaussians(means, g.quats, g.scales, g.opacities, sh, origin=np.array([4e6 + 0.1, 0, 0]))
    save_points(tmp_path / "p.PLY", far)
    vertex = plyfile.PlyData.read(str(tmp_path / "p.PLY"))["vertex"].data
    assert vertex["x"].dtype == np.float64 and vertex["x"].tolist() == [4e6 + 0.1, 4e6 + 0.1 + 3]
    with refusing(InputError, "p.txt: '.txt', .ply"):
        save_points(tmp_path / "p.txt", g)


@pytest.mark.parametrize("ending", [".npz", ".safetensors", ".ply", ".spz", ".glb", ".sog"])
def test_a_file_under_another_formats_ending_is_told_its_own(tmp_path: Path, ending: str) -> None:
    save_gaussians(tmp_path / f"a{ending}", make_list(5, 0, np.random.default_rng(0)))
    other = (tmp_path / f"a{ending}").rename(tmp_path / ("a.ply" if ending == ".spz" else "a.spz"))
    with pytest.raises(InputError, match=rf"{other.name}: .*\{ending} "):
        load_gaussians(other)
