"""`models`, `doctor` and `decode`: what they print and write, beside what other tests decode."""

from __future__ import annotations

import json
from pathlib import Path

import console
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("commands") / "f.tsplat"
    path.write_bytes(ts.compress(make_smooth_gaussians(2, 16, 24, degree=1)))
    return path


def test_decode_writes_gaussians_and_says_how_many(file: Path, tmp_path: Path) -> None:
    said = console.succeed("decode", file, "-o", tmp_path / "g.npz", "--report", tmp_path / "r.json", "--unit", "inch")
    assert said == f"{tmp_path / 'g.npz'}: 768 Gaussians of SH degree {ts.inspect(file.read_bytes())['sh_degree']}\n"
    found = ts.load_gaussians(tmp_path / "g.npz")
    assert found.count == 768 and found.notes.unit == "inch"
    report = json.loads((tmp_path / "r.json").read_text())
    assert (report["bytes"], report["gaussians"]) == (file.stat().st_size, 768) and "write" in report["seconds"]
    one = console.succeed("decode", file, "-o", tmp_path / "v.npz", "--views", "1", "--sh-degree", "0")
    assert one.endswith(": 384 Gaussians of SH degree 0\n")


def test_a_prefix_is_decoded_and_reported_where_it_is_asked_for(file: Path, tmp_path: Path) -> None:
    size = ts.inspect(file.read_bytes())["prefixes"][0]["bytes"]
    (tmp_path / "cut.tsplat").write_bytes(file.read_bytes()[:size])
    words = ("decode", tmp_path / "cut.tsplat", "-o", tmp_path / "g.npz", "--report", tmp_path / "r.json")
    assert "tinysplat: " in console.fail(*words) and not (tmp_path / "g.npz").exists()
    done = console.tinysplat(*words, "--partial")
    lost = done.stderr.removeprefix(f"{tmp_path / 'cut.tsplat'}: lost ")
    count, names = lost.split(" of its planes: ")
    assert done.returncode == 0 and len(names.split(", ")) == int(count) > 1
    console.succeed(*words, "--max-bytes", size, "--force")
