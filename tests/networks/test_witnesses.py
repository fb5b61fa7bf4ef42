"""What Gaussians keep of their opacity beside other views: exact depth of a traced scene, and what is wrong in it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from networks.two_planes import TracedScene, network_tensors, trace
from torch import Tensor

from tinysplat.networks.pairs import ViewPairs
from tinysplat.networks.sweep import Comparison, InverseDepths
from tinysplat.networks.witnesses import WitnessSettings, kept_opacity

PATCH = (slice(None), slice(20, 44), slice(30, 60))  # seen by all views of the row


def exact(views: int) -> tuple[TracedScene, Tensor, InverseDepths]:
    """The scene, its depth as levels (V, 1, H, W), and the range."""
    scene = trace(views, 64, 96)
    *_, near, far = network_tensors(scene)
    depths = InverseDepths(1 / far, 1 / near - 1 / far, 26)
    inverse = torch.from_numpy(np.float32(1 / scene.depth))[:, None]
    return scene, (inverse - depths.offset[0]) / depths.span[0], depths


def kept(scene: TracedScene, level: Tensor, depths: InverseDepths, trust: float = 0.9) -> Tensor:
    _, K, c2w, _, _ = network_tensors(scene)
    views = Comparison.on(level, K, ViewPairs.all(c2w), depths)
    return kept_opacity(level, torch.full_like(level, trust), c2w, views, WitnessSettings())


def test_two_views_keep_all_whatever_they_say() -> None:
    scene, level, depths = exact(2)
    level[0][PATCH] += 0.3
    assert torch.equal(kept(scene, level, depths), torch.ones_like(level))


@pytest.mark.parametrize("views", [3, 6])
def test_what_one_view_puts_before_the_surface_of_all_others_goes(views: int) -> None:
    scene, level, depths = exact(views)
    before = kept(scene, level, depths)
    middle = views // 2
    level[middle][PATCH] += 0.3
    after = kept(scene, level, depths)
    assert float(before[middle][PATCH].median()) > 0.9
    lost = before - after
    assert float(lost[middle][PATCH].median()) > 0.15 * (views - 2)
    others = [v for v in range(views) if v != middle]
    assert float(lost[others].max()) < 0.1  # who tells the truth does not pay for it


def test_of_many_views_of_one_place_the_middle_ones_remain() -> None:
    scene, level, depths = exact(6)
    found = kept(scene, level, depths)[(slice(None), 0, slice(24, 40), slice(40, 56))].mean(dim=(1, 2))
    assert float(found[2:4].min()) > 0.9 and float(found[[0, 5]].max()) < 0.5


def test_without_trust_in_the_witnesses_all_is_kept() -> None:
    scene, level, depths = exact(4)
    level[1][PATCH] += 0.3
    assert float(kept(scene, level, depths, trust=0.0).min()) == 1.0
