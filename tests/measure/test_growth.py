"""What the study of growth measures: its points, what each way does at one, and what tables say of rows."""

from __future__ import annotations

from tinysplat.measure.rows import Row
from tinysplat.measure.studies.growth import photo_line, point_table, slope_table


def row(study: str, axis: str, x: float, seconds: float, way: str = "w", **costs: float) -> Row:
    return Row(study, axis, way, {"x": x}, {}, {"seconds": seconds, **costs})


def test_tables_have_a_line_a_task_and_axis_and_a_slope_a_cost() -> None:
    rows = [
        row("growth a", "views", 1, 0.5, peak_bytes=2e6, cpu=1.0), row("growth a", "views", 2, 1.0, cpu=4.0),
        row("growth b, numpy", "pixels", 1000, 3e-5), Row("growth a", "views", "w", note="no"), row("other", "x", 1, 1),
    ]  # fmt: skip
    lines = [line.strip("|").split("|") for line in point_table(rows).splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line] for line in lines]
    assert cells[0] == ["", "axis", "points", "seconds", "peak memory"]
    assert cells[2:] == [
        ["a", "views", "1, 2", "500.0 ms, 1.00 s", "2 MB"],
        ["b, numpy", "pixels", "1,000", "30 µs", ""],
    ]
    slopes = [[cell.strip() for cell in line.strip("|").split("|")] for line in slope_table(rows).splitlines()[2:]]
    assert [line[:4] for line in slopes] == [["a", "views", "seconds", "1.00"], ["a", "views", "CPU seconds", "2.00"]]
    assert slopes[0][4] == "in proportion over the whole range (0 µs + 500.0 ms for every view)"
    assert slope_table(rows[:1]) == point_table([]) == slope_table([]) == ""


def test_the_largest_photos_are_told_in_a_sentence() -> None:
    rows = [
        row("growth photos, encode", "pixels", 20, 2.0, "2x4x5", peak_bytes=3e6),
        row("growth photos, encode", "pixels", 6, 1.0, "2x2x3", peak_bytes=1e6),
        row("growth photos, encode: network", "pixels", 20, 9.0, "2x4x5"),
    ]
    assert photo_line(rows) == "Two photos of 5×4, all pixels kept: a file 2.00 s and 3 MB."
    drawn = row("growth photos, render", "pixels", 20, 0.5, "2x4x5", peak_bytes=4e6)
    both = "Two photos of 5×4, all pixels kept: a file 2.00 s and 3 MB, a picture of it 500.0 ms and 4 MB."
    assert photo_line([*rows, drawn]) == both and photo_line([]) == ""
