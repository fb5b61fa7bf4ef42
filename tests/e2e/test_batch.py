"""Batches: results that are true, resume, retries, and workers that are killed on both engines."""

import hashlib
import json
import os
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import fsspec
import pytest
from console import tinysplat
from e2e.batch_work import note
from scenes import refusing, write_scene

import tinysplat_runtime as ts
from tinysplat.batch.bounds import bounded
from tinysplat.batch.cluster import run_ray
from tinysplat.batch.jobs import CODE, OPTIONS, BatchJob, encode, read_manifest
from tinysplat.batch.run import run_batch
from tinysplat.batch.storage import local_folder, read
from tinysplat.workers import Outcome, run_processes
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.recipe.words import AutoViews, Training


def silent(record: dict[str, Any]) -> None:
    """Progress that nobody reads."""


# ---- workers that are killed -------------------------------------------------------------------------------------


def jobs_named(folder: Path, *names: str) -> list[BatchJob]:
    return [BatchJob(name, EncodeRequest(f"/scenes/{name}"), str(folder / f"{name}.txt")) for name in names]


NAMES = ("a", "b", "killer", "c", "flaky", "d", "bad", "poison", "e", "f")


def assert_nothing_lost(folder: Path, document: dict[str, Any]) -> None:
    scenes = document["scenes"]
    assert set(scenes) == set(NAMES)
    assert {name for name, record in scenes.items() if record["status"] == "failed"} == {"bad", "poison"}
    assert "no frames" in scenes["bad"]["error"]
    assert scenes["poison"]["attempts"] == 4
    assert scenes["flaky"]["attempts"] >= 2 and scenes["killer"]["attempts"] >= 2
    for name in set(NAMES) - {"bad", "poison"}:
        assert (folder / f"{name}.txt").exists()
    assert json.loads((folder / "results.json").read_text()) == document


def test_processes_survive_workers_that_die(tmp_path: Path) -> None:
    engine = partial(run_processes, work=note, workers=2, attempts=4)
    document = run_batch(jobs_named(tmp_path, *NAMES), str(tmp_path), engine, silent)
    assert_nothing_lost(tmp_path, document)
    others = [record["attempts"] for name, record in document["scenes"].items() if name not in ("poison", "flaky")]
    assert max(others) < 4  # a job beside one that dies does not use up its attempts


@pytest.mark.slow
def test_a_ray_cluster_survives_workers_that_die_and_does_no_scene_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))  # workers find `batch_work`
    engine = partial(run_ray, work=note, workers=2, attempts=4, address=None)
    document = run_batch(jobs_named(tmp_path, *NAMES), str(tmp_path), engine, silent)
    assert_nothing_lost(tmp_path, document)
    assert document["scenes"]["bad"]["attempts"] == 1
    for name in set(NAMES) - {"bad", "poison"}:
        assert (tmp_path / f"{name}.txt").read_text() == "done\n"
    assert len({record["worker"] for record in document["scenes"].values() if "worker" in record}) >= 2


@pytest.mark.slow
def test_ray_encodes_what_processes_encode(scenes: Path, tmp_path: Path) -> None:
    for engine in ("ray", "processes"):
        done = tinysplat("batch", scenes / "manifest.txt", "-o", tmp_path / engine, "--engine", engine, "--workers", 2)
        assert done.returncode == 0, done.stderr
    for name in ("s0", "s1"):
        assert (tmp_path / f"ray/{name}.tsplat").read_bytes() == (tmp_path / f"processes/{name}.tsplat").read_bytes()


# ---- the command -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes")
    for i in range(2):
        write_scene(folder / f"s{i}", views=2, height=32, width=48)
    (folder / "manifest.txt").write_text("# two scenes\ns0\n\n" + json.dumps({"scene": "s1", "qp": 6}) + "\n")
    return folder


def found(folder: Path) -> tuple[dict[str, Any], int]:
    """Records by scene of a batch's results, and how many were done before."""
    results = json.loads((folder / "out/results.json").read_text())
    return results["scenes"], results["skipped"]


def test_a_batch_runs_resumes_and_repairs(scenes: Path, tmp_path: Path) -> None:
    command = ("batch", scenes / "manifest.txt", "-o", tmp_path / "out", "--workers", 1)
    done = tinysplat(*command)
    assert done.returncode == 0, done.stderr
    results, skipped = found(tmp_path)
    assert skipped == 0
    for name, record in results.items():
        data = (tmp_path / f"out/{name}.tsplat").read_bytes()
        assert record["bytes"] == len(data) and record["sha256"] == hashlib.sha256(data).hexdigest()
    assert ts.inspect((tmp_path / "out/s1.tsplat").read_bytes())["qp"] == 6
    (tmp_path / "out/s1.tsplat").write_bytes(data[:100])
    assert tinysplat(*command).returncode == 0 and found(tmp_path)[1] == 1
    assert (tmp_path / "out/s1.tsplat").read_bytes() == data
    assert tinysplat(*command, "--qp", 3).returncode == 0 and found(tmp_path)[1] == 1  # s1 has a Q_g of its own


def test_bad_batches_are_one_line(scenes: Path, tmp_path: Path) -> None:
    manifest = tmp_path / "m.txt"

    def fail(text: str | None, *options: object) -> str:
        if text is not None:
            manifest.write_text(text)
        done = tinysplat("batch", manifest, "-o", tmp_path / "out", *options)
        assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
        return done.stderr

    fail(None)
    manifest.mkdir()
    fail(None)
    manifest.rmdir()
    for text, named in {
        "\n# nothing\n": (),
        f"{scenes}/s0\n{scenes}/s0/\n": ("line 2", "'s0'", "line 1"),
        "{scene": ("line 1", "JSON"),
        "{}": ("line 1", "scene"),
        '{"scene": "a", "quality": 3}': ("quality",),
        '{"scene": "a", "name": "../x"}': ("name", "'../x'"),
        '{"scene": "a", "views": 3}': ("views", "3"),
        '{"scene": "a", "qp": "four"}': ("line 1", "qp", "'four'"),
        '{"scene": "a", "qp": 4, "target_size": "9KB"}': ("target_size", "qp"),
        '{"scene": "a", "report": 1}': ("report", "1"),
        "a\0b": ("1", "0"),
    }.items():
        said = fail(text)
        assert all(name in said for name in (str(manifest), *named)), said
    assert "--engine ray" in fail("a", "--address", "x")
    manifest.write_bytes(b"\x89TSPLAT\r\n\x1a\n\0\0")
    assert "UTF-8" in fail(None)
    assert "gone" in fail(f"{scenes}/gone", "-q", "--workers", 1)
    (tmp_path / "out/results.json").write_text("[]")
    assert "results.json" in fail("a")


# ---- places ------------------------------------------------------------------------------------------------------


def test_urls_are_read_and_written_through_fsspec(scenes: Path) -> None:
    memory = fsspec.filesystem("memory")
    memory.put(str(scenes / "s0") + "/", "/in/s0/", recursive=True)
    job = BatchJob("s0", EncodeRequest("memory://in/s0"), "memory://out/s0.tsplat")
    here = partial(map, lambda job: Outcome(job, encode(job), None, 1))
    batch = partial(run_batch, [job], "memory://out", here, silent)
    assert [batch()["skipped"], batch()["skipped"]] == [0, 1]
    data = memory.cat("/out/s0.tsplat")
    assert ts.inspect(data)["views"] == 2
    memory.pipe("/out/s0.tsplat", data[:-1])
    assert batch()["skipped"] == 0 and memory.cat("/out/s0.tsplat") == data
    assert sorted(memory.ls("/out", detail=False)) == ["/out/results.json", "/out/s0.tsplat"]
    with refusing(InputError, "memory://in/gone"), local_folder("memory://in/gone"):
        pass
    with refusing(InputError, "nope://x"):
        read("nope://x")


def test_an_entrys_options_replace_the_batchs_and_what_they_contradict() -> None:
    asked = {"qp": 6.0, "profile": "fast", "train": Training(steps=3), "model": "sweep", "report": True}
    entries = [{}, {"target_size": "9KB"}, {"like": "x.tsplat", "report": False}, {"qp": 0, "train": ""}, {"auto": 3}]
    lines = [json.dumps({"scene": "s", "name": f"n{i}", **entry}) for i, entry in enumerate(entries)]
    jobs = read_manifest("\n".join(lines), "out", asked, "base")
    codings = [job.request for job in jobs]
    assert [coding.qp for coding in codings] == [6, None, None, 0, 6]
    assert [coding.profile for coding in codings] == ["fast", "fast", None, "fast", "fast"]
    assert codings[1].target_size == 9000 and codings[2].like == "base/x.tsplat"
    assert [job.request.train for job in jobs] == [*2 * [Training(steps=3)], None, None, Training(steps=3)]
    assert [job.keep.report for job in jobs] == [True, True, False, True, True]
    assert jobs[4].request.views == AutoViews(3) and {job.request.model for job in jobs} == {"sweep"}


def test_options_that_say_what_holds_anyway_do_not_have_a_scene_coded_again() -> None:
    plain = BatchJob("a", EncodeRequest("/a"), "out/a.tsplat")
    for said in ({"lossless": False}, {"profile": "balanced"}, {"qp": 0}, {"first_number": 0}, {"report": False}):
        (job,) = read_manifest(json.dumps({"scene": "/a", **said}), "o", {})
        assert job.fingerprint == plain.fingerprint


def test_every_option_changes_the_fingerprint() -> None:
    said = {"views": [0, 1], "size": [8, 8], "train": "5", "mode": "photos", "lossless": True, "drop_invalid": True}
    said |= {"target_size": 900, "target_psnr": 40, "near": 2, "far": 9, "qp": 1, "profile": "fast", "first_number": 1}
    said |= {"provider": "cuda", "report": True, "save_gaussians": True, "auto": 3, "joint": False}
    said |= {"masks": "moving", "at_most": 9, "fast": True}
    options = [{name: said.get(name, f"/{name}.x")} for name in OPTIONS]  # paths and texts
    texts = [json.dumps({"scene": "/a", **one}) for one in [{}, *options, {"train": "5s"}, {"train": "6"}]]
    jobs = [read_manifest(text, "out", {}, allowed=CODE)[0] for text in [*texts, "/b/a"]]
    assert len({job.fingerprint for job in jobs}) == len(jobs) == len(OPTIONS) + 4
    with refusing(InputError, "line 1: train: 'soon'"):
        read_manifest('{"scene": "/a", "train": "soon"}', "out", {})


# ---- bounds, lines and what is known after an interrupt -----------------------------------------------------------


def test_what_is_done_is_known_after_an_interrupt(tmp_path: Path) -> None:
    def interrupted(jobs):
        yield from run_processes(jobs[:1], note, 1, 1)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_batch(jobs_named(tmp_path, "a", "b"), str(tmp_path), interrupted, silent)
    assert set(json.loads((tmp_path / "results.json").read_text())["scenes"]) == {"a"}


def test_a_scene_that_takes_too_long_or_too_much_is_at_fault(tmp_path: Path) -> None:
    def slow(job: BatchJob) -> dict[str, Any]:
        time.sleep(30)
        return {}

    def large(job: BatchJob) -> dict[str, Any]:
        return {"bytes": len(bytearray(8 << 30))}

    job = jobs_named(tmp_path, "a")[0]
    with refusing(InputError, "0.2"):
        bounded(job, slow, 0.2, None)
    with refusing(InputError, str(4 << 30)):
        bounded(job, large, None, 4 << 30)


def test_lines_failures_and_another_try(tmp_path: Path) -> None:
    write_scene(tmp_path / "good", views=3, height=32, width=48)
    (gone := min((tmp_path / "good").rglob("*.png"))).unlink()
    (tmp_path / "list.txt").write_text("good\nmissing\n")
    done = tinysplat(
        "batch", tmp_path / "list.txt", "-o", tmp_path / "out", "--json-lines", "--workers", "1", "--target-size", "9KB"
    )
    records = {record["name"]: record for record in map(json.loads, done.stdout.splitlines())}
    assert done.returncode == 2
    assert {name: record["status"] for name, record in records.items()} == {"good": "done", "missing": "failed"}
    assert gone.name in records["good"]["warning"] and "Warning" not in done.stderr
    assert (tmp_path / "out" / "good.tsplat").stat().st_size <= 9000
    again = tinysplat("batch", tmp_path / "list.txt", "-o", tmp_path / "out", "--retry-failed", "--workers", "1",
                      "--target-size", "9KB")  # fmt: skip
    assert again.returncode == 2 and "good" not in again.stderr
    assert [line.split()[1] for line in again.stderr.splitlines() if "missing" in line] == ["missing:"]
    kept = json.loads((tmp_path / "out" / "results.json").read_text())["scenes"]
    assert {name: record["status"] for name, record in kept.items()} == {"good": "done", "missing": "failed"}


def test_a_scene_is_coded_as_encode_codes_it(tmp_path: Path) -> None:
    scene = write_scene(tmp_path / "desk", views=3, height=40, width=56)
    words = ("--views", "0,2", "--qp", "4", "--licence", "CC0-1.0", "--size", "48x32")
    assert tinysplat("encode", scene, "-o", tmp_path / "desk.tsplat", *words).returncode == 0
    data = (tmp_path / "desk.tsplat").read_bytes()
    entry = {"scene": "desk", "views": "0,2", "size": "48x32", "licence": "CC0-1.0", "qp": 4, "report": True}
    like = {
        "scene": "desk",
        "name": "again",
        "views": [0, 2],
        "size": [32, 48],
        "like": "desk.tsplat",
        "save_gaussians": True,
    }
    (tmp_path / "list.txt").write_text(f"{json.dumps(entry)}\n{json.dumps(like)}\n")
    done = tinysplat("batch", tmp_path / "list.txt", "-o", tmp_path / "out", "--workers", "1", "--unit", "metre")
    assert done.returncode == 0, done.stderr
    coded = ts.inspect((tmp_path / "out/desk.tsplat").read_bytes())
    assert coded["notes"] == {"unit": "metre", "attribution": "", "licence": "CC0-1.0"} and coded["qp"] == 4
    assert coded["planes"] == ts.inspect(data)["planes"]
    assert json.loads((tmp_path / "out/desk.json").read_text())["bytes"] == coded["bytes"]
    again = ts.inspect((tmp_path / "out/again.tsplat").read_bytes())
    assert again["qp"] == 4 and ts.load_gaussians(tmp_path / "out/again.npz").count == again["gaussians"]
