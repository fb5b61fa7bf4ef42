"""Graphs as devices want them: `.ort` files with their operators' list, and networks of one size."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest
from networks.two_planes import FAR, NEAR, trace
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.graphs.inference import CONTRACTS, GraphStore
from tinysplat_runtime.graphs.predict import predict

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "models"


def export(script: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "export" / script), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def test_ort_files_code_and_decode_to_the_same_values(tmp_path: Path) -> None:
    """The transforms' graphs alone, which are small; bits differ where fused operators sum in another order."""
    plain, out = tmp_path / "plain", tmp_path / "ort"
    plain.mkdir()
    entries = json.loads((MODELS / "manifest.json").read_text())["artifacts"]
    kept = {name: entry for name, entry in entries.items() if name in CONTRACTS and name != "enlarge"}
    (plain / "manifest.json").write_text(json.dumps({"artifacts": kept}))
    for entry in kept.values():
        shutil.copy(MODELS / entry["file"], plain)

    done = export("ort_files.py", out, "--models", plain)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in out.iterdir()} == {f"{name}.ort" for name in kept} | {
        "manifest.json",
        "required_operators.config",
    }
    assert all((out / f"{name}.ort").read_bytes()[4:8] == b"ORTM" for name in kept)

    gaussians = make_smooth_gaussians(2, 32, 48)
    data = ts.Runtime(threads=1).compress(gaussians)
    expected, found = (ts.Runtime(threads=1, models=folder).decompress(data) for folder in (MODELS, out))
    for name in FIELDS:
        want = getattr(expected, name)
        assert np.abs(getattr(found, name) - want).max() <= 1e-6 * np.abs(want).max(), name
    assert ts.Runtime(threads=1, models=out).store.transform("synthesis").metadata["role"] == "synthesis"

    listed = set(re.findall(r"\w+", " ".join(re.findall(r"^ai\.onnx;\d+;(.+)$", config(out), flags=re.MULTILINE))))
    used = {node.op_type for node in onnx.load(str(plain / "synthesis.onnx")).graph.node}
    assert {"MatMul", "Where", "Clip"} <= used & listed

    again = export("ort_files.py", out, "--models", plain)
    assert again.returncode == 2 and "is there" in again.stderr and again.stderr.count("\n") == 1


def config(folder: Path) -> str:
    return (folder / "required_operators.config").read_text()


@pytest.fixture(scope="module")
def static_sweep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("static") / "sweep-2x96x64.onnx"
    done = export("static.py", MODELS / "sweep.onnx", "2x96x64", "-o", target)
    assert done.returncode == 0, done.stderr
    return target


def test_every_shape_of_a_static_network_is_known(static_sweep: Path) -> None:
    model = onnx.load(str(static_sweep))
    assert [opset.domain for opset in model.opset_import] == [""]
    assert not {"Shape", "Range", "ConstantOfShape", "Size"} & {node.op_type for node in model.graph.node}
    stated = {t.name: t for t in [*model.graph.value_info, *model.graph.output, *model.graph.input]}
    shapes = {name: [d.dim_value for d in t.type.tensor_type.shape.dim] for name, t in stated.items()}
    assert shapes["images"] == [2, 3, 64, 96] and shapes["means"] == [2, 64, 96, 3]
    assert all(0 not in shapes[name] for node in model.graph.node for name in node.output if name)


def test_a_static_network_finds_the_same_and_keeps_its_papers(static_sweep: Path) -> None:
    store = GraphStore(threads=1)
    dynamic, static = store.network("sweep"), store.network(str(static_sweep))
    fixed = {"min_views": 2, "max_views": 2, "size": [64, 96]}
    assert static.metadata == {**dynamic.metadata, **fixed}
    scene = trace(2, 64, 96)
    one, other = (predict(scene.images, scene.cameras, NEAR, FAR, graph) for graph in (dynamic, static))
    for name in FIELDS:
        assert np.allclose(getattr(one, name), getattr(other, name), rtol=1e-5, atol=1e-6), name
    scene = trace(2, 64, 64)
    with pytest.raises(InputError, match=r"64x64, this network was exported for 96x64 alone"):
        predict(scene.images, scene.cameras, NEAR, FAR, static)


def test_sizes_that_a_network_does_not_take_are_refused(tmp_path: Path) -> None:
    target = tmp_path / "static.onnx"
    done = export("static.py", MODELS / "sweep.onnx", "2x96x62", "-o", target)
    assert done.returncode == 2 and "96x62, sweep takes multiples of 4 from 32 on" in done.stderr
    assert done.stderr.count("\n") == 1 and not target.exists()
