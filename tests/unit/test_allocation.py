"""Steps: the stand-in for the video codec, the probe of depth, and what they choose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_smooth_gaussians

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.adaptive import class_step, prepare_layer, scene_steps
from tinysplat_runtime.codec.analysis import project_layer
from tinysplat_runtime.codec.depth_step.allocation import FARTHEST, measured_depth_step
from tinysplat_runtime.codec.depth_step.blocks import BlockSpectrum
from tinysplat_runtime.codec.depth_step.probe import DepthProbe
from tinysplat_runtime.codec.profiles import ADAPTIVE
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.planes import PlaneClass
from tinysplat_runtime.graphs.inference import GraphStore
from tinysplat_runtime.render import DEFINITION, Renderer


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


def test_blocks_of_another_qp_err_by_their_own_step():
    planes = np.random.default_rng(0).standard_normal((2, 40, 56)).astype(np.float32)
    offsets = np.zeros((2, 3, 4), np.int8)
    offsets[1, 2, 3] = 6  # the last block, cut by both edges: twice the step
    spectrum = BlockSpectrum.of(planes)
    plain, coarser = spectrum.coding_error(0.01), spectrum.coding_error(0.02)
    found = spectrum.coding_error(0.01, offsets)
    np.testing.assert_array_equal(found[1, 32:, 48:], coarser[1, 32:, 48:])
    found[1, 32:, 48:] = plain[1, 32:, 48:]
    np.testing.assert_array_equal(found, plain)


def _probe(layers, stripes=2, threads=1):
    inverse = [layer.planes[PlaneClass.DEPTH][:, 0] for layer in layers]
    shown = [layer.shown for layer in layers]
    return DepthProbe([layer.layer for layer in layers], inverse, shown, stripes, threads), inverse


def test_no_error_is_no_damage_and_more_error_is_more(layers):
    probe, inverse = _probe(layers)
    rng = np.random.default_rng(0)
    noise = [rng.standard_normal(planes.shape).astype(np.float32) * 1e-3 for planes in inverse]
    found = [probe.damage([factor * errors for errors in noise]) for factor in (0, 1, 8)]
    assert found[0] < 1e-12 < found[1] < found[2]
    assert probe.damage([np.zeros_like(noise[0]), 8 * noise[1]]) > 1e-12  # layers behind the first count, too


def test_threads_do_not_change_what_is_measured(layers):
    errors = [0.01 * layer.planes[PlaneClass.DEPTH][:, 0] for layer in layers]
    one, two = (_probe(layers, stripes=3, threads=n)[0].damage(errors) for n in (1, 2))
    assert one == two


def test_stripes_are_parts_of_the_pictures_between_the_views(layers):
    renderer = Renderer(replace(layers[0].layer, extra_layers=(layers[1].layer,)), **DEFINITION)
    for shot in _probe(layers, stripes=3)[0]._shots:
        raw = renderer.render(shot._camera)
        assert np.abs(np.clip(raw, 0, 1) - shot._picture).mean() < 2e-3  # all but what its selection leaves out


def test_contrast_carries_what_a_stripe_shows_over_to_its_picture(store, monkeypatch):
    scene = make_smooth_gaussians(2, 96, 48, degree=0)
    texture = np.random.default_rng(1).standard_normal(scene.sh.shape)
    texture *= (np.arange(96) / 96)[:, None, None, None] ** 2  # the middle third shows less than the lower one
    solid = np.full_like(scene.opacities, 0.9)
    layers = _prepared(replace(scene, sh=0.8 * texture.astype(np.float32), opacities=solid), store)
    noise = np.random.default_rng(2).standard_normal(scene.opacities.shape).astype(np.float32)
    errors = [0.003 * noise * layers[0].planes[PlaneClass.DEPTH][:, 0]]
    stripe = _probe(layers, stripes=1)[0]
    alone, found = stripe._shots[0].damage(errors), stripe.damage(errors)
    monkeypatch.setattr("tinysplat_runtime.codec.depth_step.probe.STRIPE_ROWS", 96)
    truth = _probe(layers, stripes=1)[0].damage(errors)
    assert alone < 0.4 * truth
    assert 0.65 * truth < found < 1.5 * truth


class _Scripted:
    """A probe whose damage grows with the errors' size as stated."""

    def __init__(self, exponent: float) -> None:
        self.exponent, self.calls = exponent, 0

    def damage(self, errors) -> float:
        self.calls += 1
        return float(np.sqrt(np.mean(errors[0] ** 2)) ** self.exponent)


@pytest.mark.parametrize("exponent, rounds, calls", [(1.0, 3, 2), (1.5, 5, 3), (1.0, 1, 1)])
def test_depths_step_is_sought_until_it_rests_or_the_rounds_are_over(exponent, rounds, calls):
    planes, offsets = np.random.default_rng(0).standard_normal((1, 64, 64)).astype(np.float32), np.zeros((1, 4, 4))
    probe, start = _Scripted(exponent), 0.01
    target = float(BlockSpectrum.of(planes).coding_error(2 * start).std()) ** exponent
    step = measured_depth_step(probe, [planes], [offsets], start, target, rounds)
    assert probe.calls == calls
    if rounds > 1:
        assert step == pytest.approx(2 * start, rel=0.3)


def test_no_measurement_moves_depths_step_beyond_reach():
    planes, offsets = np.ones((1, 16, 16), np.float32), np.zeros((1, 1, 1))
    for target, factor in ((1e9, FARTHEST), (1e-30, 1 / FARTHEST)):
        assert measured_depth_step(_Scripted(1.0), [planes], [offsets], 0.01, target, 4) == pytest.approx(0.01 * factor)


def test_moved_depths_are_those_that_a_decoder_would_rebuild(layers):
    probe, inverse = _probe(layers)
    chosen, camera = probe._shots[0]._chosen[0], layers[0].layer.cameras[1]
    of_view = chosen.at[0] == 1
    moved = chosen.moved(0.05 * inverse[0])
    centre = camera.centre - layers[0].layer.origin
    before, after = (a["means"][of_view] - centre for a in (chosen.arrays, moved))
    z = np.clip(chosen.inverse[of_view] * np.float32(1.05), *chosen.limits)
    np.testing.assert_allclose(after @ camera.rotation.T[:, 2], -1 / z, rtol=1e-4)
    np.testing.assert_allclose(np.cross(before, after), 0, atol=1e-4)  # along the ray


def test_depth_is_coded_more_finely_where_gaussians_are_opaque(store):
    scene = make_smooth_gaussians(2, 40, 48, degree=0)
    solid, faint = (replace(scene, opacities=np.full_like(scene.opacities, o)) for o in (0.9, 0.05))
    steps = [scene_steps(_prepared(g, store), ADAPTIVE, 1)[0] for g in (solid, faint)]
    assert steps[0][PlaneClass.DEPTH] < steps[1][PlaneClass.DEPTH]


def test_a_lower_target_makes_depths_step_finer(layers):
    coarse, fine = (scene_steps(layers, replace(ADAPTIVE, depth_damage=d), 1)[0] for d in (1e-4, 1e-6))
    assert fine.pop(PlaneClass.DEPTH) < coarse.pop(PlaneClass.DEPTH)
    assert fine == coarse


def test_without_stripes_steps_are_the_stated_ones(layers):
    first, behind = scene_steps(layers, replace(ADAPTIVE, stripes=0), 1)
    mean = -float(layers[0].planes[PlaneClass.DEPTH].mean(dtype=np.float64))
    assert first[PlaneClass.DEPTH] == behind[PlaneClass.DEPTH] == pytest.approx(ADAPTIVE.depth_step * mean)
    for plane_class in (PlaneClass.COLOR, PlaneClass.OPACITY, PlaneClass.OFFSET):
        assert first[plane_class] == class_step(ADAPTIVE, plane_class)
        assert behind[plane_class] == ADAPTIVE.behind * first[plane_class]


def test_scales_and_turns_of_small_splats_are_coded_more_coarsely(store):
    scene = make_smooth_gaussians(2, 40, 48, degree=0)
    steps = [scene_steps(_prepared(replace(scene, scales=f * scene.scales), store), ADAPTIVE, 1)[0] for f in (1, 0.5)]
    for plane_class in (PlaneClass.SCALE, PlaneClass.ROTATION):
        assert steps[1][plane_class] > steps[0][plane_class]
    assert steps[1][PlaneClass.COLOR] == steps[0][PlaneClass.COLOR]


@pytest.mark.parametrize("views, size", [(1, (1, 1)), (1, (5, 90)), (3, (70, 9))])
def test_any_grid_can_be_measured(store, views, size):
    gaussians = make_smooth_gaussians(views, *size, degree=0)
    assert all(step > 0 for step in scene_steps(_prepared(gaussians, store), ADAPTIVE, 1)[0].values())


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


def test_bytes_do_not_depend_on_threads():
    gaussians = make_smooth_gaussians(2, 40, 48, degree=1, layers=2)
    one, two = (Runtime(threads=n).compress(gaussians) for n in (1, 2))
    assert one == two
