"""The folder for small devices: it decodes and renders on its own, and its parts are what the table says."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def deployment() -> ModuleType:
    spec = importlib.util.spec_from_file_location("deployment", ROOT / "export" / "deployment.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_folder_decodes_and_renders_without_anything_else(
    deployment: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "device"
    assert deployment.main([str(folder)]) == 0
    table = {line.rsplit(None, 2)[0].strip(): float(line.split()[-2]) for line in capsys.readouterr().out.splitlines()}
    assert set(table) == {"numpy", "onnxruntime", "av", "runtime and models", "together"}
    on_disk = sum(file.stat().st_size for file in (folder / "lib").rglob("*") if file.is_file())
    assert table["together"] == pytest.approx(on_disk / 1e6, abs=0.06) and table["runtime and models"] < 5
    tops = {path.name.partition("-")[0].partition(".")[0] for path in (folder / "lib").iterdir()}
    assert tops == {"numpy", "onnxruntime", "av", "tinysplat_runtime", "tinysplat_models"}

    gaussians = make_smooth_gaussians(2, 20, 24, degree=1)
    (tmp_path / "f.tsplat").write_bytes(ts.compress(gaussians))
    (tmp_path / "numpy.py").write_text("raise SystemExit('the current folder was searched')")

    def run(*arguments: str) -> None:
        env = {"PATH": os.environ["PATH"], "PYTHON": sys.executable, "PYTHONPATH": str(ROOT)}
        command = [str(folder / "tinysplat"), *arguments]
        done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, check=False, timeout=60)
        assert done.returncode == 0, done.stderr

    run("decode", "f.tsplat", "-o", "g.npz")
    run("render", "f.tsplat", "-o", "p.png")
    np.testing.assert_array_equal(
        ts.load_gaussians(tmp_path / "g.npz").means, ts.decompress((tmp_path / "f.tsplat").read_bytes()).means
    )
    assert (tmp_path / "p.png").stat().st_size > 100


def test_wheels_of_another_machine_are_unpacked_into_a_zip(
    deployment: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for package in ("numpy", "onnxruntime"):
        with zipfile.ZipFile(tmp_path / f"{package}-1.0-cp312-cp312-manylinux_2_28_aarch64.whl", "w") as wheel:
            for name in ("__init__.py", "core.so", "tests/test_a.py", "include/a.h", "core.pyi"):
                wheel.writestr(f"{package}/{name}", "x")
            wheel.writestr(f"{package}-1.0.dist-info/licenses/LICENSE", "free")
    out = tmp_path / "device.zip"
    assert deployment.main([str(out), "--wheels", str(tmp_path)]) == 2
    assert "no av-*.whl" in capsys.readouterr().err and not out.exists()
    shutil.copy(
        tmp_path / "numpy-1.0-cp312-cp312-manylinux_2_28_aarch64.whl",
        tmp_path / "av-1.0-cp310-abi3-manylinux_2_28_aarch64.whl",
    )
    assert deployment.main([str(out), "--wheels", str(tmp_path)]) == 0
    with zipfile.ZipFile(out) as archive:
        names = set(archive.namelist())
        assert "python3.12" in archive.read("tinysplat/tinysplat").decode()
    assert {"tinysplat/lib/numpy/core.so", "tinysplat/lib/numpy-1.0.dist-info/licenses/LICENSE"} <= names
    assert not any("tests" in name or name.endswith((".h", ".pyi")) for name in names)
