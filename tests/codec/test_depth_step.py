"""Steps: the stand-in for the video codec, the probe of depth, and what they choose."""

from __future__ import annotations

from dataclasses import replace
from threading import Event

import numpy as np
import pytest
from scenes import make_cameras, make_smooth_gaussians

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.adaptive import (
    class_step,
    kept_components,
    known_steps,
    prepare_layer,
    scene_steps,
    take_geometry,
)
from tinysplat_runtime.codec.analysis import project_layer
from tinysplat_runtime.codec.basis import view_directions
from tinysplat_runtime.codec.depth_step.allocation import (
    FARTHEST,
    OPACITY_EXPONENT,
    measured_depth_step,
    measured_opacity_step,
)
from tinysplat_runtime.codec.depth_step.blocks import BlockSpectrum
from tinysplat_runtime.codec.depth_step.probe import Probe, _select, _Stripe, _stripes
from tinysplat_runtime.codec.encoder import SceneEncoder
from tinysplat_runtime.codec.hevc import encode_plane
from tinysplat_runtime.codec.profiles import ADAPTIVE, PROFILES
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.planes import PlaneClass
from tinysplat_runtime.gaussian.sh import sh_basis
from tinysplat_runtime.graphs.inference import GraphStore
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.scene.cameras import Camera


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


def test_chosen_blocks_err_as_among_all_and_the_rest_not_at_all():
    planes = _planes(size=(2, 20, 27))
    offsets = np.random.default_rng(1).integers(-4, 5, (2, 2, 2)).astype(np.int8)
    chosen = np.random.default_rng(0).random((2, 3, 4)) < 0.5
    chosen[1, 2, 3] = True  # cut by both edges
    everywhere = BlockSpectrum.of(planes).coding_error(0.05, offsets)
    where = chosen.repeat(8, axis=1).repeat(8, axis=2)[:, :20, :27]
    found = BlockSpectrum.of(planes, chosen).coding_error(0.05, offsets)
    np.testing.assert_allclose(found, np.where(where, everywhere, 0), atol=1e-7)


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


def test_errors_count_nowhere_but_in_the_blocks_that_reach_a_stripe(layers):
    probe, inverse = _probe(layers, stripes=1)
    outside = []
    for planes, blocks in zip(inverse, probe.reached, strict=True):
        inside = blocks.repeat(8, axis=1).repeat(8, axis=2)[:, : planes.shape[1], : planes.shape[2]]
        outside.append(0.1 * planes * ~inside)
    assert outside[0].any() and all(blocks.any() for blocks in probe.reached)
    assert probe.damage(outside) < 1e-12


def test_threads_do_not_change_what_is_measured(layers):
    errors = [0.01 * layer.planes[PlaneClass.DEPTH][:, 0] for layer in layers]
    one, two = (_probe(layers, stripes=3, threads=n)[0].damage(errors) for n in (1, 2))
    assert one == two


def test_stripes_are_parts_of_the_pictures_between_the_views(layers):
    renderer = Renderer(replace(layers[0].layer, extra_layers=(layers[1].layer,)), **DEFINITION)
    for shot in _probe(layers, stripes=3)[0]._shots:
        raw = renderer.render(shot._camera)
        assert np.abs(np.clip(raw, 0, 1) - shot._picture).mean() < 2e-3  # all but what its selection leaves out


def _row_of_dots(pixels, *, depth=2.0, scale=0.01, opacity=0.9) -> Gaussians:
    """A view's Gaussians at such (u, v) of a camera of 40 × 30 pixels at the origin, f = 50, one beside the other."""
    u, v = np.array(pixels, float).T
    means = np.stack([(u - 20) / 50 * depth, (v - 15) / 50 * depth, np.full(len(u), depth)], axis=-1)
    grid = (1, 1, len(u))
    camera = Camera([[50, 0, 20], [0, 50, 15], [0, 0, 1]], np.eye(4), len(u), 1)
    return Gaussians(
        means.reshape(*grid, 3), np.tile([1.0, 0, 0, 0], (*grid, 1)), np.full((*grid, 3), scale),
        np.full(grid, opacity), np.zeros((*grid, 1, 3)), cameras=(camera,),
    )  # fmt: skip


def test_a_stripe_takes_what_reaches_it_and_weighs_what_lies_in_it_by_hand():
    """Rows 8 to 20 of a picture of 40 × 30: splats of σ = 0.25 px reach 3 · 0.25 and 3 px more."""
    stripe = _Stripe(Camera([[50, 0, 20], [0, 50, 7], [0, 0, 1]], np.eye(4), 40, 12), 8, 30, [0])
    reach = 3 * 0.01 * 50 / 2 + 3
    inside = [(20, 14), (0.01, 8.01), (39.9, 19.9)]
    picture = [(20, 0.1), (20, 29.9), (20, 7.9), (20, 20.1)]
    outside = [(20, -0.1), (20, 30.1), (-0.1, 14), (40.1, 14)]
    edges = [(20, 8 - reach + 0.05), (20, 20 + reach - 0.05), (-reach + 0.05, 14), (40 + reach - 0.05, 14)]
    beyond = [(20, 8 - reach - 0.05), (20, 20 + reach + 0.05), (-reach - 0.05, 14), (40 + reach + 0.05, 14)]
    dots = _row_of_dots([*inside, *picture, *outside, *edges, *beyond])
    shown = 2.0 ** np.arange(len(dots.opacities.ravel())).reshape(dots.opacities.shape)
    found = _select(dots, -1 / dots.means[..., 2], shown, stripe)
    assert set(found.at[2].tolist()) == {0, 1, 2, 5, 6, 9, 10, 11, 12, 13, 14}
    in_picture = [0, 1, 2, 3, 4, 5, 6, 11, 12, 15, 16]
    assert found.shown[0] == pytest.approx(sum(2.0**n for n in (0, 1, 2)) / (40 * 12))
    assert found.shown[1] == pytest.approx(sum(2.0**n for n in in_picture) / (40 * 30))
    np.testing.assert_allclose(found.inverse, -0.5, rtol=1e-6)
    behind, faint = _row_of_dots(inside, depth=-2.0), _row_of_dots(inside, opacity=0.9 / 255)
    for unseen, weight in ((behind, 0), (faint, 3)):
        found = _select(unseen, -1 / unseen.means[..., 2], np.ones(unseen.opacities.shape), stripe)
        assert not found.at[2].size and found.shown[0] == pytest.approx(weight / (40 * 12))


def test_stripes_are_spread_over_the_middles_and_over_the_rows():
    """Five of four cameras' three middles: the 1st, 1st, 2nd, 3rd, 3rd; rows by the golden ratio from the middle on."""
    cameras = make_smooth_gaussians(4, 100, 20).cameras
    stripes = _stripes(cameras, 5, 2.0)
    for n, (stripe, middle) in enumerate(zip(stripes, (0, 0, 1, 2, 2), strict=True)):
        halfway = (cameras[middle].centre + cameras[middle + 1].centre) / 2
        np.testing.assert_allclose(stripe.camera.centre, halfway, atol=1e-12)
        assert stripe.first == int((0.5 + 0.6180339887498949 * n) % 1 * 68)
        assert (stripe.height, stripe.camera.height, stripe.camera.width) == (100, 32, 20)
        assert list(stripe.views) == [0, 1, 2, 3]
        K = (cameras[middle].K + cameras[middle + 1].K) / 2
        np.testing.assert_allclose(stripe.camera.K, K - [[0, 0, 0], [0, 0, stripe.first], [0, 0, 0]])
    (only,) = _stripes(cameras[:1], 1, 2.0)
    np.testing.assert_array_equal(only.camera.c2w, cameras[0].c2w)


def test_of_many_views_a_stripe_shows_the_four_next_to_it():
    """Ten cameras in a row, half a depth from one to the next: two on either side of each middle."""
    row = make_cameras(10, 8, 12, spacing=1.0, turn=0.0)
    scene = make_smooth_gaussians(10, 8, 12, degree=0).with_cameras(row)
    stripes = _stripes(scene.cameras, 9, 2.0)
    assert [list(stripe.views) for stripe in stripes[1:-1]] == [[n - 1, n, n + 1, n + 2] for n in range(1, 8)]
    inverse = -1 / scene.means[..., 2]
    found = _select(scene, inverse, np.ones_like(inverse), stripes[4])
    assert set(found.at[0].tolist()) == {3, 4, 5, 6}
    assert [list(stripe.views) for stripe in _stripes(scene.cameras[:6], 1, 2.0)] == [list(range(6))]


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

    reached = (None,)

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


class _Fading:
    """A probe whose pictures lose what is said for an opacity error of 0.01."""

    reached = (None,)

    def __init__(self, damage: float) -> None:
        self.damage = damage

    def opacity_damage(self, errors) -> float:
        return self.damage * float(np.sqrt(np.mean(errors[0] ** 2)) / 0.01) ** OPACITY_EXPONENT


def test_opacitys_step_is_the_stated_one_or_as_fine_as_its_errors_ask_for():
    planes = np.random.default_rng(0).uniform(0, 1, (1, 64, 64)).astype(np.float32)
    start = 0.02  # errors of about 0.006
    at_start = _Fading(1e-5).opacity_damage([BlockSpectrum.of(planes).coding_error(start)])
    for most, step in ((1.1 * at_start, start), (at_start / 4, start * 4 ** (-1 / 1.7)), (1e-9, start / FARTHEST)):
        assert measured_opacity_step(_Fading(1e-5), [planes], start, most) == pytest.approx(step, rel=0.02)


def test_opacity_is_coded_more_finely_where_surfaces_show_through_each_other(store):
    scene = make_smooth_gaussians(2, 40, 48, degree=0)
    noise = np.random.default_rng(0)
    rough = noise.uniform(0, 1, scene.opacities.shape).astype(np.float32)
    black = np.full_like(scene.sh, -0.5 / 0.28209479)  # on black
    contrasting = noise.normal(0, 2, scene.sh.shape).astype(np.float32)
    steps = [
        scene_steps(_prepared(replace(scene, opacities=rough, sh=sh), store), ADAPTIVE, 1)[0]
        for sh in (black, contrasting)
    ]
    assert steps[0][PlaneClass.OPACITY] == class_step(ADAPTIVE, PlaneClass.OPACITY) > steps[1][PlaneClass.OPACITY]


def test_moved_depths_are_those_that_a_decoder_would_rebuild(layers):
    probe, inverse = _probe(layers)
    chosen, camera = probe._shots[0].chosen[0], layers[0].layer.cameras[1]
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


@pytest.mark.parametrize("qp", [0.0, 6.0])
def test_coefficients_are_kept_whose_energy_shows_at_the_finest_step(store, qp):
    """What degree 2 carries, against `energy_floor` squared steps that are a `margin` of octaves finer than wanted."""
    scene = make_smooth_gaussians(2, 24, 32, degree=2)
    functions = sh_basis(view_directions(scene.cameras), 2)[:, 4:]
    seen = np.einsum("db,nbc->dnc", functions, scene.sh.reshape(-1, 9, 3)[:, 4:].astype(np.float64))
    energy = float(np.square(seen).sum(axis=-1).mean())
    finest = ADAPTIVE.gain / np.sqrt(ADAPTIVE.sensitivity[PlaneClass.COLOR]) * 2 ** (qp / 6 - 1.5)
    for factor, degree in ((1.01, 1), (0.99, 2)):
        settings = replace(ADAPTIVE, disagreement=0.0, margin=1.5, energy_floor=factor * energy / finest**2)
        geometry = take_geometry(project_layer(store, scene, drop_invalid=False, where=""))
        assert prepare_layer(store, scene, geometry, settings, qp).layer.degree == degree


@pytest.mark.parametrize(("sigma", "hidden"), [(0.1, 0.2), (0.2, 0.2), (0.5, 0.5), (1.0, 1.0), (3.0, 1.0)])
def test_steps_of_small_splats_by_hand(layers, sigma, hidden):
    """Scale's go with 1 / width and rotation's with its square, for mean deviations of 0.2 to 1 px."""
    steps = known_steps((layers[0].scale_mix[0], np.full(3, sigma)), 1, replace(ADAPTIVE, behind=1.5))
    width = hidden / ADAPTIVE.width
    gain = 1.5 * ADAPTIVE.gain
    wanted = {c: gain / np.sqrt(s) for c, s in ADAPTIVE.sensitivity.items() if c != PlaneClass.OPACITY}
    wanted[PlaneClass.SCALE] /= width
    wanted[PlaneClass.ROTATION] /= width**2
    assert steps == pytest.approx(wanted)


def test_components_are_kept_until_what_is_left_out_is_small_against_a_step():
    energies = np.array([8.0, 4.0, 2.0, 1.0])
    for left_out, wanted in ((16, 1), (15.1, 1), (7.1, 1), (6.9, 2), (3.1, 2), (2.9, 3), (1.1, 3), (0.9, 4), (0, 4)):
        step = np.sqrt(left_out / ADAPTIVE.energy_floor)
        assert kept_components(energies, step, ADAPTIVE) == wanted


def test_q_g_is_accepted_from_minus_60_to_60():
    scene = make_smooth_gaussians(1, 8, 8, degree=0)
    for qp in (-60, 60):
        assert inspect_bytes(Runtime(threads=1).compress(scene, qp=qp))["qp"] == qp
        with pytest.raises(InputError, match="qp"):
            Runtime(threads=1).compress(scene, qp=1.001 * qp)
    with pytest.raises(InputError, match="qp"):
        Runtime(threads=1).compress(scene, qp=float("nan"))


@pytest.mark.parametrize("profile", ["paper", "fast"])
def test_a_file_states_the_least_and_the_largest_depth(profile):
    scene = make_smooth_gaussians(2, 24, 32, degree=0, layers=2)
    found = read_container(Runtime(threads=1).compress(scene, profile))
    for layer, header in zip(scene.layers, found.body.layers, strict=True):
        pairs = zip(layer.means.astype(np.float64), scene.cameras, strict=True)
        z = np.stack([(means - camera.centre) @ camera.c2w[:3, 2] for means, camera in pairs])
        np.testing.assert_allclose(header.depth_limits, (z.min(), z.max()), rtol=1e-5)


def test_bytes_do_not_depend_on_threads():
    gaussians = make_smooth_gaussians(2, 40, 48, degree=1, layers=2)
    one, two = (Runtime(threads=n).compress(gaussians) for n in (1, 2))
    assert one == two


def test_planes_that_need_no_look_are_coded_before_it_and_each_but_once(store, monkeypatch):
    """And the file is the one of a plan that is made first."""
    scene = make_smooth_gaussians(2, 40, 48, degree=1, layers=2)
    events: list[str] = []
    coded = Event()

    def coder(codes, qp, settings, offsets):
        events.append("plane")
        coded.set()
        return encode_plane(codes, qp, settings, offsets)

    def looked(*arguments):
        assert coded.wait(60), "no plane was given to the coder before the look"
        events.append("look")
        return scene_steps(*arguments)

    monkeypatch.setattr("tinysplat_runtime.codec.planning.scene_steps", looked)
    encoder = SceneEncoder(scene, PROFILES["balanced"], store, threads=1, plane_coder=coder)
    data = encoder.encode(0)
    planes = sum(len(c.streams) for layer in read_container(data).body.layers for c in layer.channels)
    assert events.count("plane") == planes
    assert events[0] == "plane" and events.count("look") == 1
    assert data == encoder.code(encoder.plan(0), 0)
