"""What signs, weights and units inside the networks mean, on scenes made for one question each.

Parity tests compare a graph with the module that it was exported from: what both have wrong passes them.
"""

from __future__ import annotations

import numpy as np
import pytest
import torch
from networks.two_planes import FAR, NEAR, TracedScene, trace
from torch import Tensor

from tinysplat.networks.edge_analysis import photo_difference
from tinysplat.networks.pairs import ViewPairs
from tinysplat.networks.sweep import AlignmentSettings, InverseDepths, align_photos

COUNT = 26
"""Candidates."""


@pytest.fixture(scope="module")
def scene() -> TracedScene:
    return trace(2, 64, 96)


def _tensors(scene: TracedScene) -> tuple[Tensor, Tensor, Tensor]:
    """Photos (V, 3, H, W), K divided by the image's sides, c2w."""
    return (
        torch.from_numpy(np.ascontiguousarray(scene.images.transpose(0, 3, 1, 2), np.float32)),
        torch.from_numpy(np.float32([camera.K_unit for camera in scene.cameras])),
        torch.from_numpy(np.float32([camera.c2w for camera in scene.cameras])),
    )


def _range(views: int = 2, near: float = NEAR, far: float = FAR) -> InverseDepths:
    offset = torch.full((views,), 1 / far)
    return InverseDepths(offset, torch.full((views,), 1 / near) - offset, COUNT)


def _levels(scene: TracedScene, depths: InverseDepths) -> Tensor:
    """(V, 1, H, W) of the true depths."""
    inverse = 1 / torch.from_numpy(np.float32(scene.depth))[:, None]
    return (inverse - depths.offset.view(-1, 1, 1, 1)) / depths.span.view(-1, 1, 1, 1)


def test_the_photo_difference_is_what_the_source_shows_less_the_pixel_itself(scene: TracedScene) -> None:
    images, K, c2w = _tensors(scene)
    depths, pairs = _range(), ViewPairs.nearest(c2w)
    level = torch.full_like(_levels(scene, depths), 0.8)  # so near that the borders see past each other
    bright = torch.tensor([0.3, 0.4])[:, None, None, None].expand_as(images)
    found, seen = photo_difference(level, bright, K, pairs, depths)
    inside = (seen == 1).expand_as(found)
    assert 0.5 < float(seen.mean()) < 1 and set(seen.unique().tolist()) == {0.0, 1.0}
    torch.testing.assert_close(found[0][inside[0]], torch.full_like(found[0][inside[0]], 0.1))
    torch.testing.assert_close(found[1][inside[1]], torch.full_like(found[1][inside[1]], -0.1))
    assert not found[~inside].any()
    photos, _ = photo_difference(_levels(scene, depths), images, K, pairs, depths)
    assert float(photos.abs().median()) < 0.01


@pytest.mark.parametrize("brighter", [0.0, 0.12, -0.12])
def test_a_change_of_exposure_between_photos_does_not_move_depth(scene: TracedScene, brighter: float) -> None:
    """With `any_exposure`, a box may differ from its source by a constant colour; without, depth gives way to it."""
    images, K, c2w = _tensors(scene)
    images = images + torch.tensor([0.0, brighter])[:, None, None, None]
    depths, pairs = _range(), ViewPairs.nearest(c2w)
    truth = _levels(scene, depths)
    start = truth + 0.4 / (COUNT - 1)

    def error(**options: bool) -> float:
        settings = AlignmentSettings(steps=3, window=11, outlier=1.0, **options)
        found = align_photos(start, images, K, pairs, depths, settings)
        return float(((found - truth).abs() * (COUNT - 1)).median())

    assert error(any_exposure=True) < 0.1
    if brighter:
        assert error(any_exposure=False) > 0.2
