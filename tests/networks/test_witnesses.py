"""What Gaussians keep of their opacity beside other views: exact depth of a traced scene, and what is wrong in it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from networks.two_planes import FAR, NEAR, TracedScene, trace
from torch import Tensor

from tinysplat.networks.pairs import ViewPairs
from tinysplat.networks.sweep import InverseDepths
from tinysplat.networks.witnesses import WitnessSettings, kept_opacity

PATCH = (slice(None), slice(20, 44), slice(30, 60))  # seen by all views of the row


def exact(views: int) -> tuple[TracedScene, Tensor, InverseDepths]:
    """The scene, its depth as levels (V, 1, H, W), and the range."""
    scene = trace(views, 64, 96)
    near, far = torch.full((views,), NEAR), torch.full((views,), FAR)
    depths = InverseDepths(1 / far, 1 / near - 1 / far, 26)
    inverse = torch.from_numpy(np.float32(1 / scene.depth))[:, None]
    return scene, (inverse - depths.offset[0]) / depths.span[0], depths


def kept(scene: TracedScene, level: Tensor, depths: InverseDepths, trust: float = 0.9) -> Tensor:
    K, c2w = (torch.from_numpy(np.float32([getattr(c, n) for c in scene.cameras])) for n in ("K_unit", "c2w"))
    return kept_opacity(level, torch.full_like(level, trust), K, c2w, ViewPairs.all(c2w), depths, WitnessSettings())


def test_two_views_keep_all_whatever_they_say() -> None:
    scene, level, depths = exact(2)
    level[0][PATCH] += 0.3
    assert torch.equal(kept(scene, level, depths), torch.ones_like(level))


@pytest.mark.parametrize(("views", "most"), [(3, 0.8), (6, 0.38)])
def test_what_one_view_puts_before_the_surface_of_all_others_goes(views: int, most: float) -> None:
    scene, level, depths = exact(views)
    before = kept(scene, level, depths)
    middle = views // 2
    level[middle][PATCH] += 0.3
    after = kept(scene, level, depths)
    assert float(before[middle][PATCH].median()) > 0.9
    assert float(after[middle][PATCH].median()) < most
    others = [v for v in range(views) if v != middle]
    assert float((after[others] - before[others]).min()) > -0.08  # who tells the truth does not pay for it


def test_of_six_views_of_one_place_three_or_four_remain_and_they_are_the_middle_ones() -> None:
    scene, level, depths = exact(6)
    found = kept(scene, level, depths)[(slice(None), 0, slice(24, 40), slice(40, 56))].mean(dim=(1, 2))
    assert 2.6 < float(found.sum()) < 4.0
    assert float(found[2:4].min()) > 0.9 and float(found[[0, 5]].max()) < 0.1


def test_without_trust_in_the_witnesses_all_is_kept() -> None:
    scene, level, depths = exact(4)
    level[1][PATCH] += 0.3
    assert float(kept(scene, level, depths, trust=0.0).min()) == 1.0
