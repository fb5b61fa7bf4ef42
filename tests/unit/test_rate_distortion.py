"""BD-rate and curves."""

from __future__ import annotations

import numpy as np
import pytest

from tinysplat.evaluation.rate_distortion import Point, bd_rate, bytes_at
from tinysplat_runtime.errors import InputError


def _points(pairs):
    return [Point(0, int(size), db) for size, db in pairs]


REFERENCE = _points([(10_000, 35.0), (20_000, 38.0), (40_000, 41.0), (80_000, 44.0)])


@pytest.mark.parametrize("share", [0.5, 0.9, 1.7])
def test_bd_rate_of_a_curve_scaled_in_bytes_is_the_scale(share):
    scaled = _points([(p.bytes * share, p.psnr) for p in REFERENCE])
    assert bd_rate(REFERENCE, scaled) == pytest.approx(share - 1, abs=1e-3)
    assert bd_rate(scaled, REFERENCE) == pytest.approx(1 / share - 1, abs=1e-3)


def test_bd_rate_on_a_straight_line_in_log_bytes_is_the_shift_in_db():
    # 3 dB double the bytes here, so that 1 dB more at equal bytes is 2^(−1/3) of the bytes at equal dB.
    better = _points([(p.bytes, p.psnr + 1) for p in REFERENCE])
    assert bd_rate(REFERENCE, better) == pytest.approx(2 ** (-1 / 3) - 1, abs=1e-4)


def test_limits_choose_the_range_and_beaten_points_do_not_count():
    crossing = _points([(5_000, 35.0), (40_000, 41.0), (160_000, 44.0), (170_000, 39.0)])
    assert bd_rate(REFERENCE, crossing, (35, 37)) < 0 < bd_rate(REFERENCE, crossing, (42, 44))


def test_bytes_at_passes_through_the_points_and_ends_with_them():
    assert bytes_at(REFERENCE, 38.0) == pytest.approx(20_000)
    assert 20_000 < bytes_at(REFERENCE, 39.5) < 40_000
    assert bytes_at(REFERENCE, 34.9) is None and bytes_at(REFERENCE, 44.1) is None


def test_curves_without_common_range_are_refused():
    far = _points([(1_000, 20.0), (2_000, 25.0)])
    with pytest.raises(InputError, match=r"share 0\.00 dB"):
        bd_rate(REFERENCE, far)
    with pytest.raises(InputError):
        bd_rate(REFERENCE, REFERENCE[:1])
    assert np.isfinite(bd_rate(REFERENCE, REFERENCE[1:3]))
