"""Bytes at equal dB: against straight lines, whose answers are known."""

import math

import pytest

from tinysplat.measure.studies.lists import bytes_at


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
