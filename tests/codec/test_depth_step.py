"""Steps: the stand-in for the video codec, the probe of depth, and what they choose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_smooth_gaussians

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.adaptive import prepare_layer, scene_steps, take_geometry
from tinysplat_runtime.codec.analysis import project_layer
from tinysplat_runtime.codec.depth_step.probe import Probe
from tinysplat_runtime.codec.profiles import ADAPTIVE
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.planes import PlaneClass
from tinysplat_runtime.graphs.inference import GraphStore


def _prepared(gaussians: Gaussians, store: GraphStore):
    return [
        prepare_layer(store, g, take_geometry(project_layer(store, g, drop_invalid=False, where="")), ADAPTIVE, 0)
        for g in gaussians.layers
    ]


@pytest.fixture(scope="module")
def store():
    return GraphStore()


@pytest.fixture(scope="module")
def layers(store):
    return _prepared(make_smooth_gaussians(2, 40, 48, degree=1, layers=2), store)


def _probe(layers, stripes=2, threads=1):
    inverse = [layer.planes[PlaneClass.DEPTH][:, 0] for layer in layers]
    shown = [layer.shown for layer in layers]
    return Probe([layer.layer for layer in layers], inverse, shown, stripes, threads), inverse


def test_no_error_is_no_damage_and_more_error_is_more(layers):
    probe, inverse = _probe(layers)
    rng = np.random.default_rng(0)
    noise = [rng.standard_normal(planes.shape).astype(np.float32) * 1e-3 for planes in inverse]
    found = [probe.damage([factor * errors for errors in noise]) for factor in (0, 1, 8)]
    assert found[0] < 1e-12 < found[1] < found[2]
    assert probe.damage([np.zeros_like(noise[0]), 8 * noise[1]]) > 1e-12  # layers behind the first count, too


def test_depth_is_coded_more_finely_where_gaussians_are_opaque(store):
    scene = make_smooth_gaussians(2, 40, 48, degree=0)
    solid, faint = (replace(scene, opacities=np.full_like(scene.opacities, o)) for o in (0.9, 0.05))
    steps = [scene_steps(_prepared(g, store), ADAPTIVE, 1)[0] for g in (solid, faint)]
    assert steps[0][PlaneClass.DEPTH] < steps[1][PlaneClass.DEPTH]


def test_sh_bands_that_nobody_sees_are_left_out_and_listed():
    scene = make_smooth_gaussians(2, 24, 32, degree=2)
    weights = np.repeat([1, 8, 1e-5], [1, 3, 5]).astype(np.float32)  # the views disagree about band 1
    runtime = Runtime(threads=1)
    data = runtime.compress(replace(scene, sh=scene.sh * weights[:, None]))
    assert runtime.decompress(data).degree == 1
    described = inspect_bytes(data)
    entry = described["left_out"][0]
    assert (entry["what"], entry["kept"], entry["of"]) == ("sh degree", 1, 2)
    assert entry["bytes_saved"] == 2 * described["k"] * 3 * (9 - 4)
    assert runtime.decompress(runtime.compress(scene, qp=-6)).degree == 2
