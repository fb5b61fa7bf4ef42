"""What the rate model makes of planes: its sums by a second calculation, the DCT sample block by block, the search."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.fft import dctn

from tinysplat_runtime.codec import rate
from tinysplat_runtime.codec.quantise import choose_code_map
from tinysplat_runtime.codec.rate import ChannelModel, Try, _better, _fits, _sampled_dct, _slope, _solve, next_qp, tries
from tinysplat_runtime.gaussian.planes import Channel, PlaneClass


def plane(views: int = 2, height: int = 40, width: int = 48) -> NDArray:
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:height, :width] / 9
    waves = np.sin(x + 0.3 * y) + 0.4 * np.cos(2.2 * y)
    return (waves + 0.2 * rng.uniform(-1, 1, (views, height, width))).astype(np.float32)


def channel(values: NDArray, step: float = 0.05) -> Channel:
    return Channel(PlaneClass.COLOR, 0, values, step, (float(values.min()), float(values.max())))


@pytest.mark.parametrize(
    ("shape", "stride"), [((2, 40, 48), 1), ((1, 5, 20), 1), ((3, 170, 200), 3), ((1, 264, 256), 3)]
)
def test_the_sample_is_the_dct_of_every_so_manieth_block(shape: tuple[int, int, int], stride: int) -> None:
    """1024 blocks or a little less, an odd number apart; means count by half their difference to the neighbour's."""
    values = plane(*shape)
    found, share = _sampled_dct(values)
    padded = np.pad(values, ((0, 0), (0, max(8 - shape[1], 0)), (0, 0)), mode="edge")
    rows, columns = padded.shape[1] // 8, padded.shape[2] // 8
    blocks = [
        padded[v, 8 * i : 8 * i + 8, 8 * j : 8 * j + 8]
        for v in range(shape[0])
        for i in range(rows)
        for j in range(columns)
    ]
    means = np.array([block.mean() for block in blocks]).reshape(shape[0], rows, columns)
    wanted = []
    for n in range(0, len(blocks), stride):
        coefficients = np.abs(dctn(blocks[n].astype(np.float64), norm="ortho")).ravel()
        v, i, j = np.unravel_index(n, means.shape)
        before = means[v, i, j - 1] if j else means[v, i - 1, 0]
        coefficients[0] = abs(means[v, i, j] - before) * 4
        wanted.append(coefficients)
    assert found.shape == (len(wanted), 64) and share == len(blocks) / len(wanted)
    np.testing.assert_allclose(found, wanted, atol=2e-5)


@pytest.mark.parametrize("shift", [-12.0, 0.0, 3.0, 12.0])
def test_bytes_are_three_bits_a_coefficient_and_one_an_octave_above_the_step(shift: float) -> None:
    values = plane()
    model = ChannelModel(channel(values))
    coefficients, share = _sampled_dct(values)
    low, high = float(values.min()), float(values.max())
    step = choose_code_map(low, high, float(values.mean(dtype=np.float64)), 0.05 * 2 ** (shift / 6)).step
    kept = coefficients[coefficients > 0.6 * step]
    bits = 3 * len(kept) + 1.05 * np.log2(kept / step).sum() + 0.9 * len(coefficients)
    assert model.bytes_at(shift) == pytest.approx(bits * share / 8, rel=0.02)


def test_a_second_picture_costs_what_the_first_leaves() -> None:
    values = plane()
    coefficients, share = _sampled_dct(values)
    plain, both = ChannelModel(channel(values, 0.2)), ChannelModel(channel(values, 0.2), 0.1)
    step = choose_code_map(float(values.min()), float(values.max()), float(values.mean(dtype=np.float64)), 0.2).step
    rest = np.abs(coefficients - step * np.floor(coefficients / step + 1 / 3))
    kept = rest[rest > 0.06]
    bits = 3 * len(kept) + 1.05 * np.log2(kept / 0.1).sum() + 0.9 * len(coefficients)
    assert both.bytes_at(0) - plain.bytes_at(0) == pytest.approx(bits * share / 8, rel=1e-3)


def test_a_flat_plane_costs_nothing() -> None:
    assert ChannelModel(channel(np.full((1, 16, 16), 0.5, np.float32))).bytes_at(0) == 0
    nearly = np.full((1, 16, 16), 0.5, np.float32)
    nearly[0, 0, 0] = 0.5001
    assert ChannelModel(channel(nearly, 10.0)).bytes_at(0) == 0


def test_models_stay_what_they_were() -> None:
    found = [ChannelModel(channel(plane())).bytes_at(shift) for shift in (-18, -6, 0, 6, 18)]
    assert found == pytest.approx(MODELLED, rel=2e-3)
    fine = ChannelModel(channel(plane(3, 170, 200)), 0.01)
    assert [fine.bytes_at(shift) for shift in (0, 9)] == pytest.approx(FINE, rel=2e-3)


MODELLED = (3076.18, 2201.12, 1665.15, 1117.48, 174.36)
FINE = (79245.55, 56881.34)


# ---- the search --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("seen", "wanted"),
    [
        ([(0, 40)], 5.0), ([(0, 36)], -1 / 0.6), ([(0, 40), (5, 38)], 5 + 1 / 0.6),
        ([(0, 40), (5, 39), (9, 38)], 9 + 2 / 0.6),
        ([(0, 40), (10, 35)], 6.0), ([(10, 35), (0, 40)], 6.0), ([(0, 40), (10, 36.9)], 9.0),
        ([(0, 37.1), (10, 20)], 1.0),
        ([(0, 45), (2, 41), (8, 33), (6, 35)], 2 + 8 / 3), ([(0, 37), (10, 36)], 1.0),
    ],
)  # fmt: skip
def test_the_next_try_is_along_the_slope_or_between_the_nearest_on_either_side(seen, wanted: float) -> None:
    assert next_qp(seen, 37.0, 0.6) == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("seen", "wanted"),
    [
        ([], 0.5), ([(0, 40)], 0.5), ([(0, 40), (0.09, 39)], 0.5), ([(0, 40), (0.1, 39.9)], 1.0),
        ([(0, 40), (2, 39)], 0.5),
        ([(0, 40), (10, 39)], 0.3), ([(0, 40), (1, 30)], 1.2), ([(9, 9), (0, 40), (-2, 42)], 1.0),
    ],
)  # fmt: skip
def test_a_slope_is_that_of_the_latest_two_within_a_factor_of_two_of_the_typical(seen, wanted: float) -> None:
    assert _slope(seen, 0.5, 0.6) == pytest.approx(wanted)


@pytest.mark.parametrize(("root", "wanted"), [(3.0, 3.0), (-70.0, -60.0), (70.0, 60.0), (-60.0, -60.0), (60.0, 60.0)])
def test_a_falling_function_is_solved_or_the_nearer_end_taken(root: float, wanted: float) -> None:
    found = _solve(lambda x: root - x, -60.0, 60.0)
    assert found == pytest.approx(wanted, abs=1e-3) and (root <= found or found == 60.0)


def test_a_file_fits_from_97_percent_up_to_the_target_and_the_larger_one_is_better() -> None:
    assert [_fits(bytes(n), 100) for n in (96, 97, 100, 101)] == [False, True, True, False]
    files = {n: bytes(n) for n in (0, 5, 8, 10, 11)}
    assert _better(files[5], files[8], 10) is files[8] and _better(files[8], files[5], 10) is files[8]
    assert _better(files[8], files[11], 10) is files[8] and _better(files[8], files[10], 10) is files[10]
    assert _better(files[8], bytes(8), 10) is files[8]


def searched(score: Callable[[float], float], low: float, high: float, **options: float) -> list[Try]:
    return list(tries(lambda qp: b"%f" % qp, lambda data: score(float(data)), low, high, 0.6, **options))


def test_a_search_ends_in_the_range_at_the_count_or_where_nothing_is_left_to_try() -> None:
    found = searched(lambda qp: 40 - 0.6 * qp, 37.0, 37.2)
    assert [file.qp for file in found] == pytest.approx([0, 2.9 / 0.6]) and found[-1].score == pytest.approx(37.1)
    assert [file.qp for file in searched(lambda qp: 40 - 0.6 * qp, 39.9, 40.0)] == [0]
    assert [file.qp for file in searched(lambda qp: 40 - 0.6 * qp, 40.0, 40.1, start=3)][:1] == [3]
    level = searched(lambda qp: 30.0, 37.0, 37.2)
    assert level[-1].qp == -rate.MAX_GLOBAL_QP and len(level) < 8 and all(file.score == 30 for file in level)
    jump = searched(lambda qp: 40.0 if qp < 1.7 else 30.0, 37.0, 37.2)
    assert len(jump) <= 14 and abs(jump[-1].qp - 1.7) < 2
    assert len(searched(lambda qp: 40 - math.copysign(abs(qp) ** 3, qp), 37.01, 37.0101, count=3)) == 3
