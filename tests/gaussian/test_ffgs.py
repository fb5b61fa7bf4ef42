"""Gaussians of the package ffgs, as itself makes and writes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tinysplat_runtime as ts
from tinysplat.ffgs_output import from_ffgs

torch = pytest.importorskip("torch")
pytest.importorskip("ffgs")


@pytest.mark.parametrize("degree", [None, 1])
def test_an_output_is_the_scene_that_its_own_file_holds(degree: int | None, tmp_path: Path) -> None:
    from ffgs.pipeline import GSOutput
    from ffgs.types import Cameras
    from ffgs.types import Gaussians as Theirs

    rng, count = torch.Generator().manual_seed(0), 50
    colours = (2, count, 3) if degree is None else (2, count, (degree + 1) ** 2, 3)
    opacities = 0.1 + 0.8 * torch.rand(2, count, generator=rng)
    opacities[1, -5:] = 0
    theirs = Theirs(
        torch.randn(2, count, 3, generator=rng),
        torch.rand(2, count, 3, generator=rng) + 0.01,
        torch.nn.functional.normalize(torch.randn(2, count, 4, generator=rng), dim=-1),
        opacities,
        torch.rand(*colours, generator=rng) - (0 if degree is None else 0.5),
        degree,
    )
    K = torch.tensor([[50.0, 0, 32], [0, 50, 24], [0, 0, 1]]).expand(2, 3, 3, 3)
    cameras = Cameras(torch.eye(4).expand(2, 3, 4, 4), K, (48, 64))
    found = from_ffgs(GSOutput(theirs, None, cameras=cameras), 1)
    written = ts.load_gaussians(theirs.save_ply(tmp_path / "theirs.ply", 1))
    assert found.count == written.count == count - 5
    for name in ("means", "scales", "opacities", "sh"):
        np.testing.assert_allclose(getattr(found, name), getattr(written, name), rtol=1e-4, atol=1e-5)
    assert [(c.width, c.height, round(float(c.K[0, 0]))) for c in found.viewpoints] == [(64, 48, 50)] * 3
    assert ts.decompress(ts.compress(found, keep_all=True)).count == found.count
