"""`tinysplat eval` and `compare` as a user meets them: bad scenes among good ones, killed runs, jobs, pictures."""

import json
import subprocess
from pathlib import Path

import pytest
from console import tinysplat
from datasets.chunks import make_chunk_scene, write_chunks
from measure.evaluation_scenes import NEAR_WINDOW, WIDE_WINDOW, plane_photo, write_eval_scene
from scenes import tells

from tinysplat_runtime.api import DEFAULT_MODEL
from tinysplat_runtime.scene.pictures import write_png

OPTIONS = ("--size", "64x48", "--lpips", "none", "--threads", "1")


def run(name: str, *arguments: object, status: int = 0) -> subprocess.CompletedProcess[str]:
    done = tinysplat(name, *arguments)
    assert done.returncode == status, (done.returncode, done.stdout, done.stderr)
    assert "Traceback" not in done.stderr
    return done


def figures(path: Path) -> list[dict]:
    """Everything in a results file that two runs must agree on."""
    return [{k: v for k, v in entry.items() if k != "seconds"} for entry in json.loads(path.read_text())["scenes"]]


@pytest.fixture(scope="module")
def scenes(tmp_path_factory) -> Path:
    """Three good scenes of two windows each."""
    folder = tmp_path_factory.mktemp("scenes")
    for name in ("one", "three", "two"):
        write_eval_scene(folder / name, [NEAR_WINDOW, WIDE_WINDOW])
    return folder


@pytest.fixture(scope="module")
def finished(scenes, tmp_path_factory) -> Path:
    """The results of an undisturbed run."""
    folder = tmp_path_factory.mktemp("finished")
    run("eval", scenes, "-o", folder, "--profile", "paper,fast", *OPTIONS, "-q")
    return folder / "results.json"


def test_a_run_prints_tables_and_writes_what_was_asked_for(scenes, tmp_path):
    done = run(
        "eval", scenes / "one", "-o", tmp_path / "r", "--kind", "near", "--json", tmp_path / "r.json",
        "--size", "64x48", "--lpips-linear", scenes / "one" / "0.png",
    )  # fmt: skip
    assert tells(done.stdout, f"{DEFAULT_MODEL} 64x48 LPIPS")
    (entry,) = json.loads((tmp_path / "r.json").read_text())["scenes"]
    assert entry["scene"] == "one" and entry["lpips"] is None and entry["psnr"] > entry["psnr_photo"]


def test_bad_scenes_cost_a_line_each_and_the_others_still_run(tmp_path):
    scenes = tmp_path / "scenes"
    write_eval_scene(scenes / "good")
    write_eval_scene(scenes / "no_frame", [{**NEAR_WINDOW, "target": [7]}])
    write_eval_scene(scenes / "no_target", [{**NEAR_WINDOW, "target": []}])
    write_eval_scene(scenes / "mixed")
    write_png(scenes / "mixed" / "2.png", plane_photo(0)[:40])
    chunks = write_chunks(tmp_path / "chunks", [[make_chunk_scene("fine")], [make_chunk_scene("torn", 2)]])
    (chunks / "000001.torch").write_bytes(b"torn")
    window = {"context": [0, 2], "target": [1]}
    (tmp_path / "index.json").write_text(json.dumps({"fine": window, "torn": window}))
    done = run(
        "eval", scenes, chunks, tmp_path / "missing", "--index", tmp_path / "index.json", "--near", 2, "--far", 8,
        "-o", tmp_path / "r", *OPTIONS,
    )  # fmt: skip
    lines = done.stderr.splitlines()
    for said in ("no_frame", "frame 7", "no_target", "64x40", "000001.torch", str(tmp_path / "missing")):
        assert sum(said in line for line in lines) == 1, (said, lines)
    assert len(lines) == 5
    document = json.loads((tmp_path / "r" / "results.json").read_text())
    assert [entry["scene"] for entry in document["scenes"]] == ["good", "fine"]
    assert len(document["left_out"]) == 5


def test_nothing_but_bad_scenes_is_an_error(tmp_path):
    scene = write_eval_scene(tmp_path / "bad", [{**NEAR_WINDOW, "context": [0, 9]}])
    done = run("eval", scene, "-o", tmp_path / "r", *OPTIONS, status=2)
    assert "frame 9" in done.stderr


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--profile", "huge"), "huge"),
        (("--model", "nerf"), "'nerf'"),
        (("--jobs", 0), "--jobs"),
        (("--qp", "a"), "--qp"),
        (("--lpips-backbone", "missing.pth"), "missing.pth"),
    ],
)
def test_wrong_options_are_refused_in_a_line(scenes, tmp_path, options, said):
    done = run("eval", scenes / "one", "-o", tmp_path / "r", *options, status=2)
    assert said in done.stderr and done.stderr.count("\n") == 1


def test_two_runs_agree_whatever_their_jobs(scenes, finished, tmp_path):
    run("eval", scenes, "-o", tmp_path, "--profile", "paper,fast", "--jobs", 2, *OPTIONS, "-q")
    assert figures(tmp_path / "results.json") == figures(finished)


def test_compare_takes_files_of_gaussians_and_pictures(tmp_path):
    scene = write_eval_scene(tmp_path / "plane")
    raw, coded = tmp_path / "raw.npz", tmp_path / "coded.tsplat"
    run("encode", scene, "--views", "0,3", "-o", coded, "--save-gaussians", raw, "-q")
    run("convert", coded, "-o", tmp_path / "c.spz", "-q")
    for a, b, rows in ((raw, coded, 3), (coded, tmp_path / "c.spz", 3), (scene / "0.png", scene / "1.png", 1)):
        run("compare", a, b, "-o", tmp_path / "sheets", "-q")
        sheet = json.loads((tmp_path / "sheets/comparison.json").read_text())
        assert len(sheet["views"]) == rows and all((tmp_path / "sheets" / name).is_file() for name in sheet["files"])
    said = run("compare", scene / "0.png", coded, status=2).stderr
    assert str(scene / "0.png") in said and str(coded) in said
