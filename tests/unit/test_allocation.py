"""Steps of equal slope: the stand-in for the video codec, the probe, and what they choose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_smooth_gaussians

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.adaptive import class_step, prepare_layer, scene_steps
from tinysplat_runtime.codec.analysis import project_layer
from tinysplat_runtime.codec.blocks import BlockSpectrum
from tinysplat_runtime.codec.hevc import EncoderSettings, encode_plane
from tinysplat_runtime.codec.planes import PlaneClass
from tinysplat_runtime.codec.probe import Probe
from tinysplat_runtime.codec.profiles import ADAPTIVE
from tinysplat_runtime.codec.quantize import choose_code_map
from tinysplat_runtime.gaussians import Gaussians
from tinysplat_runtime.inference import GraphStore
from tinysplat_runtime.inspection import inspect_bytes
from tinysplat_runtime.render import Renderer


def _prepared(gaussians: Gaussians, store: GraphStore):
    return [
        prepare_layer(store, g, project_layer(store, g, drop_invalid=False, where=""), ADAPTIVE, 0)
        for g in gaussians.layers
    ]


@pytest.fixture(scope="module")
def store():
    return GraphStore()


@pytest.fixture(scope="module")
def layers(store):
    return _prepared(make_smooth_gaussians(2, 40, 48, degree=1, layers=2), store)


def _planes(seed=0, size=(3, 37, 50)):
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[: size[1], : size[2]]
    return (np.sin(u / 5) + 0.05 * rng.standard_normal(size)).astype(np.float32) + 0 * v.astype(np.float32)


def test_fine_steps_err_like_a_uniform_quantiser_and_coarse_ones_lose_no_more_than_the_signal():
    planes = _planes()
    spectrum = BlockSpectrum.of(planes)
    fine = spectrum.coding_error(1e-3)
    assert fine.shape == planes.shape
    assert 1e-3 / np.sqrt(12) < fine.std() < 1.25e-3 / np.sqrt(12)  # a dead zone rounds downwards more often
    coarse = spectrum.coding_error(1e6)
    np.testing.assert_allclose(coarse, -planes, atol=1e-5)


def test_smooth_planes_lose_less_than_noisy_ones_at_the_same_step():
    smooth = BlockSpectrum.of(_planes() * 0 + np.linspace(0, 1, 50, dtype=np.float32))
    noisy = BlockSpectrum.of(np.random.default_rng(0).standard_normal((3, 37, 50)).astype(np.float32))
    assert smooth.coding_error(0.5).std() < 0.3 * noisy.coding_error(0.5).std()


def test_guessed_bits_rank_planes_and_steps_as_libx265_does():
    guesses, sizes = [], []
    rng = np.random.default_rng(1)
    for noise in (0.02, 0.1, 0.5):
        plane = _planes(size=(1, 64, 64)) + noise * rng.standard_normal((1, 64, 64)).astype(np.float32)
        for step in (0.05, 0.2, 0.8):
            code_map = choose_code_map(float(plane.min()), float(plane.max()), float(plane.mean()), step)
            codes, _ = code_map.quantise(plane)
            sizes.append(8 * len(encode_plane(codes[0], code_map.qp, EncoderSettings("superfast")).payload))
            guesses.append(float(BlockSpectrum.of(plane).bits(np.array([step]))[0]))
    ratios = np.array(guesses) / sizes
    assert np.corrcoef(np.log(guesses), np.log(sizes))[0, 1] > 0.95
    assert ratios.max() / ratios.min() < 4


def test_no_error_is_no_damage_and_more_error_is_more(layers):
    sets = [layer.planes for layer in layers]
    probe = Probe(sets, sets[0].layer.cameras, windows=2)
    rng = np.random.default_rng(0)
    for index, planes in enumerate(sets):
        for plane_class, values in planes.values.items():
            noise = rng.standard_normal(values.shape).astype(np.float32) * 1e-2
            found = [probe.damage(index, {plane_class: noise * factor}) for factor in (0, 1, 8)]
            assert found[0] == 0 < found[1] < found[2], (index, plane_class)


def test_planes_without_error_rebuild_the_gaussians_they_were_made_of(layers):
    sets = [layer.planes for layer in layers]
    probe = Probe(sets, sets[0].layer.cameras, windows=3)
    renderer = Renderer(replace(sets[0].layer, extra_layers=(sets[1].layer,)))
    for shot in probe._shots:
        raw = renderer.render(shot._window)
        assert np.abs(np.clip(raw, 0, 1) - shot._picture).mean() < 2e-3  # all but what its selection leaves out


def test_steps_are_finer_where_gaussians_are_opaque_than_where_they_hardly_show(store):
    scene = make_smooth_gaussians(2, 40, 48, degree=0)
    solid, faint = (replace(scene, opacities=np.full_like(scene.opacities, o)) for o in (0.9, 0.05))
    steps = [scene_steps(_prepared(g, store), replace(ADAPTIVE, target=1e-5))[0] for g in (solid, faint)]
    assert steps[0][PlaneClass.COLOR] < steps[1][PlaneClass.COLOR]


def test_a_lower_target_makes_every_step_finer_or_equal(layers):
    coarse, fine = (scene_steps(layers, replace(ADAPTIVE, target=target)) for target in (1e-4, 1e-6))
    for a, b in zip(coarse, fine, strict=True):
        assert all(b[c] <= a[c] for c in a) and any(b[c] < a[c] for c in a)


def test_without_windows_steps_are_the_stated_ones(layers):
    steps = scene_steps(layers, replace(ADAPTIVE, windows=0))[0]
    for plane_class in ADAPTIVE.sensitivity:
        assert steps[plane_class] == class_step(ADAPTIVE, plane_class)


@pytest.mark.parametrize("views, size", [(1, (1, 1)), (1, (5, 90)), (3, (70, 9))])
def test_any_grid_can_be_measured(store, views, size):
    gaussians = make_smooth_gaussians(views, *size, degree=0)
    assert all(step > 0 for step in scene_steps(_prepared(gaussians, store), ADAPTIVE)[0].values())


def test_sh_bands_that_nobody_sees_are_left_out_and_listed():
    scene = make_smooth_gaussians(2, 24, 32, degree=2)
    weights = np.repeat([1, 1, 1e-5], [1, 3, 5]).astype(np.float32)
    runtime = Runtime(threads=1)
    data = runtime.compress(replace(scene, sh=scene.sh * weights[:, None]))
    assert runtime.decompress(data).degree == 1
    described = inspect_bytes(data)
    entry = described["left_out"][0]
    assert (entry["what"], entry["kept"], entry["of"]) == ("sh degree", 1, 2)
    assert entry["bytes_saved"] == 2 * described["k"] * 3 * (9 - 4)
    assert runtime.decompress(runtime.compress(scene, qp=-6)).degree == 2


def test_bytes_do_not_depend_on_threads():
    gaussians = make_smooth_gaussians(2, 40, 48, degree=1, layers=2)
    one, two = (Runtime(threads=n).compress(gaussians) for n in (1, 2))
    assert one == two
