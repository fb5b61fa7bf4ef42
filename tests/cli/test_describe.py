"""What `info` prints, line by line."""

from __future__ import annotations

import json
from pathlib import Path

import console
import numpy as np
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.cli.describe import describe_gaussians, gaussians_text, info_text


def test_other_files_are_four_lines_and_their_extent_is_in_the_world(tmp_path: Path) -> None:
    g = make_smooth_gaussians(2, 16, 24, degree=1, layers=2, origin=(100, 0, 0)).with_notes(ts.Notes(unit="metre"))
    file = str(tmp_path / "g.npz")
    ts.save_gaussians(file, g)
    about = describe_gaussians(file)
    means = np.concatenate([layer.means.reshape(-1, 3) + layer.origin for layer in g.layers])
    scales = np.concatenate([layer.scales.ravel() for layer in g.layers])
    opacities = np.concatenate([layer.opacities.ravel() for layer in g.layers])
    np.testing.assert_allclose(about["box"], [means.min(axis=0), means.max(axis=0)], atol=1e-5)
    assert means.min() < -0.5 and means.max() > 90
    assert about["median_scale"] == pytest.approx(np.median(scales))
    assert about["median_opacity"] == pytest.approx(np.median(opacities))
    plain = {key: about[key] for key in ("file", "bytes", "gaussians", "sh_degree", "views", "layers", "notes")}
    assert plain == {
        "file": file,
        "bytes": Path(file).stat().st_size,
        "gaussians": g.count,
        "sh_degree": 1,
        "views": [[24, 16], [24, 16]],
        "layers": 2,
        "notes": {"unit": "metre"},
    }
    assert json.loads(console.succeed("info", file, "--json")) == about
    assert console.succeed("info", file) == gaussians_text(about) + "\n"


def test_info_of_a_file_is_its_description_in_text_or_json(tmp_path: Path) -> None:
    (tmp_path / "f.tsplat").write_bytes(ts.compress(make_smooth_gaussians(2, 16, 24)))
    about = ts.inspect((tmp_path / "f.tsplat").read_bytes())
    assert json.loads(console.succeed("info", tmp_path / "f.tsplat", "--json")) == json.loads(json.dumps(about))
    assert console.succeed("info", tmp_path / "f.tsplat") == info_text(str(tmp_path / "f.tsplat"), about) + "\n"
