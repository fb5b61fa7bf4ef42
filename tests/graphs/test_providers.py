"""Execution providers: names with options, plug-ins that register at run time, and who really ran which graph."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import onnxruntime
import pytest
from scenes import make_smooth_gaussians, refusing, tells

import tinysplat_runtime as ts
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.graphs import DEFAULT_MODEL
from tinysplat_runtime.graphs.artifacts import find_artifact
from tinysplat_runtime.graphs.inference import open_graph
from tinysplat_runtime.graphs.providers import add_providers, parse_provider, providers_of

SCRIPT = Path(sys.executable).with_name("tinysplat")
NOT_BUILT_IN = SimpleNamespace(
    get_available_providers=list,
    get_ep_devices=onnxruntime.get_ep_devices,
    register_execution_provider_library=onnxruntime.register_execution_provider_library,
)
"""An onnxruntime whose CPU came as a plug-in does: by devices alone."""


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("CUDA", ("CUDA", {})),
        ("CUDA:device_id=1", ("CUDA", {"device_id": "1"})),
        ("OpenVINO:device_type=NPU, cache_dir=C:/a=b", ("OpenVINO", {"device_type": "NPU", "cache_dir": "C:/a=b"})),
    ],
)
def test_names_carry_options(text: str, expected: tuple[str, dict[str, str]]) -> None:
    assert parse_provider(text) == expected


@pytest.mark.parametrize("text", ["CUDA:", "CUDA:device_id", "CUDA:=1", "CUDA:device_id=", ":device_id=1", "CUDA:a=1,"])
def test_what_is_no_option_is_said(text: str) -> None:
    with refusing(InputError, f"provider: '{text}' NAME key=value"):
        providers_of(text)


def test_options_reach_a_built_in_provider() -> None:
    options = onnxruntime.SessionOptions()
    chosen = add_providers(onnxruntime, options, [("CPU", {"use_arena": "0"}), "CPUExecutionProvider"])
    assert chosen == [("CPUExecutionProvider", {"use_arena": "0"})]
    assert not options.has_providers()


def test_a_plug_in_runs_on_its_device() -> None:
    """Onnxruntime's own CPU, asked for as plug-ins are; the graph then finds what it found before."""
    artifact = find_artifact("analysis_project", "analysis")
    options = onnxruntime.SessionOptions()
    assert add_providers(NOT_BUILT_IN, options, [("CPU", {"device_type": "CPU"})]) is None
    assert options.has_providers()
    session = onnxruntime.InferenceSession(artifact.read(), options, enable_fallback=0)
    assert session.get_providers() == ["CPUExecutionProvider"]
    rng = np.random.default_rng(0)
    inputs = {"sh": rng.normal(size=(1, 8, 8, 4, 3)), "projection": rng.normal(size=(12, 5))}
    inputs = {name: array.astype(np.float32) for name, array in inputs.items()}
    expected = open_graph(artifact, "analysis_project").run(inputs)["color"]
    assert np.array_equal(session.run(["color"], inputs)[0], expected)


def test_a_plug_in_package_is_found_by_its_provider(tmp_path: Path) -> None:
    """Its library is none, which onnxruntime says; a package that fails on import is as if it were not there."""
    library = tmp_path / "libfake.so"
    library.write_bytes(b"no library")
    for name, code in (
        ("fake", f"get_library_path = lambda: {str(library)!r}\nget_ep_names = lambda: ['FakeExecutionProvider']\n"),
        ("broken", "raise OSError('no driver')\n"),
    ):
        package = tmp_path / f"onnxruntime_ep_{name}"
        package.mkdir()
        (package / "__init__.py").write_text(code)
    ts.save_gaussians(tmp_path / "g.npz", make_smooth_gaussians(2, 16, 16))
    for provider, words in (
        ("Fake", f"FakeExecutionProvider {library}"),
        ("Nope", "NopeExecutionProvider CPUExecutionProvider FakeExecutionProvider"),
        ("Fake:library", "provider: 'library' 'Fake:library' NAME:key=value"),
    ):
        done = run("compress", "g.npz", "-o", "g.tsplat", "--provider", provider, cwd=tmp_path, path=str(tmp_path))
        assert done.returncode == 2 and tells(done.stderr, words), done.stderr
        assert done.stderr.count("\n") == 1 and not (tmp_path / "g.tsplat").exists()


def test_doctor_says_who_ran_which_graph() -> None:
    report = json.loads(run("doctor", "--json", "--provider", "CPU").stdout)
    assert {DEFAULT_MODEL, "synthesis"} <= report["graphs"].keys()
    assert all(set(ran) == {"CPUExecutionProvider"} for ran in report["graphs"].values())
    assert min(sum(ran.values()) for ran in report["graphs"].values()) > 0
    assert "graphs" not in json.loads(run("doctor", "--json").stdout)


def run(*arguments: str, cwd: Path | None = None, path: str = "") -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": path}
    command = [str(SCRIPT), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=cwd, env=environment)
