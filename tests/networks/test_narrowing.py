"""The range that is worth sweeping: it holds the scene, leaves out the rest, and gives up when nothing can be told."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from networks.two_planes import FAR, NEAR, network_tensors, trace
from torch import Tensor

from tinysplat.networks.narrowing import NarrowingSettings, narrowed
from tinysplat.networks.pairs import ViewPairs
from tinysplat.networks.sweep import InverseDepths, SweepSettings


def look(
    near: float, far: float, *, views: int = 2, still: bool = False, flat: bool = False
) -> tuple[InverseDepths, InverseDepths, Tensor]:
    """The whole range, the narrowed one, and the inverse depths of the scene, of two textured planes."""
    scene = trace(views, 128, 192)
    images, K, c2w, nearest, farthest = network_tensors(scene, near, far)
    if still:
        c2w = c2w[:1].expand_as(c2w).clone()
    if flat:
        images = torch.full_like(images, 0.5)
    whole = InverseDepths(1 / farthest, 1 / nearest - 1 / farthest, 26)
    settings = NarrowingSettings(finest=0.2)  # so that how finely photos can be told apart does not decide
    found = narrowed(images, K, ViewPairs.nearest(c2w), whole, settings, SweepSettings())
    return whole, found, 1 / torch.from_numpy(np.float32(scene.depth))


@pytest.mark.parametrize("views", [2, 3])
@pytest.mark.parametrize(("near", "far"), [(NEAR / 4, FAR), (NEAR, FAR * 20), (NEAR / 4, FAR * 20)])
def test_a_range_that_is_too_wide_is_narrowed_to_the_scene(views: int, near: float, far: float) -> None:
    whole, found, truth = look(near, far, views=views)
    first, last = truth.flatten(1).quantile(torch.tensor([0.03, 0.97]), dim=1)  # (V,) each
    slack = 0.1 * (last - first)
    assert (found.offset <= first + slack).all() and (found.offset + found.span >= last - slack).all()
    beyond = (whole.span - (last - first)).clamp_min(0)
    assert (found.span < last - first + 0.3 * beyond).all()
    assert found.count == whole.count


def test_what_is_narrowed_lies_within_the_whole() -> None:
    for near, far in ((NEAR, FAR), (NEAR * 2, FAR), (NEAR, FAR / 2), (1e-3, 1e6)):
        whole, found, _ = look(near, far)
        slack = 1e-5 * whole.span
        assert (found.offset >= whole.offset - slack).all()
        assert (found.offset + found.span <= whole.offset + whole.span + slack).all()
        assert (found.span > 0).all()


def test_without_a_baseline_the_whole_range_stays() -> None:
    whole, found, _ = look(NEAR, FAR, still=True)
    torch.testing.assert_close(found.span, whole.span)
    torch.testing.assert_close(found.offset, whole.offset)


def test_blank_pictures_give_a_finite_range() -> None:
    whole, found, _ = look(NEAR, FAR, flat=True)
    assert torch.isfinite(found.offset).all() and (found.span > 0).all() and (found.span <= whole.span * 1.001).all()
