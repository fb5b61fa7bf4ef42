"""Views synthesised whole and in halves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import assert_same, make_smooth_gaussians

import tinysplat_runtime as ts


@pytest.mark.parametrize("row", [140, 1 / 3])
def test_views_made_at_once_and_in_halves_have_the_same_bits(row) -> None:
    """Of more pixels than are made at a time; one thread makes geometry and colours at once, several apart."""
    scene = make_smooth_gaussians(2, 280, 256, 2)
    cameras = [
        replace(camera, K=camera.K + np.array([[0, 0, 0], [0, 0, row - 140], [0, 0, 0]])) for camera in scene.cameras
    ]
    data = ts.compress(replace(scene, cameras=tuple(cameras)), "fast")
    whole, halves = (ts.Runtime(threads=threads).decompress(data) for threads in (1, 3))
    assert_same(halves, whole)
