"""How costs of captures grow, in a table and in words."""

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
    assert "Photos of 64×48" in text and "From 48 to 1,000 photos" in text
    assert f"by the power {power:.2f} of" in text and "bytes by 1.00, and memory by 0.00" in text
    assert [line.split("|")[1].strip() for line in text.splitlines()[-4:]] == ["4", "48", "200", "1,000"]


def test_without_large_captures_no_powers_are_told() -> None:
    assert "power" not in capture_table([capture(4, 1), capture(12, 1)]) and not capture_table([])


def test_each_axis_has_a_line_with_its_ends_and_the_power_of_its_larger_half() -> None:
    rows = [capture(photos, 1.25) for photos in (1000, 200, 48, 12)]
    rows += [
        Row("growth clouds, compiled", axis, f"{x}", {"x": x}, {}, {"seconds": 1e-6 * x, "peak_bytes": 5_000_000})
        for axis in ("Gaussians", "pixels of the picture")
        for x in (2000, 500_000)
    ]
    rows.append(Row("growth photos, encode", "pixels of a photo", "x", {"x": 9}, note="out of memory"))
    _, _, *lines = [[word.strip() for word in line.split("|")[1:-1]] for line in growth_table(rows).splitlines()]
    assert [line[0].split()[0] for line in lines] == ["photos", "Gaussians", "pixels"]
    assert lines[0][1:3] == ["12", "1,000"] and lines[0][-1] == "1.25" and lines[1][1:3] == ["2,000", "500,000"]
    assert lines[1][-1] == lines[2][-1] == "1.00" and not growth_table([capture(4, 1)])
