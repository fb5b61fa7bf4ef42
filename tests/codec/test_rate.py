"""Rate control: targets are hit, or told to be out of reach, and the search depends on the scene alone."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from scenes import make_free_gaussians, make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.codec.adaptive import depth_fineness, with_depth_pictures
from tinysplat_runtime.codec.encoder import SceneEncoder
from tinysplat_runtime.codec.hevc import encode_plane
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.codec.quantise import choose_code_map
from tinysplat_runtime.codec.rate import ChannelModel, _slope, _solve, encode_to_psnr, encode_to_size, next_qp, tries
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.planes import Channel, PlaneClass
from tinysplat_runtime.render import Renderer, renderer

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


@pytest.mark.parametrize("wrong", [0.9, 1.2, 1.25])
def test_a_model_that_is_wrong_leads_to_the_target_all_the_same(gaussians, monkeypatch, wrong):
    bytes_at = ChannelModel.bytes_at
    monkeypatch.setattr(ChannelModel, "bytes_at", lambda model, shift: wrong * bytes_at(model, shift))
    assert 0.97 * 13_000 <= len(RUNTIME.compress(gaussians, target_size=13_000)) <= 13_000


def test_a_target_size_costs_at_most_as_many_planes_as_two_encodes(gaussians):
    coded = []

    def counted(codes, qp, settings, offsets):
        plane = encode_plane(codes, qp, settings, offsets)
        coded.append(len(plane.payload))
        return plane

    def encoder():
        return SceneEncoder(gaussians, PROFILES["balanced"], RUNTIME.store, threads=2, plane_coder=counted)

    plain_encoder = encoder()
    plain_encoder.code(plain_encoder.plan(0), 0)
    plain, coded[:] = len(coded), []
    encode_to_size(encoder(), 12_000)
    assert 0 < len(coded) <= 2 * plain


@pytest.mark.parametrize(("profile", "target"), [("paper", 34.0), ("balanced", 39.0)])
def test_a_target_psnr_is_reached_and_passed_by_at_most_a_fifth_of_a_decibel(gaussians, profile, target):
    data = RUNTIME.compress(gaussians, profile, target_psnr=target)
    assert target <= _psnr(gaussians, ts.decompress(data)) + 1e-3 <= target + 0.2 + 2e-3


def test_the_search_does_not_depend_on_threads(gaussians):
    one, three = (ts.Runtime(threads=n).compress(gaussians, target_size=15_000) for n in (1, 3))
    assert one == three


def test_the_search_does_not_depend_on_whether_numba_is_installed(gaussians, monkeypatch):
    """Compiled pictures differ in their last bits, and with them would the search's next step."""
    asked = []
    monkeypatch.setattr(renderer, "_compiled_module", lambda required: asked.append(required))
    RUNTIME.compress(gaussians, target_psnr=38)
    assert asked == []


def test_targets_out_of_reach_name_the_nearest(gaussians):
    small = make_smooth_gaussians(1, 16, 16, degree=0)
    with pytest.raises(InputError, match=r"target_size: 200 bytes; .* to \d+ at least") as error:
        RUNTIME.compress(small, target_size=200)
    nearest = int(re.findall(r"(\d+) at least", str(error.value))[0])
    assert len(RUNTIME.compress(small, qp=60)) == nearest
    with pytest.raises(InputError, match=r"target_psnr: 110 dB; .* reaches [\d.]+ dB here at most"):
        RUNTIME.compress(small, target_psnr=110)


def test_a_target_size_beyond_the_finest_steps_gives_the_finest_file():
    small = make_smooth_gaussians(1, 16, 16, degree=0)
    assert len(RUNTIME.compress(small, target_size=10**8)) >= len(RUNTIME.compress(small, qp=-60))


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"qp": 0, "target_size": 1000}, "target_size: given with qp"),
        ({"target_psnr": 40, "target_size": 1000}, "target_psnr: given with target_size"),
        ({"target_size": 0}, "target_size"),
        ({"target_psnr": float("nan")}, "target_psnr"),
    ],
)
def test_contradictory_and_impossible_options_are_refused(gaussians, options, named):
    with pytest.raises(InputError, match=named):
        RUNTIME.compress(gaussians, **options)


@pytest.mark.parametrize("profile", ["paper", "fast", "max"])
def test_the_model_predicts_the_bytes_of_natural_planes_within_15_percent(profile):
    rng = np.random.default_rng(0)
    spectrum = np.fft.rfft2(rng.standard_normal((1, 192, 256)))
    frequency = np.hypot(np.fft.fftfreq(192)[:, None], np.fft.rfftfreq(256))
    values = np.fft.irfft2(spectrum / np.maximum(frequency, 1 / 256) ** 1.2).astype(np.float32)
    values /= values.std()
    window = float(values.min()), float(values.max())
    model = ChannelModel(Channel(PlaneClass.COLOR, 0, values, 0.1, window))
    for shift in (-8, 0, 8):
        step = 0.1 * 2 ** (shift / 6)
        code_map = choose_code_map(*window, float(values.mean()), step)
        found = len(encode_plane(code_map.quantise(values)[0][0], code_map.qp, PROFILES[profile].encoder).payload)
        assert model.bytes_at(shift) == pytest.approx(found, rel=0.15)


class _Scripted:
    """An encoder whose files say at which Q_g they were asked for, and nothing of plans."""

    profile = PROFILES["fast"]

    def __init__(self) -> None:
        self.planned: list[float] = []

    def plan(self, qp):
        self.planned.append(qp)
        return []

    def code(self, plans, qp):
        return f"{qp!r:<{round(100 * (70 - qp))}}".encode()


def test_the_search_aims_a_tenth_of_a_decibel_above_the_target():
    """Of a curve that falls as is expected, 0.6 dB per Q_g, the second file has 0.1 dB more than asked for."""
    encoder = _Scripted()
    data = encode_to_psnr(encoder, 38.0, lambda data: 40 - 0.6 * float(data))
    assert float(data) == pytest.approx((40 - 38.1) / 0.6)
    assert encoder.planned == [0, float(data)]  # more than 1.5 away, what follows from Q_g is asked for anew


def test_files_within_a_fifth_of_a_decibel_above_the_target_are_taken_and_others_not():
    for first, is_taken in ((38.0, True), (38.2, True), (37.99, False), (38.21, False)):
        found = encode_to_psnr(_Scripted(), 38.0, lambda data, first=first: first - 0.6 * float(data))
        assert (float(found) == 0) == is_taken


def test_where_the_curve_has_a_step_the_smallest_file_beyond_the_target_is_taken():
    seen = []

    def measure(data: bytes) -> float:
        seen.append(float(data))
        return 39.0 if float(data) < 1 else 37.5  # a step in the curve, with the target inside

    data = encode_to_psnr(_Scripted(), 38.0, measure)
    assert float(data) == max(qp for qp in seen if qp < 1) > 0.8
    assert len(seen) <= 14


def test_a_curve_that_stays_below_the_target_is_followed_to_its_end_and_told():
    seen = []

    def measure(data: bytes) -> float:
        seen.append(float(data))
        return min(36 - 0.6 * float(data), 37.5)

    with pytest.raises(InputError, match=r"target_psnr: 38 dB; .* reaches 37\.50 dB here at most"):
        encode_to_psnr(_Scripted(), 38.0, measure)
    assert min(seen) == -60


def test_a_file_that_contradicts_earlier_ones_replaces_them():
    """New plans at Q_g 5 make the curve jump by 2 dB: the search goes on from what they give."""
    seen: list[float] = []

    def score(data: bytes) -> float:
        seen.append(float(data))
        return 40 - 0.6 * float(data) + (2 if len(seen) > 2 else 0)

    files = list(tries(lambda qp: repr(qp).encode(), score, 34.0, 34.05, 1.2))
    assert 34 <= files[-1].score <= 34.05
    assert files[-1].qp == pytest.approx((42 - 34.025) / 0.6, abs=0.05)


@pytest.mark.parametrize(
    ("side", "degree", "layers", "seed"), [(16, 0, 1, 1), (16, 4, 2, 2), (32, 4, 1, 4), (64, 0, 1, 6)]
)
def test_no_target_is_refused_that_can_be_exceeded_and_bytes_grow_with_dB(side, degree, layers, seed):
    scene = make_smooth_gaussians(2, side, side, degree=degree, layers=layers, seed=seed)
    targets = range(34, 42, 2) if side > 16 else range(34, 42)
    files = [RUNTIME.compress(scene, target_psnr=db) for db in targets]
    for db, data in zip(targets, files, strict=True):
        assert _psnr(scene, ts.decompress(data)) >= db - 1e-3
    sizes = [len(data) for data in files]
    assert all(finer >= 0.97 * coarser for coarser, finer in itertools.pairwise(sizes))


@pytest.mark.parametrize(("degree", "seed", "targets"), [(0, 3, (30, 36)), (3, 5, (33,))])
def test_free_gaussians_meet_every_target_below_their_best(degree, seed, targets):
    scene = make_free_gaussians(80, degree, np.random.default_rng(seed))
    sizes = [len(RUNTIME.compress(scene, target_psnr=db)) for db in targets]
    assert sorted(sizes) == sizes
    assert len(RUNTIME.compress(scene, target_size=sizes[-1])) <= sizes[-1]


def test_depth_in_one_picture_or_two_has_the_same_step():
    encoder = SceneEncoder(make_smooth_gaussians(2, 16, 16), PROFILES["balanced"], RUNTIME.store, threads=1)
    for qp in (-24, 12):
        (plan,) = encoder.plan(qp)
        one, two = with_depth_pictures(plan, 1), with_depth_pictures(plan, 2)
        assert depth_fineness(one) == depth_fineness(two) == depth_fineness(plan)
        assert (one.refine_depth is None, two.refine_depth) == (True, one.channels[0].step)
        assert two.channels[0].step == 2 * one.channels[0].step
        assert with_depth_pictures(two, 1) == one


def test_the_slope_is_that_of_the_two_latest_files_within_a_factor_of_two():
    """dB lost per Q_g, typically 0.6."""
    assert _slope([(0, 40)], 0.7, 0.6) == 0.7
    assert _slope([(9, 99), (2, 40), (5, 37.6)], 0.7, 0.6) == pytest.approx(0.8)
    assert _slope([(5, 37.6), (2, 40)], 0.7, 0.6) == pytest.approx(0.8)
    assert _slope([(2, 40), (2.09, 30)], 0.7, 0.6) == 0.7  # too near to tell
    assert _slope([(2, 40), (2.11, 39.9)], 0.7, 0.6) == pytest.approx(0.1 / 0.11)
    assert _slope([(2, 40), (3, 39.9)], 0.7, 0.6) == pytest.approx(0.3)
    assert _slope([(2, 40), (3, 41)], 0.7, 0.6) == pytest.approx(0.3)
    assert _slope([(2, 40), (3, 38)], 0.7, 0.6) == pytest.approx(1.2)


def test_the_next_file_lies_between_its_neighbours_or_along_the_slope():
    assert next_qp([(2.0, 40.0)], 37.0, 0.5) == pytest.approx(8.0)
    assert next_qp([(2.0, 40.0), (4.0, 39.0)], 38.0, 0.5) == pytest.approx(6.0)
    assert next_qp([(2.0, 36.0)], 37.0, 0.5) == pytest.approx(0.0)
    assert next_qp([(0.0, 42.0), (2.0, 40.0), (8.0, 34.0), (6.0, 37.0)], 39.0, 0.5) == pytest.approx(2 + 4 / 3)
    assert next_qp([(2.0, 40.0), (6.0, 30.0)], 39.99, 0.5) == pytest.approx(2.4)  # not at the very end
    assert next_qp([(2.0, 40.0), (6.0, 30.0)], 30.01, 0.5) == pytest.approx(5.6)


def test_a_falling_function_s_zero_is_found_or_the_nearer_end():
    assert _solve(lambda x: 3 - 2 * x, -8, 9) == pytest.approx(1.5, abs=1e-3)
    assert _solve(lambda x: 3 - 2 * x, 2, 9) == 2
    assert _solve(lambda x: 3 - 2 * x, -8, 1) == 1
