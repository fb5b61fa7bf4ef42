"""`export/quantise.py`: an int8 artifact says what it is, is smaller, and finds the depths that the float one finds."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from measure.evaluation_scenes import write_eval_scene
from networks.two_planes import FAR, NEAR, trace

from tinysplat_runtime.api import DEFAULT_MODEL
from tinysplat_runtime.graphs.artifacts import find_artifact
from tinysplat_runtime.graphs.inference import GraphStore
from tinysplat_runtime.graphs.predict import predict

SCRIPT = Path(__file__).parents[2] / "export" / "quantise.py"
NETWORK = find_artifact(DEFAULT_MODEL, "network").path


def quantise(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), str(NETWORK), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes")
    write_eval_scene(folder / "plane")
    return folder


def test_int8_keeps_depth_and_papers_in_a_smaller_file(scenes: Path, tmp_path: Path) -> None:
    target = tmp_path / "int8.onnx"
    done = quantise(scenes, "-o", target, "--size", 96)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["int8 convolutions"] == 20
    assert target.stat().st_size < 0.7 * NETWORK.stat().st_size

    store = GraphStore(threads=1)
    exact, rounded = store.network(DEFAULT_MODEL), store.network(str(target))
    assert "int8 in 20" in rounded.metadata["weights"]
    assert {**rounded.metadata, "weights": exact.metadata["weights"]} == exact.metadata
    scene = trace(2, 64, 96)
    one, other = (predict(scene.images, scene.cameras, NEAR, FAR, graph) for graph in (exact, rounded))
    error = np.abs(other.means - one.means).max(axis=-1)
    assert 0 < np.median(error) < 0.01 and np.quantile(error, 0.95) < 0.2  # of depths 3 and 6
    assert np.abs(other.opacities - one.opacities).mean() < 0.02


def test_what_cannot_be_quantised_is_said_in_one_line(scenes: Path, tmp_path: Path) -> None:
    target = tmp_path / "int8.onnx"
    for arguments, message in [
        ((tmp_path, "-o", target), "no folder with cameras.json in it"),
        ((scenes, "-o", tmp_path / "none" / "int8.onnx"), "no folder"),
        ((scenes, "-o", target, "--layers", "decoder"), "no convolution under decoder; there are"),
    ]:
        done = quantise(*arguments)
        assert done.returncode == 2 and message in done.stderr and done.stderr.count("\n") == 1
        assert not target.exists()
