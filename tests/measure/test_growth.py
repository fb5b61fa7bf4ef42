"""How costs grow, in tables and in words."""

from __future__ import annotations

from measure.tiny_runs import shows

from tinysplat.measure.rows import Row
from tinysplat.measure.studies.growth import growth_table


def captures(power: float) -> list[Row]:
    made = []
    for photos in (1000, 200, 48):
        costs = {"seconds": 0.1 * photos, "cpu": 0.2 * photos**power, "peak_bytes": 300_000_000}
        made.append(Row("growth captures", "photos", f"{photos}x64x48", {"x": photos}, {"bytes": 3000 * photos}, costs))
    return made


def test_each_axis_has_a_line_with_its_ends_and_its_power() -> None:
    rows = captures(1.25)
    rows += [
        Row("growth clouds, compiled", axis, f"{x}", {"x": x}, {}, {"seconds": 1e-6 * x, "peak_bytes": 5_000_000})
        for axis in ("Gaussians", "pixels of the picture")
        for x in (2000, 500_000)
    ]
    rows.append(Row("growth photos, encode", "pixels of a photo", "x", {"x": 9}, note="out of memory"))
    lines = growth_table(rows).splitlines()
    for told, count in (((48, 1000, 1.25), 1), ((2000, 500_000, 1.0), 2), ((9,), 0)):
        assert sum(all(shows(line, one) for one in told) for line in lines) == count, told
    assert not growth_table(captures(1)[:1])
