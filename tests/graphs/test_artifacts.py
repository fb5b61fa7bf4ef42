"""Where models are looked for, what a manifest vouches for, and what a graph must be to be opened."""

import hashlib
import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import pytest
from hostile.graphs import network_seeds
from scenes import refusing

from tinysplat_runtime.errors import ModelError
from tinysplat_runtime.graphs import inference
from tinysplat_runtime.graphs.artifacts import Artifact, find_artifact, load_manifest, models_dir, network_by_hash
from tinysplat_runtime.graphs.inference import CONTRACTS

Change = Callable[[onnx.ModelProto], object]

DATA = {"net1": b"first", "net2": b"second", "back": b"third"}
HASHES = {name: hashlib.sha256(data).hexdigest() for name, data in DATA.items()}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two networks and a synthesis with their manifest."""
    roles = {"net1": "network", "net2": "network", "back": "synthesis"}
    entries = {n: {"file": f"{n}.onnx", "role": roles[n], "sha256": HASHES[n], "purpose": n} for n in DATA}
    (tmp_path / "manifest.json").write_text(json.dumps({"artifacts": entries}))
    for name, data in DATA.items():
        (tmp_path / f"{name}.onnx").write_bytes(data)
    return tmp_path


def test_a_manifest_names_files_roles_and_hashes(folder: Path) -> None:
    found = load_manifest(folder)
    assert found.keys() == DATA.keys() and found["back"].role == "synthesis"
    one = found["net1"]
    assert one.path == folder / "net1.onnx" and one.entry["purpose"] == "net1" and one.read() == b"first"
    assert one.file_sha256() == HASHES["net1"] == Artifact("own", one.path).file_sha256()


ENTRY = {"file": "x", "role": "network", "sha256": "0", "optimised": {"file": "y"}}  # whose stored graph has no hash


@pytest.mark.parametrize(
    "text", ["{", "[]", "{}", '{"artifacts": 3}', '{"artifacts": {"a": {}}}', json.dumps({"artifacts": {"a": ENTRY}})]
)
def test_what_is_no_manifest_is_refused(folder: Path, text: str) -> None:
    (folder / "manifest.json").write_text(text)
    with refusing(ModelError, f"{folder / 'manifest.json'}"):
        load_manifest(folder)


def test_the_folder_is_the_argument_or_the_variable_s_or_the_package_s(
    folder: Path, tmp_path: Path, monkeypatch
) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    monkeypatch.setenv("TINYSPLAT_MODELS", str(folder))
    assert models_dir() == folder
    with refusing(ModelError, f"manifest.json {empty}"):
        models_dir(empty)
    monkeypatch.setenv("TINYSPLAT_MODELS", str(empty))
    with refusing(ModelError, f"TINYSPLAT_MODELS {empty}"):
        models_dir()
    monkeypatch.delenv("TINYSPLAT_MODELS")
    monkeypatch.delitem(sys.modules, "tinysplat_models", raising=False)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "tinysplat_models").mkdir()
    for name in ("__init__.py", "manifest.json"):
        (tmp_path / "tinysplat_models" / name).touch()
    assert models_dir() == tmp_path / "tinysplat_models"


def test_altered_and_missing_files_are_refused(folder: Path) -> None:
    found = load_manifest(folder)
    (folder / "net1.onnx").write_bytes(b"altered")
    altered = hashlib.sha256(b"altered").hexdigest()
    with refusing(ModelError, f"{folder / 'net1.onnx'} {altered[:8]} {HASHES['net1'][:8]}"):
        found["net1"].read()
    (folder / "net2.onnx").unlink()
    with refusing(ModelError, f"{folder / 'net2.onnx'}"):
        found["net2"].read()


def test_a_name_is_of_the_manifest_or_a_path(folder: Path) -> None:
    assert find_artifact("net1", "network", folder).sha256 == HASHES["net1"]
    for path in (folder / "net1.onnx", folder / "own.ort", folder / "plain"):
        path.write_bytes(b"x")
        found = find_artifact(str(path), "network", folder)
        assert (found.name, found.path, found.sha256, found.role) == (path.stem, path, None, None)
    for name in ("other", "back"):
        with refusing(ModelError, f"'{name}' net1 net2"):
            find_artifact(name, "network", folder)
    for name in ("none.onnx", "x/y", "none.ort"):
        with refusing(ModelError, name):
            find_artifact(name, "network", folder)


def test_a_network_is_found_by_its_hash(folder: Path) -> None:
    one, two = HASHES["net1"], HASHES["net2"]
    assert network_by_hash("whatever", two, folder=folder).name == "net2"
    assert network_by_hash("net1", one, "net1", folder).name == "net1"
    assert network_by_hash("net1", two, str(folder / "net2.onnx"), folder).path == folder / "net2.onnx"
    with refusing(ModelError, f"{folder / 'net2.onnx'} {one}"):
        network_by_hash("net1", one, "net2", folder)
    for name in ("net1", "other"):
        with refusing(ModelError, f"'{name}' {HASHES['back']} --model"):
            network_by_hash(name, HASHES["back"], folder=folder)


# ---- contracts ------------------------------------------------------------------------------------------------------


def test_files_that_are_no_graphs_are_refused(tmp_path: Path) -> None:
    (tmp_path / "x.onnx").write_bytes(b"nothing")
    with refusing(ModelError, f"{tmp_path / 'x.onnx'}"):
        inference.open_graph(Artifact("x", tmp_path / "x.onnx"), "network")


def rank(name: str, number: int) -> Change:
    return lambda model: next(one for one in model.graph.input if one.name == name).type.tensor_type.shape.dim.extend(
        [onnx.TensorShapeProto.Dimension()] * number
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda model: model.graph.output.pop(), "output 'sh'"),
        (rank("near", 1), "input 'near' of rank 2, expected 1"),
        (
            lambda model: model.graph.input.append(onnx.helper.make_tensor_value_info("extra", 6, [1])),
            "input 'extra' beside K c2w",
        ),
        (lambda model: onnx.helper.set_model_props(model, {"tinysplat": '{"contract": 2}'}), "version 2"),
    ],
)
def test_a_graph_says_what_breaks_its_contract(tmp_path: Path, change: Change, said: str) -> None:
    model = onnx.load_from_string(network_seeds()[0])
    change(model)
    (tmp_path / "x.onnx").write_bytes(model.SerializeToString())
    with refusing(ModelError, said) as caught:
        inference.open_graph(Artifact("x", tmp_path / "x.onnx"), "network")
    assert caught.value.where == str(tmp_path / "x.onnx")


def test_a_graph_runs_and_writes_into_arrays_and_says_in_a_line_what_it_cannot(tmp_path: Path) -> None:
    (tmp_path / "x.onnx").write_bytes(network_seeds()[0])
    graph = inference.open_graph(Artifact("x", tmp_path / "x.onnx"), "network", threads=1)
    assert graph.metadata["stride"] == 4 and set(graph.output_names) == set(CONTRACTS["network"].outputs)
    images = np.random.default_rng(0).random((2, 3, 8, 12), np.float32)
    inputs = {"images": images, "K": np.zeros((2, 3, 3)), "c2w": np.zeros((2, 4, 4)), "near": [1, 1], "far": [9, 9]}
    inputs = {name: inference.as_input(array) for name, array in inputs.items()}
    found = graph.run(inputs)
    np.testing.assert_allclose(found["means"], images.transpose(0, 2, 3, 1) + np.float32([0, 0, 2]), rtol=1e-6)
    means = np.zeros_like(found["means"])
    graph.run_into(inputs, {"means": means})
    assert np.array_equal(means, found["means"]) and graph.run(inputs, ["sh"]).keys() == {"sh"}
    wrong = {**inputs, "near": np.float64([1, 1])}
    for run in (lambda: graph.run(wrong), lambda: graph.run_into({"images": images[0]}, {"means": means})):
        with pytest.raises(ModelError) as caught:
            run()
        assert caught.value.where == "x" and "\n" not in str(caught.value)
