"""How costs grow, in tables and in words."""

from __future__ import annotations

import pytest

from tinysplat.measure.rows import Row
from tinysplat.measure.studies.growth import capture_table, growth_table


def capture(photos: int, power: float) -> Row:
    costs = {"seconds": 0.1 * photos, "cpu": 0.2 * photos**power, "peak_bytes": 300_000_000}
    return Row("growth captures", "photos", f"{photos}x64x48", {"x": photos}, {"bytes": 3000 * photos}, costs)


@pytest.mark.parametrize("power", [1.0, 1.25])
def test_powers_are_those_of_large_captures(power: float) -> None:
    text = capture_table([capture(photos, power) for photos in (1000, 200, 48)] + [capture(4, 0.1)])
    assert all(told in text for told in ("64×48", "48", "1,000", f"{power:.2f}", "1.00", "0.00"))
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert [line.split("|")[1].strip() for line in lines[-4:]] == ["4", "48", "200", "1,000"]


def test_each_axis_has_a_line_with_its_ends_and_the_power_of_its_larger_half() -> None:
    rows = [capture(photos, 1.25) for photos in (1000, 200, 48)] + [capture(12, 0.1)]
    rows += [
        Row("growth clouds, compiled", axis, f"{x}", {"x": x}, {}, {"seconds": 1e-6 * x, "peak_bytes": 5_000_000})
        for axis in ("Gaussians", "pixels of the picture")
        for x in (2000, 500_000)
    ]
    rows.append(Row("growth photos, encode", "pixels of a photo", "x", {"x": 9}, note="out of memory"))
    _, _, captures, *clouds = growth_table(rows).splitlines()
    assert "photos" in captures and all(told in captures for told in ("12", "1,000", "1.25"))
    assert len(clouds) == 2 and all(told in line for line in clouds for told in ("2,000", "500,000", "1.00"))
    assert not growth_table([capture(4, 1)])
