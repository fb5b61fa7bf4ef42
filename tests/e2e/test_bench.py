"""A very small run of every section, the folder it leaves, and the command's answers to bad options."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from tinysplat.bench.growth import Axes
from tinysplat.bench.report import write_report
from tinysplat.bench.run import compared, run_bench
from tinysplat.bench.sections import QUICK, SECTIONS, Bench
from tinysplat.bench.timing import Effort
from tinysplat_runtime.api import Runtime

SCRIPT = Path(sys.executable).with_name("tinysplat")

TINY = replace(
    QUICK,
    name="tiny",
    effort=Effort(rounds=1, budget_s=0, least=1),
    size=32,
    network_sizes=(32,),
    chain_sizes=(32,),
    presets=QUICK.presets[:1],
    sizes=(16,),
    counts=(512,),
    count=512,
    ks=(1, 6),
    codings=QUICK.codings[:1],
    axes=Axes(
        views=(1, 2),
        view_size=(16, 16),
        pixels=((16, 16), (32, 32)),
        gaussians=(512, 2048),
        picture=(16, 16),
        network_views=(2, 3),
        memory_axes=("views",),
    ),
    sog_limit_s=0.1,
)

STAGES = {
    *("chain", "network", "analysis_vpt", "analysis_moment", "analysis_project", "synthesis", "encode", "preset"),
    *(
        "decode",
        "cold start",
        "rasteriser",
        "rasteriser approximations",
        "k",
        "SH degree",
        "peers encode",
        "peers decode",
    ),
    *("torch rasteriser", "growth plane", "growth network", "growth encode", "growth decode", "growth render"),
}


def make_bench() -> Bench:
    return Bench(TINY, Runtime(threads=2), models=["sweep"])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("bench") / "report"
    write_report(root, run_bench(make_bench(), tuple(SECTIONS), quiet=True))
    return root


@pytest.fixture(scope="module")
def document(folder: Path) -> dict:
    return json.loads((folder / "report.json").read_text())


def test_every_stage_is_in_the_report_with_seconds_and_machine(document: dict) -> None:
    assert document["left_out"] == []
    assert {row["stage"] for row in document["rows"] if "seconds" in row} == STAGES
    assert document["machine"]["packages"]["onnxruntime"]
    assert document["machine"]["cores_available"] >= 1


def test_rows_without_seconds_say_why(document: dict) -> None:
    silent = [row for row in document["rows"] if "seconds" not in row and not row.get("note")]
    assert silent == []


def test_the_codec_is_held_against_the_libraries_alone(document: dict) -> None:
    for stage, library in (("encode", "libx265 alone"), ("decode", "libavcodec alone")):
        rows = [row for row in document["rows"] if row["stage"] == stage]
        assert all(row["baseline"][0] == library and row["ratio"] > 0 for row in rows)


def test_transforms_agree_with_float64(document: dict) -> None:
    for stage in ("analysis_vpt", "analysis_moment", "analysis_project", "synthesis"):
        rows = [row for row in document["rows"] if row["stage"] == stage]
        assert max(row["figures"]["max_relative_error"] for row in rows) < 1e-3, stage


def test_growth_has_a_slope_and_a_sentence_per_axis(document: dict) -> None:
    fits = {(fit["stage"], fit["axis"], fit["cost"]) for fit in document["growth"] if fit["sentence"]}
    assert {("growth encode", axis, "seconds") for axis in ("views", "pixels")} <= fits
    assert ("growth render", "Gaussians", "seconds") in fits
    assert ("growth decode", "views", "peak memory") in fits


def test_every_plot_that_the_text_embeds_is_there_and_small(folder: Path) -> None:
    text = (folder / "report.md").read_text()
    plots = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text)
    assert "plots/overview.png" in plots
    assert "plots/growth.png" in plots
    for plot in plots:
        assert 1000 < (folder / plot).stat().st_size < 400_000
    assert "quoted, not measured here" in text


def test_two_runs_agree_in_everything_but_time(folder: Path, tmp_path: Path) -> None:
    stages = ("transforms", "codec", "rasteriser", "reduction")
    report = run_bench(make_bench(), stages, quiet=True)
    path = write_report(tmp_path, compared(report, folder))
    text = path.read_text()
    assert "## Against the earlier run" in text
    (rows,) = re.findall(r"(\d+) rows are in both reports", text)
    assert int(rows) == len(report.rows)
    assert "0 differ" in text, text


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (("--stages", "codec,nonsense"), "'nonsense', expected some of chain"),
        (("--against", "/nowhere"), "/nowhere"),
        (("/nowhere",), "/nowhere: no such"),
        (("--model", "nonsense", "--quick", "--stages", "codec"), "nonsense"),
    ],
)
def test_bad_options_are_one_line_and_status_2(tmp_path: Path, arguments: tuple[str, ...], fault: str) -> None:
    command = [str(SCRIPT), "bench", "-o", str(tmp_path / "out"), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert fault in done.stderr
