"""What a file of many Gaussians begins with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from list.looks import psnr
from scenes import make_list

import tinysplat_runtime as ts
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render.paths import ring

pytest.importorskip("numba")


def sizes_in(whole: Gaussians, part: Gaussians) -> np.ndarray:
    """(n, 3) scales that Gaussians of a part have in the whole."""
    return whole.scales[[np.square(whole.means - mean).sum(axis=1).argmin() for mean in part.means]]


def test_parts_of_a_file_show_what_pictures_need_most_and_grown_for_what_is_absent() -> None:
    """Of a ball of 1,000 large Gaussians, speckled by many small ones on it."""
    some = make_list(20_000, 0, np.random.default_rng(0))
    means = some.means / np.linalg.norm(some.means, axis=1, keepdims=True)
    is_large = np.arange(20_000)[:, None] < 1000
    scales = np.where(is_large, np.float32(0.08), 0.4 * some.scales)
    ball = replace(some, means=means * np.where(is_large, 0.95, 1), scales=scales, opacities=np.full(20_000, 0.9))
    cameras = [camera.resized(128, 128) for camera in ring(ball, 8)]
    data = ts.compress(ball, cameras=cameras, qp=-30)
    whole, few, quarter = (ts.decompress(data, max_bytes=len(data) // share) for share in (1, 8, 4))
    assert few.count < quarter.count < whole.count
    for part in (few, quarter):
        assert np.median(sizes_in(whole, part).max(axis=1)) > 1.5 * np.median(whole.scales.max(axis=1))
    assert psnr(replace(few, scales=sizes_in(whole, few)), whole, cameras) < psnr(few, whole, cameras)
    assert psnr(few, whole, cameras) < psnr(quarter, whole, cameras)
