"""`doctor`, `--provider` and `completion`: what an installation is made of, and what is wrong with it."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import console
import pytest

MODELS = Path(__file__).parents[2] / "models"


def tinysplat(*arguments: object, models: Path = MODELS) -> subprocess.CompletedProcess[str]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TINYSPLAT_MODELS", str(models))
        return console.tinysplat(*arguments)


def test_a_sound_installation_has_nothing_wrong() -> None:
    done = tinysplat("doctor", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["wrong"] == [] and "CPUExecutionProvider" in report["providers"]
    assert {"libx265", "hevc"} <= set(report["codecs"]) and "io" in report["extras"] and "sweep" in report["models"]
    text = tinysplat("doctor").stdout
    assert all(name in text for name in (report["python"], report["packages"]["numpy"], "libx265", "sweep"))


def test_what_is_compiled_can_be_ready_before_anybody_waits() -> None:
    pytest.importorskip("numba")
    done = tinysplat("doctor", "--warm", "--quiet")
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip().rpartition(" in ")[2]).parent.is_dir()


def test_an_altered_model_is_named(tmp_path: Path) -> None:
    models = tmp_path / "models"
    shutil.copytree(MODELS, models)
    (models / "sweep.onnx").write_bytes(b"altered")
    done = tinysplat("doctor", models=models)
    assert done.returncode == 2 and "sweep.onnx" in done.stderr and done.stderr.count("\n") == 1
    assert "sweep.onnx" in done.stdout


GONE = """
import importlib.metadata as metadata
find = metadata.Distribution.from_name
def without(name):
    if name in ("onnxruntime", "av"):
        raise metadata.PackageNotFoundError(name)
    return find(name)
metadata.Distribution.from_name = without
metadata.packages_distributions = lambda: {"onnxruntime": ["onnxruntime-gpu"]}
from tinysplat_runtime.cli.doctor import examine
import json
print(json.dumps(examine()))
"""


def test_another_build_of_a_package_counts_as_it(tmp_path: Path) -> None:
    """As onnxruntime-gpu and onnxruntime-openvino bring the module onnxruntime."""
    brought = tmp_path / "onnxruntime_gpu-1.2.dist-info"
    brought.mkdir()
    (brought / "METADATA").write_text("Metadata-Version: 2.1\nName: onnxruntime-gpu\nVersion: 1.2\n")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    found = subprocess.run([sys.executable, "-c", GONE], capture_output=True, text=True, check=True, env=environment)
    report = json.loads(found.stdout)
    assert "1.2" in report["packages"]["onnxruntime"] and "onnxruntime-gpu" in report["packages"]["onnxruntime"]
    (line,) = report["wrong"]
    assert "av" in line.split() and "pip install" in line


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_completions_know_commands_and_options(shell: str) -> None:
    done = tinysplat("completion", shell)
    assert done.returncode == 0, done.stderr
    assert {"encode", "convert", "batch", "--min-opacity"} <= set(re.findall(r"--[a-z-]+|[a-z]+", done.stdout))
