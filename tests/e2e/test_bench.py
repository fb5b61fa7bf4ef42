"""A very small run of every ordinary study, the folder it leaves, and the command's answers to bad options."""

from dataclasses import replace
from pathlib import Path

import pytest
from console import fail
from measure.tiny_runs import rows_of, tiny_run
from scenes import tells

from tinysplat.commands.bench import measure_studies
from tinysplat.measure.pages import write_report
from tinysplat.measure.rows import Row, read_rows
from tinysplat.measure.studies.growth import capture_rows, cloud_rows, photo_rows


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("bench") / "report"
    run = tiny_run(root)
    measure_studies(run, ("formats",), quiet=True)
    run.options = replace(run.options, size=(32, 32))
    growth = (photo_rows(run, [(64, 64)]), capture_rows(run, [3]), cloud_rows(run, (500, 900), (32, 48)))
    for row in (row for rows in growth for row in rows):
        run.store.add(row)
    write_report(root, list(run.store), run.left_out)
    assert run.left_out == []
    return root


@pytest.fixture(scope="module")
def rows(folder: Path) -> list[Row]:
    return read_rows(folder)


def test_every_study_leaves_rows_that_have_figures_or_costs_or_say_why(rows: list[Row]) -> None:
    studied = {row.study.partition(",")[0] for row in rows}
    assert {"formats", "growth photos", "growth captures", "growth clouds", "run"} <= studied
    assert not [row for row in rows if not row.figures and not row.costs and not row.note]
    machine = next(row.figures for row in rows if row.study == "run")
    assert machine["onnxruntime"] and machine["cores"] >= 1


def test_two_runs_agree_in_everything_but_time(rows: list[Row], tmp_path: Path) -> None:
    again = {row.key: row.figures for row in rows_of("formats", tiny_run(tmp_path))}
    assert again == {row.key: row.figures for row in rows if row.key in again} and len(again) > 3


@pytest.mark.parametrize(
    ("arguments", "fault"), [(("/nowhere",), "/nowhere"), (("formats", "--model", "nonsense", "--quick"), "'nonsense'")]
)
def test_bad_options_are_one_line_and_status_2(tmp_path: Path, arguments: tuple[str, ...], fault: str) -> None:
    assert tells(fail("bench", "-q", "-o", tmp_path / "out", *arguments), fault)
