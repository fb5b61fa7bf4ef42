"""A very small run of every ordinary study, the folder it leaves, and the command's answers to bad options."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from console import fail
from measure.tiny_runs import rows_of, tiny_run

from tinysplat.commands.bench import measure_studies, split_words
from tinysplat.measure.rows import Row, read_rows
from tinysplat.measure.show.pages import write_report
from tinysplat.measure.studies import ORDINARY, STUDIES, drawing, graphs, growth, rate
from tinysplat_runtime.errors import InputError

STUDIED = {
    *("chain", "transforms", "encode", "decode", "cold start", "rasteriser", "rasteriser approximations"),
    *("k", "component bits", "SH degree", "peers encode", "peers decode", "growth plane", "growth network"),
    *("growth encode", "growth decode", "growth render", "growth photos", "growth captures", "growth clouds"),
    *("parts", "run"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("bench") / "report"
    with pytest.MonkeyPatch.context() as patch:
        for module, name, value in (
            (graphs, "QUICK_CHAIN_SIDES", (32,)), (rate, "QUICK_SOG_LIMIT_S", 0.1),
            (drawing, "QUICK_SIZES", (16,)), (drawing, "QUICK_COUNTS", (512,)), (drawing, "QUICK_COUNT", 512),
            (growth, "SIDES", ((16, 16), (32, 32))), (growth, "PICTURES", ((16, 16), (32, 32))),
            (growth, "PHOTO_SIZES", ((64, 64), (96, 64), (640, 512))),
            (growth, "COUNT_SIDES", (16, 32)), (growth, "QUICK_SIDE", 16),
            (growth, "CAPTURES", (7, 12)), (growth, "CAPTURE_PHOTOS", 6), (growth, "CAPTURE_SIDE", 32),
            (growth, "CLOUDS", (500, 900)), (growth, "CLOUD_PICTURES", ((16, 16), (32, 48))),
        ):  # fmt: skip
            patch.setattr(module, name, value)
        run = tiny_run(root, rounds=1)
        measure_studies(run, (*ORDINARY, "parts"), quiet=True)
        write_report(root, list(run.store), run.left_out)
        assert run.left_out == []
    return root


@pytest.fixture(scope="module")
def rows(folder: Path) -> list[Row]:
    return read_rows(folder)


def test_every_study_leaves_rows_that_have_figures_or_costs_or_say_why(rows: list[Row]) -> None:
    assert {row.study.partition(",")[0] for row in rows} >= STUDIED
    assert not [row for row in rows if not row.figures and not row.costs and not row.note]
    machine = next(row.figures for row in rows if row.study == "run")
    assert machine["onnxruntime"] and machine["cores"] >= 1


def test_the_codec_is_held_against_the_libraries_alone(rows: list[Row]) -> None:
    for study, library in (("encode", "libx265 alone"), ("decode", "libavcodec alone")):
        found = [row for row in rows if row.study == study]
        assert found and all(row.setting["baseline"] == library and row.costs["ratio"] > 0 for row in found)


def test_stages_of_large_photos_are_weighed(rows: list[Row]) -> None:
    peaks = {
        (row.study, row.way): row.costs.get("peak_bytes") for row in rows if row.study.startswith("growth photos, e")
    }
    whole = {way: peak for (study, way), peak in peaks.items() if study == "growth photos, encode"}
    assert whole and all(peak > 50e6 for peak in peaks.values())
    assert all(peak <= whole[way] for (_, way), peak in peaks.items())
    assert any(study.endswith(": x265") for study, _ in peaks)


def test_transforms_agree_with_float64(rows: list[Row]) -> None:
    errors = {(row.subject, row.way): row.figures["max_relative_error"] for row in rows if row.study == "transforms"}
    assert len({subject for subject, _ in errors}) == len(graphs.GRAPHS) and max(errors.values()) < 1e-3


def test_the_report_shows_every_plot_that_it_embeds(folder: Path) -> None:
    text = (folder / "report.md").read_text()
    plots = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text)
    assert {"plots/growth.png", "plots/encode.png", "plots/parts.png"} <= set(plots)
    assert all(1000 < (folder / plot).stat().st_size < 400_000 for plot in plots)
    assert "in proportion" in text


def test_two_runs_agree_in_everything_but_time(rows: list[Row], tmp_path: Path) -> None:
    again = {row.key: row.figures for row in rows_of("reduction", tiny_run(tmp_path, rounds=1))}
    assert again == {row.key: row.figures for row in rows if row.key in again} and len(again) > 3


def test_words_are_studies_and_then_inputs(tmp_path: Path) -> None:
    assert split_words([]) == (ORDINARY, [])
    assert split_words(["codec", "peers", str(tmp_path)]) == (("codec", "peers"), [str(tmp_path)])
    with pytest.raises(InputError, match="neither a study"):
        split_words([str(tmp_path), "codec"])
    assert set(ORDINARY) < set(STUDIES)


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (("codec", "--against", "/nowhere"), "/nowhere"),
        (("/nowhere",), "/nowhere: neither a study"),
        (("codec", "--model", "nonsense", "--quick"), "nonsense"),
    ],
)
def test_bad_options_are_one_line_and_status_2(tmp_path: Path, arguments: tuple[str, ...], fault: str) -> None:
    assert fault in fail("bench", "-q", "-o", tmp_path / "out", *arguments)
