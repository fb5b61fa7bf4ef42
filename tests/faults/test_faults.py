"""Faults of the machine around the commands: kills, interrupts, full disks, vanished files, many users at once.

docs/ROBUSTNESS.md, "Faults", is the table of what these tests hold.
"""

import contextlib
import gc
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from console import fail, succeed
from measure.evaluation_scenes import write_eval_scene
from scenes import make_smooth_gaussians, refusing, write_scene

import tinysplat_runtime as ts
from tinysplat_runtime.errors import ModelError, TinySplatError
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.graphs.artifacts import models_dir

ROUNDS = 3
"""Kills of each command, spread over its run."""


def _start(*arguments: object, limit: Callable[[], None] | None = None) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "tinysplat_runtime", *map(str, arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=limit, start_new_session=True
    )


def _finish(process: subprocess.Popen[str]) -> tuple[int, str]:
    _, err = process.communicate(timeout=120)
    return process.returncode, err


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A scene folder, a Gaussian file and a .tsplat file, small."""
    folder = tmp_path_factory.mktemp("inputs")
    write_scene(folder / "scene", 2, 32, 48)
    g = make_smooth_gaussians(2, 32, 48, 1)
    ts.save_gaussians(folder / "g.npz", g)
    (folder / "f.tsplat").write_bytes(ts.compress(g))
    return {"scene": folder / "scene", "gaussians": folder / "g.npz", "file": folder / "f.tsplat"}


def _commands(inputs: dict[str, Path]) -> dict[str, tuple[list[object], str]]:
    """Arguments before -o, and the output's suffix."""
    return {
        "encode": (["encode", inputs["scene"]], ".tsplat"),
        "compress": (["compress", inputs["gaussians"]], ".tsplat"),
        "decode": (["decode", inputs["file"]], ".npz"),
        "render": (["render", inputs["file"]], ".png"),
    }


@pytest.mark.parametrize("command", ["encode", "compress", "decode", "render"])
def test_a_command_killed_at_any_moment_leaves_the_old_file_or_the_whole_new_one(inputs, tmp_path, command) -> None:
    arguments, suffix = _commands(inputs)[command]
    target = tmp_path / f"out{suffix}"
    began = time.perf_counter()
    status, err = _finish(_start(*arguments, "-o", target, "-q", "--force"))
    took = time.perf_counter() - began
    assert status == 0, err
    new = target.read_bytes()
    seen = set()
    for moment in np.linspace(0.2, 1.1, ROUNDS):
        target.write_bytes(b"old")
        process = _start(*arguments, "-o", target, "-q", "--force")
        time.sleep(took * moment)
        process.send_signal(signal.SIGKILL)
        _finish(process)
        found = target.read_bytes()
        assert found in (b"old", new)
        seen.add(found == new)
        for left in tmp_path.glob(".tinysplat-*"):  # what a kill can leave behind is hidden and never read again
            left.unlink()
    assert list(tmp_path.iterdir()) == [target]
    assert False in seen  # some kills did come before the end


def _children(process: subprocess.Popen[str]) -> set[int]:
    """Processes of the session that the command leads, itself left out."""
    found = set()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            session = int(stat.read_text().rpartition(")")[2].split()[3])
            found |= {int(stat.parent.name)} if session == process.pid else set()
    return found - {process.pid}


def _wait_for_end(processes: set[int]) -> None:
    deadline = time.monotonic() + 30
    while any(Path(f"/proc/{pid}").exists() for pid in processes):
        assert time.monotonic() < deadline, "workers outlive the command"
        time.sleep(0.02)


AGREED = {"status", "bytes", "sha256", "error", "psnr", "psnr_raw", "psnr_decoded_raw", "psnr_photo", "ssim"}
"""Documented keys of results that two runs agree on."""


def _figures(folder: Path) -> dict[str, object]:
    """What a run over many scenes leaves to read: files by name, of JSON documents what two runs agree on."""

    def agreed(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: agreed(item) for key, item in value.items() if key in AGREED or isinstance(item, dict | list)}
        return [agreed(item) for item in value if isinstance(item, dict | list)] if isinstance(value, list) else value

    found: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.suffix != ".jsonl" and not path.name.startswith("."):  # rows are for the next run
            data = path.read_bytes()
            found[str(path.relative_to(folder))] = agreed(json.loads(data)) if path.suffix == ".json" else data
    return found


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[object]]:
    """Arguments before -o of the commands that go over many scenes."""
    folder = tmp_path_factory.mktemp("many")
    window = {"kind": "near", "context": [0, 2], "target": [1]}
    for n in range(2):
        write_eval_scene(folder / f"s{n}", [window])
    (folder / "manifest.txt").write_text("".join(f'{{"scene": "s{n}", "views": [0, 2]}}\n' for n in range(2)))
    return {
        "batch": ["batch", folder / "manifest.txt", "--workers", 2, "--model", "sweep"],
        "eval": ["eval", folder, "--jobs", 2, "--model", "sweep", "--size", "64x48", "--lpips", "none"],
    }


def _is_part(document: Any, whole: Any) -> bool:
    """Whether results are those of a run before, of a run that has some scenes, or the whole."""
    scenes = document["scenes"]
    return document == whole or not scenes or all(whole["scenes"][name] == scenes[name] for name in scenes)


@pytest.mark.parametrize("command", ["batch", "eval"])
def test_a_run_over_many_scenes_killed_at_any_moment_leaves_whole_files_and_goes_on(many, tmp_path, command) -> None:
    began = time.perf_counter()
    status, err = _finish(_start(*many[command], "-o", tmp_path / "wanted", "-q"))
    took = time.perf_counter() - began
    assert status == 0, err
    wanted, target = _figures(tmp_path / "wanted"), tmp_path / "out"
    target.mkdir()
    results = json.dumps({"scenes": {}}).encode()  # of a run before
    (target / "results.json").write_bytes(results)
    seen = []
    for moment in (0.5, 0.9):
        process = _start(*many[command], "-o", target, "-q")
        time.sleep(took * moment)
        workers = _children(process)
        process.send_signal(signal.SIGKILL)
        process.communicate(timeout=60)
        _wait_for_end(workers)
        found = _figures(target)
        assert all(value == wanted[name] for name, value in found.items() if name != "results.json")
        assert _is_part(found["results.json"], wanted["results.json"])
        seen.append(found == wanted)
    assert False in seen  # some kills did come before the end
    status, err = _finish(_start(*many[command], "-o", target, "-q"))
    assert status == 0, err
    assert _figures(target) == wanted


@pytest.mark.parametrize(("delay", "sent"), [(0.0, signal.SIGINT), (0.3, signal.SIGTERM)], ids=str)
@pytest.mark.parametrize("command", ["batch", "eval"])
def test_an_interrupted_run_over_many_scenes_ends_with_130(many, tmp_path, command, delay, sent) -> None:
    process = _start(*many[command], "-o", tmp_path / "out", "-q")
    deadline = time.monotonic() + 60
    while len(_children(process)) < 3 and time.monotonic() < deadline:  # two workers, and what tracks their resources
        time.sleep(0.01)
    workers = _children(process)
    time.sleep(delay)
    os.killpg(process.pid, sent)  # as a terminal does, and a service manager
    status, err = _finish(process)
    _wait_for_end(workers)
    assert status == 130 and "Traceback" not in err, (status, err)
    assert len(list((tmp_path / "out").rglob(".tinysplat-*"))) <= 2  # of workers, which end at once; never read again


def _wait_until_it_works(process: subprocess.Popen[str]) -> None:
    """Until numpy is mapped: the interpreter's own start is not the product's."""
    maps = Path(f"/proc/{process.pid}/maps")
    while process.poll() is None and "_multiarray_umath" not in maps.read_text():
        time.sleep(0.01)


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM], ids=str)
@pytest.mark.parametrize("command", ["encode", "decode"])
def test_an_interrupted_command_ends_with_130_and_leaves_nothing(inputs, tmp_path, command, sent) -> None:
    arguments, suffix = _commands(inputs)[command]
    statuses = []
    for delay in (0.0, 0.3):
        process = _start(*arguments, "-o", tmp_path / f"out{suffix}", "-q")
        _wait_until_it_works(process)
        time.sleep(delay)
        process.send_signal(sent)
        status, err = _finish(process)
        statuses.append(status)
        assert "Traceback" not in err, err
        found = list(tmp_path.iterdir())
        assert found in ([], [tmp_path / f"out{suffix}"])
        assert status != 130 or found == []
        (tmp_path / f"out{suffix}").unlink(missing_ok=True)
    # An interpreter that is on its way out, or was in a library's start, ends by the signal: 130 to a shell as well.
    by_signal = {130, -sent, -signal.SIGINT}
    assert set(statuses) <= {0, *by_signal} and statuses[0] in by_signal


LOADING = """
import signal, sys

class Library:  # as a C extension does that an interrupt meets while it is being loaded
    def find_spec(self, name, *_):
        if name == "onnxruntime":
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                raise ImportError(name) from None

sys.meta_path.insert(0, Library())
from tinysplat_runtime.cli import main
sys.exit(main(sys.argv[1:]))
"""


def test_an_interrupt_that_became_another_error_is_still_an_interrupt(inputs, tmp_path) -> None:
    command = [sys.executable, "-c", LOADING, "decode", inputs["file"], "-o", tmp_path / "g.npz", "-q"]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "")


def _small_files() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (700, 700))


@pytest.mark.parametrize("command", ["encode", "compress", "decode", "render"])
def test_a_full_disk_is_one_line_and_keeps_the_old_file(inputs, tmp_path, command) -> None:
    arguments, suffix = _commands(inputs)[command]
    target = tmp_path / f"out{suffix}"
    target.write_bytes(b"old")
    status, err = _finish(_start(*arguments, "-o", target, "--force", "-q", limit=_small_files))
    assert status == 2 and err.count("\n") == 1 and str(target) in err, err
    assert target.read_bytes() == b"old" and list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("command", ["encode", "compress", "decode", "render"])
def test_a_folder_that_refuses_writing_is_named(inputs, tmp_path, command, monkeypatch) -> None:
    def refuse(path: object, *_: object) -> int:
        raise PermissionError(13, os.strerror(13), str(path))

    arguments, suffix = _commands(inputs)[command]
    monkeypatch.setattr(os, "open", refuse)  # root writes anywhere: the refusal is the system call's
    assert f"out{suffix}" in fail(*arguments, "-o", tmp_path / f"out{suffix}", "-q")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["encode", "compress", "decode", "render"])
def test_an_input_that_has_vanished_is_named(inputs, tmp_path, command) -> None:
    arguments, suffix = _commands(inputs)[command]
    gone = Path(str(arguments[1])).with_name("gone" + Path(str(arguments[1])).suffix)
    status, err = _finish(_start(arguments[0], gone, "-o", tmp_path / f"out{suffix}"))
    assert status == 2 and "gone" in err and err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


# ---- many at once ---------------------------------------------------------------------------------------------------


def _same(a: ts.Gaussians, b: ts.Gaussians) -> bool:
    return all((getattr(a, name) == getattr(b, name)).all() for name in FIELDS)


@pytest.mark.parametrize("views", [2, 16])
def test_64_decodes_in_threads_of_one_runtime_are_identical(views) -> None:
    runtime = ts.Runtime(threads=2)
    data = runtime.compress(make_smooth_gaussians(views, 8, 16, 0), "fast")
    wanted = runtime.decompress(data)
    assert len(wanted.cameras) == views
    with ThreadPoolExecutor(64) as pool:
        assert all(_same(wanted, found) for found in pool.map(runtime.decompress, [data] * 64))


def test_one_runtime_encodes_decodes_and_renders_in_several_threads_at_once() -> None:
    scenes = [make_smooth_gaussians(1, 24, 24, 1, seed=n) for n in range(4)]
    runtime = ts.Runtime(threads=2)

    def chain(g: ts.Gaussians) -> tuple[bytes, np.ndarray]:
        data = runtime.compress(g, "paper")
        return data, runtime.render(runtime.decompress(data), g.cameras[0])

    alone = [chain(g) for g in scenes]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(chain, scenes * 4))
    for n, (data, picture) in enumerate(together):
        assert data == alone[n % 4][0]
        np.testing.assert_array_equal(picture, alone[n % 4][1])


def test_several_processes_that_write_one_file_leave_one_whole_file(inputs, tmp_path) -> None:
    processes = [
        _start("compress", inputs["gaussians"], "-o", tmp_path / "f.tsplat", "-q", "--force") for _ in range(3)
    ]
    assert [_finish(process)[0] for process in processes] == [0, 0, 0]
    assert (tmp_path / "f.tsplat").read_bytes() == inputs["file"].read_bytes()
    assert [path.name for path in tmp_path.iterdir()] == ["f.tsplat"]


def _cycle(rounds: int) -> tuple[float, int]:
    """Growth of resident memory in MB and of open handles over rounds of encoding and decoding 32×32 scenes."""
    runtime = ts.Runtime(threads=1)
    g = make_smooth_gaussians(1, 32, 32, 1)
    damaged = runtime.compress(g)[:-40]

    def once(n: int) -> None:
        runtime.decompress(runtime.compress(g, "paper" if n % 50 else "fast"))
        with pytest.raises(TinySplatError):
            runtime.decompress(damaged)

    for n in range(min(rounds, 20)):
        once(n)
    gc.collect()
    memory, handles = _resident_mb(), _handles()
    for n in range(rounds):
        once(n)
    gc.collect()
    return _resident_mb() - memory, _handles() - handles


def _handles() -> int:
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


@pytest.mark.parametrize("rounds", [50, pytest.param(10_000, marks=pytest.mark.slow)])
@pytest.mark.timeout(3600)
def test_rounds_of_encoding_and_decoding_grow_neither_memory_nor_handles(rounds: int) -> None:
    grown, handles = _cycle(rounds)
    assert handles == 0
    assert grown < 12  # allocators keep some; a leak of one plane a round would be 20 MB at 10,000


# ---- no network -----------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("no_network")
def test_the_whole_chain_runs_without_a_socket(inputs, tmp_path) -> None:
    steps = [
        ["encode", inputs["scene"], "-o", tmp_path / "f.tsplat", "--save-gaussians", tmp_path / "raw.npz"],
        ["compress", tmp_path / "raw.npz", "-o", tmp_path / "g.tsplat"],
        ["compress", tmp_path / "raw.npz", "-o", tmp_path / "h.tsplat", "--like", tmp_path / "g.tsplat"],
        ["encode", inputs["scene"], "-o", tmp_path / "p.tsplat", "--mode", "photos"],
        ["convert", tmp_path / "g.tsplat", "-o", tmp_path / "g.ply"],
        ["decode", tmp_path / "f.tsplat", "-o", tmp_path / "g.npz"],
        ["render", tmp_path / "f.tsplat", "-o", tmp_path / "p.png"],
        ["info", tmp_path / "f.tsplat"],
        ["models"],
    ]
    for step in steps:
        succeed(*step)


@pytest.mark.parametrize("name", ["analysis_vpt", "synthesis", "sweep"])
def test_a_model_that_differs_from_its_manifest_is_refused_when_it_is_loaded(name, inputs, tmp_path) -> None:
    shutil.copytree(models_dir(), tmp_path / "models", ignore=shutil.ignore_patterns("edge*"))
    altered = tmp_path / "models" / f"{name}.onnx"
    data = bytearray(altered.read_bytes())
    data[len(data) // 2] ^= 1
    altered.write_bytes(data)
    runtime = ts.Runtime(models=tmp_path / "models")
    scene = ts.load_scene(inputs["scene"])
    with refusing(ModelError, f"{name}.onnx"):
        runtime.decompress(runtime.encode(scene, "sweep"))
