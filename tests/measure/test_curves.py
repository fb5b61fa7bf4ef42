"""Bytes at equal dB and BD-rate: against straight lines, whose answers are known."""

from __future__ import annotations

import math

import pytest
from scenes import refusing

from tinysplat.measure.curves import bd_rate, bytes_at
from tinysplat_runtime.errors import InputError


def line(share: float = 1.0, shift: float = 0.0, decibels: tuple[float, ...] = (30, 32, 34, 36)) -> list:
    """Bytes that double every 2 dB from 1000 at 30 dB, which monotone cubics in log bytes follow exactly."""
    return [(share * 1000 * 2 ** ((db - shift - 30) / 2), db) for db in decibels]


@pytest.mark.parametrize("db", [30, 31, 32.5, 36])
def test_bytes_lie_on_the_line_and_its_ends(db: float) -> None:
    size = 1000 * 2 ** ((db - 30) / 2)
    for points in (line(), line()[::-1], [*line(), (9000.0, 33.0)], [*line(), (2000.0, 31.0)]):
        assert bytes_at(points, db) == pytest.approx(size, rel=1e-9)


def test_outside_its_points_a_curve_says_nothing() -> None:
    assert bytes_at(line(), 29.999) is None and bytes_at(line(), 36.001) is None
    assert bytes_at(line()[:1], 30) is None and bytes_at([], 30) is None
    assert bytes_at(line()[:2], 31) == pytest.approx(1000 * math.sqrt(2))


@pytest.mark.parametrize("share", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("limits", [None, (31.0, 33.0), (0.0, 99.0)])
def test_bd_rate_is_the_share_of_bytes_wherever_it_is_taken(share: float, limits) -> None:
    assert bd_rate(line(), line(share), limits) == pytest.approx(share - 1, rel=1e-9, abs=1e-9)


def test_bd_rate_is_taken_over_what_curves_share_and_refused_where_that_is_too_little() -> None:
    for low, shared in ((35.9, "0.1"), (35.0, "1")):
        overlapping = line(0.5, decibels=(low, 36.5, 38))
        assert bd_rate(line(), overlapping, least_overlap=float(shared) - 0.01) == pytest.approx(-0.5)
        with refusing(InputError, shared):
            bd_rate(line(), overlapping, least_overlap=float(shared) + 0.01)
    with pytest.raises(InputError):
        bd_rate(line(), line(decibels=(40, 42)))
    with refusing(InputError, "0.2"):
        bd_rate(line(), line(), (31.0, 31.2), 0.3)
    for pair in ((line()[:1], line()), (line(), line()[:1])):
        with pytest.raises(InputError):
            bd_rate(*pair)
    assert bd_rate(line()[:2], line(2)[:2]) == pytest.approx(1)


def test_bd_rate_of_lines_of_two_slopes_is_the_mean_of_log_bytes() -> None:
    steep = [(1000 * 2 ** (db - 30), db) for db in (30, 32, 34)]  # at 30 + d: 2^(d/2) times as many
    assert bd_rate(line(), steep, (30, 34)) == pytest.approx(2 ** (4 / 2 / 2) - 1, rel=1e-9)
