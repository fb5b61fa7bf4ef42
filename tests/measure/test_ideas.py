"""Ablations are real files whose one change is the idea that is undone."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import make_smooth_gaussians

from tinysplat.measure import ideas
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.container.reader import read_container


@pytest.fixture(scope="module")
def runtime():
    return Runtime()


@pytest.fixture(scope="module")
def gaussians():
    return make_smooth_gaussians(2, 24, 32, degree=2, layers=2)


def test_a_change_that_changes_nothing_gives_the_profile_s_file(gaussians, runtime):
    same = ideas.encode_changed(gaussians, 2.0, runtime, lambda plan, part: plan)
    assert same == runtime.compress(gaussians, "balanced", 2.0)


@pytest.mark.parametrize("name", ideas.CHANGES)
def test_every_idea_undone_is_a_file_close_to_the_gaussians(name, gaussians, runtime):
    data = ideas.encode_changed(gaussians, -6.0, runtime, ideas.CHANGES[name])
    found = runtime.decompress(data)
    limit = 0.2 if "k" not in name else 1.0  # fewer components lose colours, and nothing else
    for a, b in zip(found.layers, gaussians.layers, strict=True):
        assert np.abs(a.means - b.means).max() < 0.1
        assert np.sqrt(np.square(a.sh - b.sh).mean()) < limit


def test_what_is_undone_is_not_in_the_file(gaussians, runtime):
    def header(name):
        return read_container(ideas.encode_changed(gaussians, 0.0, runtime, ideas.CHANGES[name])).body.layers[0]

    assert not header("depth as z").inverse_depth
    assert header("ŝ without PCA").scale_mix is None
    assert header("rotation as four components").reference_quats is None
    assert header("k ≤ 3").basis.shape[1] == 3
    assert header("VABR as the paper's").basis.shape[1] == ideas.PAPER_K
    assert not ideas.other_settings()[ideas.STEPS_NOT_MEASURED].settings.stripes
