"""Where models are looked for, what a manifest vouches for, and what a graph must be to be opened."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import pytest
from hostile.graphs import network_seeds
from scenes import refusing

from tinysplat_runtime.errors import InputError, ModelError
from tinysplat_runtime.graphs import DEFAULT_MODEL, inference, providers
from tinysplat_runtime.graphs.artifacts import Artifact, find_artifact, load_manifest, models_dir, network_by_hash
from tinysplat_runtime.graphs.inference import CONTRACTS, GraphStore
from tinysplat_runtime.graphs.providers import nodes_by_provider

Change = Callable[[onnx.ModelProto], object]

DATA = {"a": b"first", "b": b"second", "s": b"third"}
HASHES = {name: hashlib.sha256(data).hexdigest() for name, data in DATA.items()}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two networks and a synthesis with their manifest."""
    roles = {"a": "network", "b": "network", "s": "synthesis"}
    entries = {n: {"file": f"{n}.onnx", "role": roles[n], "sha256": HASHES[n], "purpose": n} for n in DATA}
    (tmp_path / "manifest.json").write_text(json.dumps({"artifacts": entries}))
    for name, data in DATA.items():
        (tmp_path / f"{name}.onnx").write_bytes(data)
    return tmp_path


def refused(error: pytest.ExceptionInfo[ModelError]) -> str:
    return str(error.value)


def test_a_manifest_names_files_roles_and_hashes(folder: Path) -> None:
    found = load_manifest(folder)
    assert [*found] == ["a", "b", "s"] and found["s"].role == "synthesis" and found["a"].path == folder / "a.onnx"
    assert found["a"].entry["purpose"] == "a" and found["a"].read() == b"first"
    assert found["a"].file_sha256() == HASHES["a"] == Artifact("own", folder / "a.onnx").file_sha256()


ENTRY = {"file": "x", "role": "network", "sha256": "0", "optimised": {"file": "y"}}  # whose stored graph has no hash


@pytest.mark.parametrize(
    "text", ["{", "[]", "{}", '{"artifacts": 3}', '{"artifacts": {"a": {}}}', json.dumps({"artifacts": {"a": ENTRY}})]
)
def test_what_is_no_manifest_is_refused(folder: Path, text: str) -> None:
    (folder / "manifest.json").write_text(text)
    with pytest.raises(ModelError) as error:
        load_manifest(folder)
    assert refused(error).startswith(f"{folder / 'manifest.json'}: not a manifest of artifacts (")


def test_the_folder_is_the_argument_or_the_variable_s_or_the_package_s(
    folder: Path, tmp_path: Path, monkeypatch
) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    monkeypatch.setenv("TINYSPLAT_MODELS", str(folder))
    assert models_dir() == folder
    with pytest.raises(ModelError) as error:
        models_dir(empty)
    assert f"no manifest.json in {empty}" in refused(error)
    monkeypatch.setenv("TINYSPLAT_MODELS", str(empty))
    with pytest.raises(ModelError) as error:
        models_dir()
    assert refused(error).startswith("TINYSPLAT_MODELS: ") and str(empty) in refused(error)


def test_altered_and_missing_files_are_refused(folder: Path) -> None:
    found = load_manifest(folder)
    (folder / "a.onnx").write_bytes(b"altered")
    altered = hashlib.sha256(b"altered").hexdigest()
    with pytest.raises(ModelError) as error:
        found["a"].read()
    assert all(word in refused(error) for word in (str(folder / "a.onnx"), altered[:12], HASHES["a"][:12]))
    (folder / "b.onnx").unlink()
    with pytest.raises(ModelError) as error:
        found["b"].read()
    assert refused(error).startswith(f"{folder / 'b.onnx'}: ")


def test_a_name_is_of_the_manifest_or_a_path(folder: Path) -> None:
    assert find_artifact("a", "network", folder).sha256 == HASHES["a"]
    for path in (folder / "a.onnx", folder / "own.ort", folder / "plain"):
        path.write_bytes(b"x")
        found = find_artifact(str(path), "network", folder)
        assert (found.name, found.path, found.sha256, found.role) == (path.stem, path, None, None)
    for name in ("c", "s"):
        with pytest.raises(ModelError) as error:
            find_artifact(name, "network", folder)
        assert all(word in refused(error) for word in (f"'{name}'", "a, b"))
    for name in ("none.onnx", "x/y", "none.ort"):
        with pytest.raises(ModelError) as error:
            find_artifact(name, "network", folder)
        assert refused(error).startswith(f"{name}: ")


def test_a_network_is_found_by_its_hash(folder: Path) -> None:
    assert network_by_hash("whatever", HASHES["b"], folder=folder).name == "b"
    assert network_by_hash("a", HASHES["a"], "a", folder).name == "a"
    assert network_by_hash("a", HASHES["b"], str(folder / "b.onnx"), folder).path == folder / "b.onnx"
    with pytest.raises(ModelError) as error:
        network_by_hash("a", HASHES["a"], "b", folder)
    assert refused(error).startswith(f"{folder / 'b.onnx'}: ") and HASHES["a"] in refused(error)
    for name, other in (("a", HASHES["a"][:12]), ("z", "")):
        with pytest.raises(ModelError) as error:
            network_by_hash(name, HASHES["s"], folder=folder)
        assert all(word in refused(error) for word in (f"'{name}'", HASHES["s"], other, "--model"))


# ---- contracts ------------------------------------------------------------------------------------------------------


def test_files_that_are_no_graphs_are_refused(tmp_path: Path) -> None:
    (tmp_path / "x.onnx").write_bytes(b"nothing")
    with pytest.raises(ModelError, match=r"x\.onnx: not a graph onnxruntime can run: "):
        inference.open_graph(Artifact("x", tmp_path / "x.onnx"), "network")


def rank(name: str, number: int) -> Change:
    return lambda model: next(one for one in model.graph.input if one.name == name).type.tensor_type.shape.dim.extend(
        [onnx.TensorShapeProto.Dimension()] * number
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda model: model.graph.output.pop(), "output 'sh' is missing; it has no other"),
        (rank("near", 1), "input 'near' is tensor(float) of rank 2, expected tensor(float) of rank 1"),
        (
            lambda model: model.graph.input.append(onnx.helper.make_tensor_value_info("extra", 6, [1])),
            "input 'extra' is not in the contract (images, K, c2w, near, far)",
        ),
        (
            lambda model: onnx.helper.set_model_props(model, {"tinysplat": '{"contract": 2}'}),
            "contract version 2, this",
        ),
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
        with pytest.raises(ModelError, match=r"^x: onnxruntime: [^\n]+$"):
            run()


# ---- providers ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", [None, ""])
def test_no_provider_is_the_cpu(text: str | None) -> None:
    assert providers.providers_of(text) == ("CPUExecutionProvider",)


def test_a_provider_has_the_cpu_behind_it() -> None:
    assert providers.providers_of("X:a=b") == (("X", {"a": "b"}), "CPUExecutionProvider")
    with pytest.raises(InputError, match=r"^--provider: 'a' in 'X:a', expected NAME:key=value"):
        providers.providers_of("X:a")


def test_nodes_are_counted_by_provider(tmp_path: Path) -> None:
    node = {"cat": "Node", "args": {"provider": "CPU"}}
    events = [node, node, {"cat": "Node", "args": {"provider": "X"}}, {"cat": "Node"}, {**node, "cat": "Session"}]
    (tmp_path / "p.json").write_text(json.dumps(events))
    assert nodes_by_provider(str(tmp_path / "p.json")) == {"CPU": 2, "X": 1}


@pytest.mark.parametrize("name", [name for name in CONTRACTS if name != "network"])
def test_shipped_graphs_are_within_their_contracts(name: str) -> None:
    """And have every input at its rank and type, as onnx says it."""
    role, _, stage = name.partition("_")
    is_stage = role == "stage"
    graph = GraphStore().stages(DEFAULT_MODEL)[stage] if is_stage else GraphStore().transform(name)
    model = onnx.load(str(find_artifact(graph.name, role).path), load_external_data=False).graph
    kinds = {onnx.TensorProto.FLOAT: "tensor(float)", onnx.TensorProto.UINT16: "tensor(uint16)"}
    for found, wanted in ((model.input, CONTRACTS[name].inputs), (model.output, CONTRACTS[name].outputs)):
        types = {value.name: value.type.tensor_type for value in found}
        has = {n: (kinds[t.elem_type], len(t.shape.dim)) for n, t in types.items()}
        assert wanted.items() <= has.items() and (stage == "finish" or len(has) == len(wanted))  # which may have layers
    assert is_stage or (graph.name == name and not graph.lets_go)
