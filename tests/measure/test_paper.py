"""The paper's tables: printed figures beside measured ones."""

from __future__ import annotations

import json

import pytest
from datasets.chunks import make_chunk_scene, write_chunks
from measure.evaluation_scenes import NEAR_WINDOW, write_eval_scene
from measure.tiny_runs import rows_of, tiny_run
from scenes import make_smooth_gaussians

from tinysplat.measure.studies.paper import BITS, bits_table, elsewhere_table, main_table, time_table, views_table
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import save_gaussians

# ---- printed figures ---------------------------------------------------------------------------------------------


def test_printed_shares_add_up_as_the_paper_rounds_them():
    assert all(99.5 < sum(shares.values()) < 100.5 for _, shares in BITS.values())


# ---- studies -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Rows of a scene of two, four and six views and of a Gaussian file, with the folder."""
    folder = tmp_path_factory.mktemp("paper")
    multi = [{"kind": "multi", "context": list(range(n)), "target": [1]} for n in (4, 6)]
    scene = write_eval_scene(folder / "plane", [NEAR_WINDOW, *multi], frames=6)
    save_gaussians(folder / "made.npz", make_smooth_gaussians(height=24, width=32, degree=2))
    run = tiny_run(folder, scene, folder / "made.npz", models=("sweep",), rounds=1)
    run.quick = False
    return rows_of("paper", run), folder


def lines(table: str) -> dict[tuple[str, ...], list[str]]:
    split = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line[:1] == "|"]
    return {tuple(line[:3]): line[3:] for line in split}


def test_the_main_table_has_the_papers_rows_and_ours(measured):
    found = lines(main_table(measured[0]))
    assert found["network", "codec", "by"] == ["RE10K", "ACID", "scenes"]
    assert found["MVSplat", "TinySplat", "printed"][0] == "26.32 / 0.8671 / 0.1349 / 0.216"
    assert found["sweep", "balanced", "here"][:2] == ["–", "–"] and "/" in found["sweep", "raw", "here"][2]
    assert "†" in found["made", "paper", "here"][2]


def test_views_bits_and_times_stand_beside_the_printed_ones(measured):
    text = views_table(measured[0])
    assert all(f"| {views} DepthSplat" in text and f"| {views} sweep" in text for views in (2, 4, 6))
    ours = {key: cells for key, cells in lines(bits_table(measured[0])).items() if key[2] == "here"}
    assert [key[0] for key in ours if key[1] == "paper, made, scenes"] == ["0", "3", "6", "12"]
    assert all(sum(map(float, cells[1:])) == pytest.approx(100, abs=0.3) for cells in ours.values())
    assert "164.63" in bits_table(measured[0])
    times = time_table(measured[0])
    assert "1.016" in times and "| balanced" in times and "medians over windows" in times
    assert "quoted, not measured here" in elsewhere_table(measured[0]) and elsewhere_table([]) == ""


def test_a_data_set_has_its_own_column_and_networks(tmp_path):
    chunks = write_chunks(tmp_path / "acid", [[make_chunk_scene("k")]])
    (tmp_path / "acid.json").write_text(json.dumps({"k": {"context": [0, 2], "target": [1]}}))
    data = (("acid", str(chunks), str(tmp_path / "acid.json")),)
    models = ("acid:sweep", "re10k:edge")
    run = tiny_run(tmp_path, data=data, near=2.0, far=8.0, profiles=("fast",), views=(2,), models=models)
    found = lines(main_table(rows_of("paper", run)))
    assert found["sweep", "fast", "here"][0] == "–" and "/" in found["sweep", "fast", "here"][1]


def test_nothing_to_measure_is_said_in_a_line(tmp_path):
    with pytest.raises(InputError, match="give INPUT or --data"):
        rows_of("paper", tiny_run(tmp_path))
    with pytest.raises(InputError, match="accepted are re10k"):
        rows_of("paper", tiny_run(tmp_path, data=(("kitti", "a", "b"),)))


def test_weights_of_lpips_that_were_named_must_exist(measured, tmp_path):
    run = tiny_run(tmp_path, measured[1] / "made.npz", lpips_backbone=tmp_path / "missing.pth")
    with pytest.raises(InputError, match=r"missing\.pth: no such file"):
        rows_of("paper", run)
