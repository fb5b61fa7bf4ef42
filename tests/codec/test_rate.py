"""Rate control: targets are hit, or told to be out of reach, and the search depends on the scene alone."""

import numpy as np
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.render import Renderer

RUNTIME = ts.Runtime(threads=2)


@pytest.fixture(scope="module")
def gaussians():
    return make_smooth_gaussians(2, 48, 64, degree=1, layers=2)


def _psnr(a, b) -> float:
    pictures = (Renderer(scene, threads=1, compiled=False) for scene in (a, b))  # as they are drawn by default
    mine, theirs = ([renderer.render(camera).clip(0, 1) for camera in a.cameras] for renderer in pictures)
    return float(np.mean([-10 * np.log10(np.mean((x - y) ** 2)) for x, y in zip(mine, theirs, strict=True)]))


@pytest.mark.parametrize(("profile", "share"), [*((name, 0.35) for name in PROFILES), ("balanced", 1.6)])
def test_a_target_size_is_hit_within_3_percent_from_below(gaussians, profile, share):
    target = int(share * len(RUNTIME.compress(gaussians, profile)))
    data = RUNTIME.compress(gaussians, profile, target_size=target)
    assert 0.97 * target <= len(data) <= target
    assert ts.decompress(data).count == gaussians.count


@pytest.mark.parametrize(("profile", "target"), [("paper", 34.0), ("balanced", 39.0)])
def test_a_target_psnr_is_reached_and_passed_by_at_most_a_fifth_of_a_decibel(gaussians, profile, target):
    data = RUNTIME.compress(gaussians, profile, target_psnr=target)
    assert target <= _psnr(gaussians, ts.decompress(data)) + 1e-3 <= target + 0.2 + 2e-3
