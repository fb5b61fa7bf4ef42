"""What plots draw: figures are taken before they are saved, and read off line by line."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from tinysplat.measure.rows import Row
from tinysplat.measure.show import plots
from tinysplat.measure.show.plots import Axis, Chart, Curve, Panel, save_grid, save_shares
from tinysplat_runtime.scene.images import read_image


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Figures in place of files."""
    figures: list[Figure] = []
    monkeypatch.setattr(plots, "_save", lambda path, figure: figures.append(figure))
    return figures


def row(way: str, x: float, y: float | None, subject: str = "a", **setting: Any) -> Row:
    return Row("s", subject, way, setting, {} if y is None else {"y": y}, {"seconds": x})


X, Y = Axis("seconds", "seconds", "costs"), Axis("y", "error")


def test_an_axis_is_a_mean_of_what_is_finite_and_at_most_so_much_in_its_unit() -> None:
    rows = [row("w", 1, 4.0), row("w", 2, math.inf), row("w", 3, 8.0), row("w", 4, None), row("w", 5, 9.0)]
    assert Y.of(rows) == 7 and X.of(rows) == 3 and Y.of(rows[3:4]) is None and Y.of(rows[1:2]) is None
    assert Axis("y", "", most=8).of(rows) == 6 and Axis("y", "", unit=1e-3, most=8.9).of(rows) == 6e-3
    assert Axis("y", "", most=3).of(rows) is None
    assert Axis("qp", "", "setting").of([row("w", 1, 1, qp=3), row("w", 1, 1, qp=6)]) == 4.5


def test_a_chart_has_a_panel_a_subject_a_curve_a_setting_and_points_by_way() -> None:
    rows = [
        row("b", 3, 30, network="edge"), row("a", 1, 10, network="edge"), row("a", 3, 14, network="edge"),
        row("a", 2, 5, network="sweep"), row("c", 2, None, network="sweep"), row("a", 2, None, "empty"),
        row("a", 7, 8, "other"), Row("t", "a", "w", figures={"y": 1.0}, costs={"seconds": 1.0}),
    ]  # fmt: skip
    chart = Chart("s", "Title", X, Y, panel="subject", curve="network", point="way", log="xy")
    panels = chart.panels(rows)
    assert [(p.title, p.x_label, p.y_label, p.level, p.log) for p in panels] == [
        ("a", "seconds", "error", None, "xy"), ("other", "seconds", "error", None, "xy"),
    ]  # fmt: skip
    edge, sweep = panels[0].curves
    assert (edge.name, list(edge.points), edge.is_line, list(edge.labels)) == ("edge", [(3, 30), (2, 12)], True, [])
    assert (sweep.name, list(sweep.points)) == ("sweep", [(2, 5)])
    marks = Chart("s", "", X, Y, curve="", point="way").panels(rows)
    assert len(marks) == 1 and marks[0].title == ""
    (curve,) = marks[0].curves
    assert not curve.is_line and list(curve.labels) == ["b", "a"] and curve.points[0] == (3, 30)


@pytest.mark.parametrize(("count", "named"), [(12, True), (13, False)])
def test_up_to_twelve_marks_are_named(count: int, named: bool) -> None:
    rows = [row(f"w{n}", n + 1, n + 1) for n in range(count)]
    (panel,) = Chart("s", "", X, Y, curve="", point="way").panels(rows)
    assert bool(panel.curves[0].labels) is named and len(panel.curves[0].points) == count


def test_nothing_is_drawn_of_no_rows(drawn: list[Figure], tmp_path: Path) -> None:
    assert not Chart("s", "", X, Y)(tmp_path / "p.png", [Row("t", "a", "w")]) and not drawn
    assert Chart("s", "T", X, Y, point="way")(tmp_path / "p.png", [row("w", 1, 2)]) and len(drawn) == 1


def test_panels_stand_in_rows_with_one_colour_a_name_and_a_legend_beside(drawn: list[Figure], tmp_path: Path) -> None:
    first = Panel("one", "x", "y", [
        Curve("a", [(3, 9), (1, 1), (2, 4)], slope_one=True), Curve("none", []),
        Curve("b", [(2, 5), (1, 7)], is_line=False, labels=["p", "q"]), Curve("", [(1, 2)], marks=False),
    ], level=6.0, log="")  # fmt: skip
    second = Panel("two", "u", "v", [Curve("b", [(1, 10), (20_000, 1000)])], log="xy")
    third = Panel("three", "u", "v", [Curve("a", [(2, 3), (9, 5)])])
    save_grid(tmp_path / "p.png", "Title", [[first, second], [third]])
    (figure,) = drawn
    assert figure.get_suptitle() == "Title" and tuple(figure.get_size_inches()) == pytest.approx((9.7, 6.9))
    one, two, three = figure.axes
    assert [axes.get_title() for axes in figure.axes] == ["one", "two", "three"]
    places = [axes.get_subplotspec().get_geometry() for axes in figure.axes]
    assert places == [(2, 2, 0, 0), (2, 2, 1, 1), (2, 2, 2, 2)]
    assert (one.get_xlabel(), one.get_ylabel(), two.get_xlabel()) == ("x", "y", "u")
    level, a, slope, b, unnamed = one.get_lines()
    assert list(level.get_ydata()) == [6, 6] and level.get_linestyle() == "--"
    assert (list(a.get_xdata()), list(a.get_ydata())) == ([1, 2, 3], [1, 4, 9])
    assert list(slope.get_ydata()) == [3, 6, 9] and slope.get_linestyle() == ":" and slope.get_color() == a.get_color()
    assert (list(b.get_xdata()), list(b.get_ydata())) == ([2, 1], [5, 7])
    assert [line.get_linewidth() for line in (a, b)] == [1.2, 0]
    assert [line.get_marker() for line in (a, b, unnamed)] == ["o", "s", ""]
    assert [line.get_color() for line in (a, b, unnamed)] == ["#1b6ca8", "#d1495b", "#2a9d54"]
    assert two.get_lines()[0].get_color() == "#d1495b" and three.get_lines()[0].get_color() == "#1b6ca8"
    assert [(note.get_text(), note.xy) for note in one.texts] == [("p", (2, 5)), ("q", (1, 7))]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["a", "b"]
    assert [(axes.get_xscale(), axes.get_yscale()) for axes in figure.axes] == [
        ("linear", "linear"), ("log", "log"), ("log", "linear"),
    ]  # fmt: skip


def test_logarithmic_axes_have_plain_numbers_at_1_2_and_5_where_decades_are_few(drawn: list[Figure], tmp_path) -> None:
    panels = [Panel("", "", "", [Curve("a", [(1, 1), (most, 2)])]) for most in (999, 1000)]
    save_grid(tmp_path / "p.png", "", [panels])
    few, many = (axes.xaxis for axes in drawn[0].axes)
    assert list(few.get_major_locator()._subs) == [1, 2, 5] and list(many.get_major_locator()._subs) == [1]
    write = few.get_major_formatter()
    assert [write(value, 0) for value in (0.002, 1, 9999, 10_000, 25_000)] == ["0.002", "1", "9999", "10k", "25k"]
    assert few.get_minor_formatter()(5, 0) == ""


def test_a_tenth_name_has_the_first_ones_colour_and_mark(drawn: list[Figure], tmp_path: Path) -> None:
    curves = [Curve(f"c{n}", [(1, n + 1), (2, n + 1)]) for n in range(10)]
    save_grid(tmp_path / "p.png", "", [[Panel("", "", "", curves, log="")]])
    lines = drawn[0].axes[0].get_lines()
    assert lines[9].get_color() == lines[0].get_color() and lines[9].get_marker() == lines[0].get_marker()
    assert len({line.get_color() for line in lines}) == len({line.get_marker() for line in lines}) == 9


def test_shares_are_bars_of_a_hundred_whose_larger_parts_are_named(drawn: list[Figure], tmp_path: Path) -> None:
    bars = {
        "decode": {"read file": 1.0, "network": 6.0, "small": 0.3, "rest": 2.7},
        "frame": {"blend": 4.0, "rest": 4.0},
    }
    save_shares(tmp_path / "p.png", "percent", bars, "rest")
    (figure,) = drawn
    (axes,) = figure.axes
    assert tuple(figure.get_size_inches()) == pytest.approx((13, 2.4))
    found = [(p.get_x(), p.get_width(), p.get_y() + p.get_height() / 2) for p in axes.patches]
    wanted = [(0, 10, 0), (10, 60, 0), (70, 3, 0), (73, 27, 0), (0, 50, 1), (50, 50, 1)]
    np.testing.assert_allclose(found, wanted)
    assert [(text.get_text(), text.get_position()[1]) for text in axes.texts] == [
        ("read file\n1", 0), ("network\n6", 0), ("rest\n2.7", 0), ("blend\n4", 1), ("rest\n4", 1),
    ]  # fmt: skip
    assert [text.get_position()[0] for text in axes.texts] == pytest.approx([5, 40, 86.5, 25, 75])
    assert [label.get_text() for label in axes.get_yticklabels()] == ["decode\n10", "frame\n8"]
    assert axes.get_xlim() == (0, 100) and axes.yaxis_inverted() and axes.get_xlabel() == "percent"
    colours = [patch.get_facecolor() for patch in axes.patches]
    assert colours[3] == colours[5] and len(set(colours[:4])) == 4 and colours[4] == colours[0]
    from matplotlib import colormaps

    assert colours[:3] == [colormaps["tab20"](n) for n in (0, 2, 4)]


def test_a_narrow_part_has_its_words_below_each_other(drawn: list[Figure], tmp_path: Path) -> None:
    save_shares(tmp_path / "p.png", "", {"x": {"ab cd": 4.5, "ef gh": 4.4, "tiny": 3.9, "rest": 87.2}}, "rest")
    assert [text.get_text() for text in drawn[0].axes[0].texts] == ["ab cd\n4.5", "ef\ngh\n4.4", "rest\n87.2"]


def test_a_plot_is_a_picture_of_100_dots_an_inch(tmp_path: Path) -> None:
    save_grid(tmp_path / "new" / "p.png", "T", [[Panel("", "", "", [Curve("a", [(1, 1)])])]])
    assert read_image(tmp_path / "new" / "p.png").shape[:2] == (360, 580)
