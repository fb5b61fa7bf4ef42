"""Who goes and who stays by given costs: prices, searches, tiers and what is said, without drawing anything."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scenes import make_cameras, make_free_gaussians

from tinysplat_runtime.codec.free.levels import LEVELS
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.prune.amount import Amount

pytest.importorskip("numba")

from tinysplat_runtime.prune import kernels, reduction, removal, thinning, tiers
from tinysplat_runtime.prune.removal import Remover, Thinned, taken
from tinysplat_runtime.prune.thinning import band_penalties


class Costs:
    """In place of pictures: removing a Gaussian costs what its red says, of which every view has a share."""

    def __init__(self, cameras, run_jobs) -> None:
        self.cameras, self.looks = tuple(cameras), []
        self.wanted = dict.fromkeys(range(len(self.cameras)), np.zeros((1, 1, 4), np.float32))
        self.values = 3 * sum(camera.width * camera.height for camera in cameras)

    def measure(self, gaussians: Gaussians, views):
        self.looks.append((gaussians.opacities.size, list(views)))
        for _ in views:
            sums = np.zeros((gaussians.opacities.size, kernels.SUMS), np.float32)
            sums[:, kernels.COST] = gaussians.scales[:, 0] / len(self.cameras)
            sums[:, kernels.BOUND] = 1
            yield sums

    def errors(self, gaussians: Gaussians):
        yield from [0.01 * (100 - gaussians.opacities.size)] * len(self.cameras)


@pytest.fixture
def ranked(monkeypatch):
    """A hundred Gaussians whose costs are 1 to 100 in an order of their own, and who ranks them in four views."""
    monkeypatch.setattr(removal, "Pictures", Costs)
    monkeypatch.setattr(removal, "merged", lambda whole, rows, gone: taken(whole, rows))
    monkeypatch.setattr(removal, "corrected", lambda gaussians, *_: gaussians)
    costs = np.random.default_rng(0).permutation(100) + 1.0
    cloud = make_free_gaussians(100, 0, np.random.default_rng(1))
    cloud = replace(cloud, scales=np.repeat(costs[:, None], 3, axis=1))
    return costs, Remover(cloud, make_cameras(4, 10, 20), map)


def test_the_cheapest_go_a_fifth_at_a_time_with_a_look_at_half_of_the_views_between(ranked) -> None:
    costs, remover = ranked
    found = remover.thin_to(50)
    np.testing.assert_array_equal(found.rows, np.flatnonzero(costs > 50))
    np.testing.assert_array_equal(found.gaussians.scales[:, 0], costs[found.rows])
    assert found.left_out == 50 and found.psnr == pytest.approx(10 * math.log10(2400 / (4 * 0.01 * 50)))
    looks = remover._pictures.looks
    assert looks[:2] == [(100, [0, 2]), (100, [1, 3])]
    assert looks[2:6] == [(80, [0, 2]), (64, [1, 3]), (51, [0, 2]), (40, [1, 3])]  # ceil of a fifth goes
    assert remover.thin_to(90).left_out == 10 and (remover._present.size, len(remover.whole.rows)) == (40, 100)
    assert remover.whole.left_out == 0 and remover.whole.psnr == 150 and remover.whole.text == ""


@pytest.mark.parametrize(("worth", "left"), [(0.0, 100), (30.5, 70), (30.0, 71), (99.5, 1), (1e9, 1)])
def test_what_costs_less_than_its_worth_goes_but_for_the_last(ranked, worth: float, left: int) -> None:
    costs, remover = ranked
    found = remover.thin(worth)
    wanted = np.flatnonzero(costs >= worth) if worth < 101 else [int(costs.argmax())]
    np.testing.assert_array_equal(found.rows, wanted)
    assert len(found.rows) == left and found.left_out == 100 - left


def test_prices_never_fall(ranked) -> None:
    costs, remover = ranked
    remover.thin_to(5)
    gone = np.flatnonzero(np.isfinite(remover._prices))
    order = gone[np.argsort(costs[gone])]
    assert (np.diff(remover._prices[order]) >= 0).all() and (remover._prices[gone] >= costs[gone]).all()
    rows = np.array([3, 50, 7, 99, 20, 61])
    np.testing.assert_array_equal(remover.dearest(rows, 2), np.sort(np.argsort(costs[rows])[-2:]))
    assert remover.dearest(rows, 6).tolist() == [0, 1, 2, 3, 4, 5]


def test_decibels_and_worths_by_hand(ranked) -> None:
    _, remover = ranked  # 4 views of 10×20 pixels and three colours
    assert remover.psnr(24.0) == pytest.approx(20) and remover.psnr(0.0) == 150
    assert remover.error_of(taken(remover._all, np.arange(60))) == pytest.approx(4 * 0.4)
    # 1 + 2 + … + 9 is 45 and with 10 it is 55: for an error of 50 the tenth is too much, and tells
    assert remover.worth_at(-10 * math.log10(50 / 2400)) == 10
    assert (
        remover.worth_at(-10 * math.log10(45.1 / 2400)) == 10 and remover.worth_at(-10 * math.log10(44.9 / 2400)) == 9
    )
    assert remover.worth_at(-60) == 100 and remover.worth_at(90) == 1


def test_what_is_left_is_said_in_a_line() -> None:
    cloud = make_free_gaussians(1234, 0, np.random.default_rng(0))
    assert Thinned(cloud, np.arange(1234), 8766, 44.06).text == "8,766 of 10,000 left out: 44.1 dB"


def test_rows_are_taken_in_the_order_given() -> None:
    cloud = make_free_gaussians(9, 1, np.random.default_rng(0))
    found = taken(replace(cloud, origin=np.array([1.0, 2, 3])), np.array([5, 0, 5]))
    assert found.origin.tolist() == [1, 2, 3]
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(found, name), getattr(cloud, name)[[5, 0, 5]])


# ---- searches ----------------------------------------------------------------------------------------------------


class Falling:
    """Loses 3 dB where worth doubles, from 60 dB at 1; a hundredth of what is asked is left out more each octave."""

    def __init__(self, slope: float = 3.0) -> None:
        self.slope, self.asked = slope, []
        self.whole = self.at(-99.0)

    def at(self, octaves: float) -> Thinned:
        return Thinned(None, np.zeros(0), max(int(1000 + 100 * octaves), 0), min(60 - self.slope * octaves, 100))  # type: ignore[arg-type]

    def worth_at(self, psnr: float) -> float:
        return 4.0

    def thin(self, worth: float) -> Thinned:
        self.asked.append(math.log2(worth))
        return self.at(math.log2(worth))


@pytest.mark.parametrize("slope", [3.0, 2.0, 9.0])
@pytest.mark.parametrize("target", [36.0, 57.0, 66.0])
def test_a_quality_is_met_with_three_tenths_of_a_decibel_to_spare(slope: float, target: float) -> None:
    remover = Falling(slope)
    found = reduction._to_psnr(remover, target)
    assert target <= found.psnr <= target + 0.3 and 1 <= len(remover.asked) <= 8
    assert remover.asked[0] == pytest.approx(2)
    if slope == 3.0 and not 53.7 <= target <= 54:
        assert len(remover.asked) == 2 and found.psnr == pytest.approx(target + 0.15)


def test_a_quality_that_nothing_reaches_keeps_all() -> None:
    remover = Falling()
    assert reduction._to_psnr(remover, 200.0) is remover.whole and len(remover.asked) == 8


@pytest.mark.parametrize(
    ("text", "amount"),
    [("10dB", Amount(psnr=10)), ("100DB", Amount(psnr=100)), ("1", Amount(count=1)), ("1.0", Amount(count=1)),
     ("0.999", Amount(share=0.999)), ("1e-9", Amount(share=1e-9))],
)  # fmt: skip
def test_amounts_are_read_to_their_ends(text: str, amount: Amount) -> None:
    assert Amount.of(text) == amount
    for wrong in ("9.99dB", "100.1dB", "1.5", "0", "2.5", "-1", "dB"):
        with pytest.raises(InputError, match="--prune"):
            Amount.of(wrong)


@pytest.mark.parametrize(
    ("amount", "left"),
    [(Amount(share=0.3), 7), (Amount(share=0.999), 1), (Amount(count=4), 4), (Amount(count=99), 9), (Amount(), 9)],
)
def test_so_many_are_left_of_those_that_show(amount: Amount, left: int, monkeypatch) -> None:
    """Ten, of which one shows nowhere: shares are of all ten."""
    cloud = make_free_gaussians(10, 0, np.random.default_rng(0))
    cloud = replace(cloud, opacities=np.where(np.arange(10) == 4, 1e-4, cloud.opacities.clip(0.1)))
    asked = []

    class Counting:
        def __init__(self, shown: Gaussians, cameras, run) -> None:
            self.shown = shown

        def thin_to(self, count: int) -> Thinned:
            asked.append(count)
            return Thinned(taken(self.shown, np.arange(count)), np.arange(count), 10 - count, 40.0)

    monkeypatch.setattr(reduction, "Remover", Counting)
    found = reduction.leave_out(cloud, amount, 1)
    assert asked == [left] and found.gaussians.count == left and found.gaussians.notes.thinned == found.text


def test_views_on_the_way_are_no_larger_than_those_about_a_scene(monkeypatch) -> None:
    monkeypatch.setattr(reduction, "SIDE", 30)
    for size, count, wanted in (
        ((40, 60), 3, (20, 30)),
        ((60, 20), 3, (30, 10)),
        ((20, 30), 25, (20, 30)),
        ((1, 90), 2, (1, 30)),
    ):
        cameras = make_cameras(count, *size)
        path = reduction._on_the_way(cameras)
        assert len(path) == max(20, count) and {(one.height, one.width) for one in path} == {wanted}
        np.testing.assert_allclose(
            [path[0].centre, path[-1].centre], [cameras[0].centre, cameras[-1].centre], atol=1e-12
        )


# ---- what a Gaussian is worth ------------------------------------------------------------------------------------


def test_bits_of_coefficients_follow_the_spread_of_their_band() -> None:
    """x² / (2 σ² ln 2) bits, of which eight are a byte, at what a byte is worth."""
    cloud = make_free_gaussians(50, 2, np.random.default_rng(0))
    sh = cloud.sh.copy()
    sh[:, 1], sh[:, 2:4], sh[:, 4:] = 0.75, 0.5, 2.0
    found, mean = band_penalties(replace(cloud, sh=sh), 3.0), (0.5625 + 2 * 0.25) / 3
    np.testing.assert_allclose(found, [3 / 8 / (2 * math.log(2) * mean), 3 / 8 / (2 * math.log(2) * 4)], rtol=1e-6)
    assert band_penalties(replace(cloud, sh=sh[:, :1]), 3.0) == []
    (none,) = band_penalties(replace(cloud, sh=0 * sh[:, :4]), 3.0)
    assert none == pytest.approx(3 / 8 / (2 * math.log(2) * 1e-12))


@pytest.mark.parametrize("qp", [0.0, 10.0, -5.0])
def test_a_gaussian_is_worth_six_times_the_mean_error_of_rounding(qp: float) -> None:
    cloud = make_free_gaussians(50, 1, np.random.default_rng(0))
    encoder, asked = object.__new__(thinning.ThinningEncoder), []

    class Whole:
        def rounded(self, qp: float, steps: float) -> Gaussians:
            asked.append((qp, steps))
            return cloud

    class Judge:
        def error_of(self, rounded: Gaussians) -> float:
            return 100.0

        def thin(self, worth: float, penalties: list[float]) -> tuple:
            return worth, penalties

    encoder._whole, encoder._remover = Whole(), Judge()  # type: ignore[assignment]
    (worth, penalties), same = encoder.thinned(qp)
    assert asked == [(qp, 0.5)] and worth == pytest.approx(6 * 100 / 50) and same == penalties
    np.testing.assert_allclose(penalties, band_penalties(cloud, 12 / 4 * 2 ** (0.1 * qp)))


class Growing:
    """Pictures of the first tiers come nearest where scales grow by what is told for their number."""

    def __init__(self, best: dict[int, float], cloud: Gaussians) -> None:
        self.best, self.cloud, self.asked = best, cloud, []

    def dearest(self, rows, count: int) -> np.ndarray:
        return np.arange(count) * 3

    def error_of(self, gaussians: Gaussians) -> float:
        size = gaussians.opacities.size
        growth = float(np.log(gaussians.scales[0, 0] / self.cloud.scales[0, 0]))
        self.asked.append((size, round(growth, 4)))
        return abs(growth - self.best[size])


def test_tiers_are_shares_of_the_dearest_and_grow_until_pictures_get_worse(monkeypatch) -> None:
    monkeypatch.setattr(tiers, "LEAST_COUNT", 6000)
    cloud = make_free_gaussians(6000, 0, np.random.default_rng(0))
    counts = [int(level.share * 6000) for level in LEVELS[:-1]]
    remover = Growing({counts[0]: 0.4, counts[1]: 0.1}, cloud)
    found = tiers.tiers_of(remover, Thinned(cloud, np.arange(6000), 0, 50.0))
    numbers = np.full(6000, len(LEVELS) - 1)
    for number in range(len(LEVELS) - 2, -1, -1):
        numbers[3 * np.arange(counts[number])] = number
    np.testing.assert_array_equal(found.numbers, numbers)
    assert found.growths == (0.4, 0.14)
    # the second tier's comes first, and both end with the first that is worse
    assert remover.asked == [(counts[1], g) for g in (0.0, 0.14, 0.26)] + [
        (counts[0], g) for g in (0.0, 0.14, 0.26, 0.4, 0.56)
    ]
    few = tiers.tiers_of(remover, Thinned(cloud, np.arange(5999), 0, 50.0))
    assert len(few.levels) == 1
