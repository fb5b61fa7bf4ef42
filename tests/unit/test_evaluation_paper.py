"""The paper's tables and figures: printed figures beside measured ones, and ablations that change what they say."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chunks import make_chunk_scene, write_chunks
from evaluation_scenes import NEAR_WINDOW, write_eval_scene
from PIL import Image
from scenes import make_smooth_gaussians

from benchmarks import paper
from tinysplat.evaluation.ablation import (
    component_bytes,
    paper_variant,
    smoothness,
    vpt_channels,
    without_vabr,
    without_vpt,
)
from tinysplat.evaluation.paper_tables import network_name, time_codings
from tinysplat.evaluation.published import BITS, MAIN, VIEWS
from tinysplat.measure.metrics import attribute_errors
from tinysplat_runtime.api import DEFAULT_MODEL, Runtime
from tinysplat_runtime.formats.table import save_gaussians

FINE = -30.0


@pytest.fixture(scope="module")
def runtime() -> Runtime:
    return Runtime(threads=1)


@pytest.fixture(scope="module")
def gaussians():
    return make_smooth_gaussians(height=24, width=32, degree=2, layers=2)


# ---- ablations ---------------------------------------------------------------------------------------------------


def test_the_paper_variant_is_the_real_codec(gaussians, runtime):
    variant = paper_variant(gaussians, 3, runtime)
    data = runtime.compress(gaussians, "paper", 3)
    assert variant.bytes == len(data)
    np.testing.assert_array_equal(variant.gaussians.sh, runtime.decompress(data).sh)


def test_more_components_cost_more_and_lose_less(gaussians, runtime):
    few, many = (paper_variant(gaussians, 0, runtime, k=k) for k in (2, 12))
    assert few.bytes < many.bytes
    errors = [attribute_errors(gaussians, variant.gaussians)["sh"]["rmse"] for variant in (few, many)]
    assert errors[1] < errors[0]


def test_components_come_with_their_bytes_and_degree_0_has_none(gaussians, runtime):
    sizes = component_bytes(gaussians, 0, runtime, 6)
    assert len(sizes) == 6 and sizes[0] > sizes[5] > 0
    assert component_bytes(make_smooth_gaussians(degree=0), 0, runtime, 6) == []


@pytest.mark.parametrize("make", [without_vpt, without_vabr])
def test_ablations_replace_one_part_and_keep_the_rest(gaussians, runtime, make):
    real, ablated = paper_variant(gaussians, 0, runtime), make(gaussians, 0, runtime)
    replaced = {"depth", "offset", "scale", "rotation"} if make is without_vpt else {"color"}
    for name, size in real.bytes_by_class.items():
        assert (ablated.bytes_by_class[name] == size) == (name not in replaced)
    kept = ("sh", "opacities") if make is without_vpt else ("means", "quats", "scales", "opacities")
    for a, b in zip(real.gaussians.layers, ablated.gaussians.layers, strict=True):
        assert all(np.array_equal(getattr(a, name), getattr(b, name)) for name in kept)
    planes = sum(ablated.bytes_by_class.values()) - sum(real.bytes_by_class.values())
    basis = 0 if make is without_vpt else 2 * 27 * 6  # float16, layer 0's alone: layer 1 is of degree 0
    assert ablated.bytes == real.bytes + planes - basis


def test_ablations_return_the_gaussians_at_fine_steps(gaussians, runtime):
    world = attribute_errors(gaussians, without_vpt(gaussians, FINE, runtime).gaussians)
    # Codes have 12 bits: the planes span about 4 scene units, 1e-3 a code, and QP 0 steps over ten of them.
    assert world["means"]["rmse"] < 5e-3 and world["quats"]["rmse"] < 0.5 and world["scales"]["rmse"] < 1e-4
    assert attribute_errors(gaussians, without_vabr(gaussians, FINE, runtime).gaussians)["sh"]["rmse"] < 5e-3


def test_the_first_raw_coefficients_leave_the_others_zero(gaussians, runtime):
    sh = without_vabr(gaussians, 0, runtime, k=6).gaussians.sh
    flat = sh.reshape(*sh.shape[:3], -1)
    assert flat[..., :6].any() and not flat[..., 6:].any()


def test_constant_attributes_survive_without_planes(runtime):
    flat = make_smooth_gaussians(degree=0)
    flat = replace(
        flat, scales=np.full_like(flat.scales, 0.02), quats=np.broadcast_to([1.0, 0, 0, 0], flat.quats.shape)
    )
    variant = without_vpt(flat, 0, runtime)
    assert variant.bytes_by_class["scale"] == variant.bytes_by_class["rotation"] == 0
    np.testing.assert_allclose(variant.gaussians.scales, 0.02, rtol=1e-6)


def test_vpt_channels_are_the_positions_and_scales_on_either_side(gaussians, runtime):
    groups = vpt_channels(gaussians, runtime.store)
    np.testing.assert_array_equal(groups["position before"]["z"], gaussians.means[..., 2])
    depth = groups["position after"]["depth"]
    focal = np.array([camera.focal for camera in gaussians.cameras])[:, None, None]
    np.testing.assert_allclose(groups["scale after"]["ŝ1"], focal * gaussians.scales[..., 0] / depth, rtol=1e-4)


def test_smoothness_tells_ramps_from_noise():
    ramp = np.broadcast_to(np.arange(32.0), (1, 32, 32)) + np.arange(32.0)[:, None]
    assert smoothness(ramp) == pytest.approx(1)
    assert abs(smoothness(np.random.default_rng(0).normal(size=(1, 64, 64)))) < 0.1
    assert smoothness(np.zeros((1, 4, 4))) == 1


def test_times_are_taken_in_turns_and_name_every_stage(gaussians, runtime):
    times = time_codings(gaussians, ("paper", "fast"), 2, runtime)
    for seconds in times.values():
        assert {"vpt", "vabr", "quantise", "x265", "write", "parse", "libavcodec", "synthesis"} == set(seconds)


# ---- printed figures ---------------------------------------------------------------------------------------------


def test_printed_shares_add_up_as_the_paper_rounds_them():
    assert all(99.5 < sum(shares.values()) < 100.5 for _, shares in BITS.values())


def test_printed_tables_have_every_cell():
    assert all(set(codecs) == {"raw", "FCGS", "TinySplat"} for codecs in (*MAIN.values(), *VIEWS.values()))
    assert all(set(cells) == {"re10k", "acid"} for codecs in MAIN.values() for cells in codecs.values())


def test_networks_go_by_the_papers_names():
    assert network_name("exports/mvsplat_re10k.onnx") == "MVSplat"
    assert network_name("depthsplat-base") == "DepthSplat"
    assert network_name("sweep") == "sweep"


# ---- commands ----------------------------------------------------------------------------------------------------


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run benchmarks/paper.py here; returns what it printed and its folder of results."""

    def call(*arguments: object, status: int = 0) -> tuple[str, str, Path]:
        folder = tmp_path / "out"
        options = [*arguments, "-o", folder, "-q", "--threads", 1, "--size", "48x64"]
        monkeypatch.setattr(sys, "argv", ["paper.py", *map(str, options)])
        assert paper.main() == status
        printed = capsys.readouterr()
        return printed.out, printed.err, folder

    return call


@pytest.fixture(scope="module")
def inputs(tmp_path_factory) -> tuple[Path, Path]:
    """A scene folder and a Gaussian file."""
    folder = tmp_path_factory.mktemp("inputs")
    multi = [{"kind": "multi", "context": list(range(n)), "target": [1]} for n in (4, 6)]
    scene = write_eval_scene(folder / "plane", [NEAR_WINDOW, *multi], frames=6)
    save_gaussians(folder / "made.npz", make_smooth_gaussians(height=24, width=32, degree=2))
    return scene, folder / "made.npz"


def test_table_main_prints_the_papers_rows_and_ours(run, inputs):
    text, _, folder = run("table-main", *inputs)
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]
    assert rows[0] == ["network", "codec", "by", "RE10K", "ACID", "scenes"]
    printed = {tuple(row[:3]): row[3:] for row in rows[2:]}
    assert printed["MVSplat", "TinySplat", "printed"][0] == "26.32 / 0.8671 / 0.1349 / 0.216"
    assert (
        printed[DEFAULT_MODEL, "balanced", "here"][:2] == ["–", "–"] and "/" in printed[DEFAULT_MODEL, "raw", "here"][2]
    )
    assert "†" in printed["made", "paper", "here"][2]
    assert (folder / "table-main.md").read_text() == text


def test_table_main_puts_a_data_set_under_its_own_column(run, tmp_path):
    chunks = write_chunks(tmp_path / "acid", [[make_chunk_scene("k")]])
    (tmp_path / "acid.json").write_text(json.dumps({"k": {"context": [0, 2], "target": [1]}}))
    text, _, _ = run(
        "table-main", "--data", "acid", chunks, tmp_path / "acid.json", "--near", 2, "--far", 8, "--profile", "fast",
        "--model", "acid:sweep",
    )  # fmt: skip
    (line,) = (line for line in text.splitlines() if line.startswith("| sweep") and " fast " in line)
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[3] == "–" and "/" in cells[4] and len(cells) == 5


def test_table_views_has_two_four_and_six(run, inputs):
    text, _, _ = run("table-views", inputs[0], "--profile", "fast")
    for views in (2, 4, 6):
        assert f"| {views} DepthSplat" in text and f"| {views} {DEFAULT_MODEL}" in text


def test_table_bits_and_table_time_stand_beside_the_printed_ones(run, inputs):
    bits, _, _ = run("table-bits", inputs[1], "--profile", "paper")
    rows = [line.split("|") for line in bits.splitlines() if "here" in line]
    assert [row[1].strip() for row in rows] == ["0", "3", "6", "12"] and "164.63" in bits
    assert all(sum(map(float, row[5:10])) == pytest.approx(100, abs=0.3) for row in rows)
    times, _, _ = run("table-time", inputs[1], "--rounds", 1)
    assert "1.016" in times and "| balanced" in times and "1 CPU threads" in times


def test_figures_leave_pictures_and_the_numbers_behind_them(run, inputs):
    for what, pictures in (
        ("fig-vpt", ["fig-vpt-made-file-0_1.png"]),
        ("fig-k", ["fig-k-made-file-0_1.png"]),
        ("fig-ablation", ["fig-ablation.png"]),
        ("fig-rd", ["fig-rd.png"]),
    ):
        options = ["--qp=0,12"] if what in ("fig-ablation", "fig-rd") else []
        text, _, folder = run(what, inputs[1], *options)
        assert "| " in text and (folder / f"{what}.md").read_text() == text
        for name in pictures:
            with Image.open(folder / name) as image:
                assert image.width > 300


def test_figures_and_bits_go_by_number_of_views(run, inputs):
    text, _, folder = run("fig-ablation", *inputs, "--views", "2,4", "--model", "sweep", "--qp=0,12")
    two, four = text.split("4 views. ")
    assert two.startswith("2 views. ") and "paper" in four and two.splitlines()[4:] != four.splitlines()[4:]
    assert (folder / "2-views" / "fig-ablation.png").is_file() and (folder / "4-views" / "fig-ablation.png").is_file()
    bits, _, _ = run("table-bits", inputs[0], "--views", "4", "--model", "sweep", "--profile", "paper")
    assert "4 views. Share" in bits and bits.count(" here ") == 4


def test_fig_k_passes_over_gaussians_without_view_dependence(run, inputs):
    _, said, _ = run("fig-k", inputs[0], status=2)
    assert "SH degree 0 has no components" in said and "no window to measure" in said


def test_nothing_to_measure_is_said_in_a_line(run, tmp_path):
    assert "give SCENES or --data" in run("table-main", status=2)[1]
    _, said, _ = run("table-main", tmp_path / "missing", status=2)
    assert "no such folder" in said
    assert "accepted are re10k" in run("table-main", "--data", "kitti", tmp_path, tmp_path, status=2)[1]
