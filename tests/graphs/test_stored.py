"""Stored graphs: opened in place of a network's own where they serve, and computing the same."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import refusing

from tinysplat_runtime.errors import ModelError
from tinysplat_runtime.graphs import DEFAULT_MODEL
from tinysplat_runtime.graphs.artifacts import find_artifact, load_manifest, models_dir
from tinysplat_runtime.graphs.inference import open_graph
from tinysplat_runtime.graphs.providers import CPU

NAME = "analysis_project"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Models of which one has a stored graph, the same file."""
    data = (models_dir() / f"{NAME}.onnx").read_bytes()
    for name in (NAME, "stored"):
        (tmp_path / f"{name}.onnx").write_bytes(data)
    entry = load_manifest()[NAME].entry
    stored = {"file": "stored.onnx", "sha256": entry["sha256"]}
    (tmp_path / "manifest.json").write_text(json.dumps({"artifacts": {NAME: {**entry, "optimised": stored}}}))
    return tmp_path


@pytest.mark.parametrize("provider", [CPU, (CPU, {"enable_arena": "1"})])
def test_the_cpu_opens_the_stored_graph(folder, provider) -> None:
    artifact = find_artifact(NAME, "analysis", folder)
    (folder / f"{NAME}.onnx").write_bytes(b"other")
    assert open_graph(artifact, NAME, providers=(provider,)).name == NAME


@pytest.mark.parametrize("is_listed", [False, True], ids=["altered", "no graph"])
def test_where_it_does_not_open_the_graph_itself_does(folder, is_listed) -> None:
    (folder / "stored.onnx").write_bytes(b"other")
    artifact = find_artifact(NAME, "analysis", folder)
    if is_listed:
        artifact = replace(artifact, optimised=(folder / "stored.onnx", hashlib.sha256(b"other").hexdigest()))
    assert open_graph(artifact, NAME).name == NAME
    (folder / f"{NAME}.onnx").write_bytes(b"other")
    with refusing(ModelError, f"{folder / NAME}.onnx"):
        open_graph(artifact, NAME)


def test_what_is_stored_of_the_network_computes_what_it_does() -> None:
    rng, views = np.random.default_rng(3), 2
    pose = np.eye(4, dtype=np.float32)[None].repeat(views, 0)
    pose[:, 0, 3] = -0.2, 0.2
    inputs = {
        "images": rng.uniform(size=(views, 3, 32, 48)).astype(np.float32),
        "K": np.array([[[1, 0, 0.5], [0, 1.5, 0.5], [0, 0, 1]]], np.float32).repeat(views, 0),
        "c2w": pose,
        "near": np.full(views, 1, np.float32),
        "far": np.full(views, 9, np.float32),
    }
    artifact = find_artifact(DEFAULT_MODEL, "network")
    assert artifact.for_cpu().path != artifact.path
    stored, own = (open_graph(one, "network").run(inputs) for one in (artifact, replace(artifact, optimised=None)))
    assert stored.keys() == own.keys()
    for name, wanted in own.items():  # the same bits; a version may round otherwise, which a few pixels make more of
        error = np.abs(stored[name] - wanted) / np.abs(wanted).max()
        assert np.quantile(error, 0.99) <= 1e-4, name
