"""Gaussians of the package ffgs, as itself makes and writes them, and of what it documents where it is missing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tinysplat_runtime as ts
from tinysplat.ffgs_output import from_ffgs

torch = pytest.importorskip("torch")


@dataclass
class _Batch:
    """The fields of an output, its Gaussians and its cameras that a list is made of, by the package's names."""

    means: Any
    quats: Any
    scales: Any
    opacities: Any
    colours: Any
    c2w: Any
    pixel_k: Any
    image_shape: tuple[int, int] = (48, 64)
    frame: None = None

    @property
    def gaussians(self) -> _Batch:
        return self

    cameras = gaussians

    def sh(self) -> Any:
        return self.colours


def test_an_output_becomes_the_list_of_one_scene_without_the_padding() -> None:
    rng, count = torch.Generator().manual_seed(0), 20
    opacities = 0.1 + 0.8 * torch.rand(2, count, generator=rng)
    opacities[1, -5:] = 0
    K = torch.tensor([[50.0, 0, 32], [0, 50, 24], [0, 0, 1]]).expand(2, 3, 3, 3)
    shapes = [(2, count, 3), (2, count, 4), (2, count, 3)]
    means, quats, scales = (torch.rand(*shape, generator=rng) + 0.1 for shape in shapes)
    colours = torch.rand(2, count, 4, 3, generator=rng) - 0.5
    output = _Batch(means, quats, scales, opacities, colours, torch.eye(4).expand(2, 3, 4, 4), K)
    found = from_ffgs(output, 1)
    assert found.count == count - 5
    for name, tensor in (("means", means), ("opacities", opacities), ("scales", scales), ("sh", colours)):
        np.testing.assert_allclose(getattr(found, name), tensor[1, :-5].numpy(), atol=1e-6)
    assert [(c.width, c.height, float(c.K[0, 0])) for c in found.viewpoints] == [(64, 48, 50.0)] * 3
    with pytest.raises(ts.InputError, match="opacities"):
        opacities[0] = 0
        from_ffgs(output, 0)


@pytest.mark.parametrize("degree", [None, 1])
def test_an_output_is_the_scene_that_its_own_file_holds(degree: int | None, tmp_path: Path) -> None:
    pytest.importorskip("ffgs")
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
