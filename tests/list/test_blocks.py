"""Large lists, which are looked at block by block; and pruning that is to end in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from list.looks import psnr
from scenes import make_list

import tinysplat_runtime as ts
from tinysplat_runtime.codec.job import EncodeStats, Job
from tinysplat_runtime.codec.profiles import find_profile
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.list.blocks import blocks_of
from tinysplat_runtime.list.views import views_about, views_of

pytest.importorskip("numba")

from tinysplat_runtime.graphs.inference import GraphStore
from tinysplat_runtime.list.coding.rounding import Rounding
from tinysplat_runtime.list.pruning.encoder import PruningEncoder

COUNT = 1600


@pytest.fixture(scope="module")
def balls() -> Gaussians:
    """Two balls beside each other: shells of large opaque Gaussians, and as many small ones that nobody sees within."""
    rng = np.random.default_rng(0)
    some = make_list(COUNT, 0, rng)
    towards = rng.normal(size=(COUNT, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    number = np.arange(COUNT)[:, None]
    means = np.where(number % 2 == 1, 0.5, 1) * towards + np.where(number % 4 < 2, 0, 3) * [1, 0, 0]
    scales = np.where(number % 2 == 1, 0.02, 0.14) * np.ones(3)
    balls = replace(some, means=means, scales=scales, opacities=np.full(COUNT, 0.95), sh=0.2 * some.sh)
    cameras = [camera.resized(64, 64) for camera in views_about(balls, 12)]
    return replace(balls, viewpoints=tuple(cameras))


@pytest.mark.parametrize("most", [1, 7, 100, 1000])
def test_every_gaussian_is_in_one_block_and_blocks_are_about_as_large(most):
    found = blocks_of(np.random.default_rng(0).normal(size=(500, 3)), most)
    assert sorted(np.concatenate(found).tolist()) == list(range(500))
    sizes = [len(rows) for rows in found]
    assert max(sizes) <= min(most, 2 * min(sizes))


def test_a_list_in_blocks_loses_what_nobody_sees_and_looks_like_one_in_a_piece(balls):
    decoded, views = {}, views_of(balls)
    for together in (COUNT, COUNT // 3):
        job = Job(balls, find_profile("balanced"), 0.0, GraphStore(), 1, EncodeStats())
        coder = PruningEncoder(job, views, Rounding.of(balls, views, 1), together=together)
        decoded[together] = ts.decompress(coder.code(0.0))
    (whole, in_blocks), cameras = decoded.values(), list(balls.viewpoints)
    assert in_blocks.count < 0.6 * COUNT
    assert psnr(in_blocks, balls, cameras) > psnr(whole, balls, cameras) - 1


def test_what_there_was_no_time_to_look_at_is_kept_and_said(balls):
    with pytest.warns(ts.InputWarning, match="time"):
        data = ts.compress(balls, seconds=1e-9)
    assert ts.decompress(data).count == COUNT
