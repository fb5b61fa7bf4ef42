"""Where models are looked for, what a manifest vouches for, and what a graph must be to be opened."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tinysplat_runtime.errors import InputError, ModelError
from tinysplat_runtime.graphs import artifacts, inference, providers
from tinysplat_runtime.graphs.artifacts import Artifact, find_artifact, load_manifest, models_dir, network_by_hash
from tinysplat_runtime.graphs.inference import CONTRACTS, Graph, GraphStore, _check_contract, _metadata, as_input
from tinysplat_runtime.graphs.providers import add_providers, first_line, known_providers, nodes_by_provider

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


@pytest.mark.parametrize("text", ["{", "[]", "{}", '{"artifacts": 3}', '{"artifacts": {"a": {"file": "x"}}}'])
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
    assert refused(error) == f"models: no manifest.json in {empty}; set TINYSPLAT_MODELS to the folder that has it"
    monkeypatch.setenv("TINYSPLAT_MODELS", str(empty))
    with pytest.raises(ModelError) as error:
        models_dir()
    advice = "unset it for the models that came with this"
    assert refused(error) == f"TINYSPLAT_MODELS: no manifest.json in {empty}; {advice}"
    monkeypatch.delenv("TINYSPLAT_MODELS")
    spec = SimpleNamespace(submodule_search_locations=[str(empty), str(folder)])
    monkeypatch.setattr(
        artifacts.importlib.util, "find_spec", lambda name: spec if name == "tinysplat_models" else None
    )
    assert models_dir() == folder
    monkeypatch.setattr(artifacts.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(artifacts, "MANIFEST", "surely-no-file")
    with pytest.raises(ModelError, match=rf"in {Path(artifacts.__file__).resolve().parents[2] / 'models'}; set"):
        models_dir()


def test_altered_and_missing_files_are_refused(folder: Path) -> None:
    found = load_manifest(folder)
    (folder / "a.onnx").write_bytes(b"altered")
    altered = hashlib.sha256(b"altered").hexdigest()
    with pytest.raises(ModelError) as error:
        found["a"].read()
    assert refused(error) == f"{folder / 'a.onnx'}: sha256 {altered[:12]}…, manifest says {HASHES['a'][:12]}…"
    (folder / "b.onnx").unlink()
    with pytest.raises(ModelError) as error:
        found["b"].read()
    assert refused(error) == f"{folder / 'b.onnx'}: cannot be read (No such file or directory)"


def test_a_name_is_of_the_manifest_or_a_path(folder: Path) -> None:
    assert find_artifact("a", "network", folder).sha256 == HASHES["a"]
    for path in (folder / "a.onnx", folder / "own.ort", folder / "plain"):
        path.write_bytes(b"x")
        found = find_artifact(str(path), "network", folder)
        assert (found.name, found.path, found.sha256, found.role) == (path.stem, path, None, None)
    for name in ("c", "s"):
        with pytest.raises(ModelError) as error:
            find_artifact(name, "network", folder)
        assert refused(error) == f"model: unknown network '{name}'; there are a, b, or give the path of an .onnx file"
    for name in ("none.onnx", "x/y", "none.ort"):
        with pytest.raises(ModelError) as error:
            find_artifact(name, "network", folder)
        assert (
            refused(error) == f"{name}: no such file; expected an ONNX network or a name listed by `tinysplat models`"
        )


def test_a_network_is_found_by_its_hash(folder: Path) -> None:
    assert network_by_hash("whatever", HASHES["b"], folder=folder).name == "b"
    assert network_by_hash("a", HASHES["a"], "a", folder).name == "a"
    assert network_by_hash("a", HASHES["b"], str(folder / "b.onnx"), folder).path == folder / "b.onnx"
    with pytest.raises(ModelError) as error:
        network_by_hash("a", HASHES["a"], "b", folder)
    assert (
        refused(error)
        == f"{folder / 'b.onnx'}: sha256 {HASHES['b'][:12]}…, the file needs network 'a' of sha256 {HASHES['a']}"
    )
    for name, other in (("a", f"; the 'a' at hand is another (sha256 {HASHES['a'][:12]}…)"), ("z", "")):
        with pytest.raises(ModelError) as error:
            network_by_hash(name, HASHES["s"], folder=folder)
        said = f"model: network '{name}' of sha256 {HASHES['s']} is not at hand{other}"
        assert refused(error) == f"{said}; give its file with --model FILE.onnx"


def test_a_store_opens_each_graph_once_and_says_what_it_opens(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Any] = []

    def opens(artifact: Artifact, contract: str, **options: Any) -> Graph:
        opened.append((artifact.name, contract, options))
        return Graph(artifact.name, SimpleNamespace(end_profiling=lambda: artifact.name))

    monkeypatch.setattr(inference, "open_graph", opens)
    monkeypatch.setattr(inference, "nodes_by_provider", lambda name: {"CPU": len(name)})
    store = GraphStore(threads=3, providers=["X"], models=folder, profile="notes")
    assert store.network("a") is store.network("a") and store.network_by_hash("b", HASHES["b"]).name == "b"
    (folder / "own.onnx").write_bytes(b"own")
    own = str(folder / "own.onnx")
    assert store.network_by_hash("own", hashlib.sha256(b"own").hexdigest(), own).name == "own"
    (folder / "manifest.json").write_text((folder / "manifest.json").read_text().replace('"s"', '"synthesis"'))
    store.transform("synthesis")
    plain = {"threads": None, "providers": ("X",), "profile": "notes/network"}
    assert opened == [
        ("a", "network", plain), ("b", "network", plain), ("own", "network", plain),
        ("synthesis", "synthesis", {**plain, "threads": 3, "profile": "notes/synthesis"}),
    ]  # fmt: skip
    assert store.nodes_by_provider() == {"a": {"CPU": 1}, "b": {"CPU": 1}, own: {"CPU": 3}, "synthesis": {"CPU": 9}}
    assert store.network_ref("a") == ("a", HASHES["a"]) and store.network_ref(own)[0] == "own"
    assert store.shipped_network("a") == "a" and store.shipped_network(own) is None
    assert store.enlarger() is None


# ---- contracts ------------------------------------------------------------------------------------------------------


def tensors(**changes: Any) -> dict[str, dict[str, tuple[str, int]]]:
    contract = CONTRACTS["network"]
    found = {"input": dict(contract.inputs), "output": dict(contract.outputs)}
    for key, value in changes.items():
        kind, name = key.split("_", 1)
        if value is None:
            del found[kind][name]
        else:
            found[kind][name] = value
    return found


@pytest.mark.parametrize(
    ("changes", "metadata", "line"),
    [
        ({}, {"contract": 2}, "contract version 2, this runtime speaks 1"),
        ({"input_near": None}, {}, "input 'near' is missing; it has no other"),
        ({"output_sh": None, "output_x": ("t", 1)}, {}, "output 'sh' is missing; it has x"),
        ({"input_K": ("tensor(double)", 3)}, {},
         "input 'K' is tensor(double) of rank 3, expected tensor(float) of rank 3"),
        ({"output_means": ("tensor(float)", 3)}, {},
         "output 'means' is tensor(float) of rank 3, expected tensor(float) of rank 4"),
        ({"input_more": ("t", 1)}, {}, "input 'more' is not in the contract (images, K, c2w, near, far)"),
    ],
)  # fmt: skip
def test_graphs_outside_the_contract_are_refused(changes: dict[str, Any], metadata: dict[str, Any], line: str) -> None:
    with pytest.raises(ModelError) as error:
        _check_contract(Graph("g", None, metadata), tensors(**changes), CONTRACTS["network"], "g.onnx")
    assert refused(error) == f"g.onnx: {line}"


def test_graphs_may_say_nothing_of_themselves_and_have_more_outputs() -> None:
    for metadata in ({}, {"contract": 1}):
        _check_contract(Graph("g", None, metadata), tensors(output_more=("t", 1)), CONTRACTS["network"], "")


@pytest.mark.parametrize(("text", "value"), [('{"a": 1}', {"a": 1}), ("[1]", {}), ("{", {}), (None, {})])
def test_metadata_is_an_object_or_none(text: str | None, value: dict[str, int]) -> None:
    given = {} if text is None else {"tinysplat": text}
    session = SimpleNamespace(get_modelmeta=lambda: SimpleNamespace(custom_metadata_map=given))
    assert _metadata(session) == value


def test_files_that_are_no_graphs_are_refused(tmp_path: Path) -> None:
    (tmp_path / "x.onnx").write_bytes(b"nothing")
    with pytest.raises(ModelError, match=r"x\.onnx: not a graph onnxruntime can run: "):
        inference.open_graph(Artifact("x", tmp_path / "x.onnx"), "network")


class Session:
    """Returns what it is asked for, or fails."""

    def __init__(self) -> None:
        self.asked: list[Any] = []

    def run(self, names: list[str], inputs: dict[str, Any], *options: Any) -> list[str]:
        self.asked.append((names, inputs, len(options)))
        if "bad" in names:
            raise RuntimeError("first line\nsecond")
        return [name.upper() for name in names]


def test_a_graph_gives_the_outputs_asked_for_or_all() -> None:
    session = Session()
    graph = Graph("g", session, output_names=("a", "b"))
    assert graph.run({"x": 1}) == {"a": "A", "b": "B"} and graph.run({}, ["b"]) == {"b": "B"}
    Graph("g", session, output_names=("a",), lets_go=True).run({})
    assert session.asked == [(["a", "b"], {"x": 1}, 0), (["b"], {}, 0), (["a"], {}, 1)]
    with pytest.raises(ModelError) as error:
        graph.run({}, ["bad"])
    assert refused(error) == "g: onnxruntime: first line"


def test_inputs_lie_row_by_row_in_the_graph_s_type() -> None:
    found = as_input(np.arange(6.0).reshape(2, 3).T)
    assert found.dtype == np.float32 and found.flags.c_contiguous and found[2].tolist() == [2, 5]


# ---- providers ------------------------------------------------------------------------------------------------------


def device(name: str, kind: str) -> SimpleNamespace:
    return SimpleNamespace(ep_name=name, device=SimpleNamespace(vendor="V", type=SimpleNamespace(name=kind)))


class Library:
    """Stands for onnxruntime with one plug-in."""

    __version__ = "9.9"

    def __init__(self, devices: list[SimpleNamespace]) -> None:
        self.devices, self.registered = devices, list[tuple[str, str]]()

    def get_available_providers(self) -> list[str]:
        return ["CPUExecutionProvider"]

    def get_ep_devices(self) -> list[SimpleNamespace]:
        return [device("CPUExecutionProvider", "CPU"), *(self.devices if self.registered else [])]

    def register_execution_provider_library(self, name: str, path: str) -> None:
        self.registered.append((name, path))
        if path.endswith("bad"):
            raise RuntimeError("cannot load\nat all")


class Options:
    def __init__(self) -> None:
        self.added: list[Any] = []

    def add_provider_for_devices(self, devices: list[Any], own: dict[str, str]) -> None:
        self.added.append(([d.device.type.name for d in devices], own))

    def add_provider(self, name: str, own: dict[str, str]) -> None:
        if "fails" in own:
            raise RuntimeError("no such option\nx")
        self.added.append((name, own))


def test_built_in_providers_are_named_and_each_once() -> None:
    found = add_providers(Library([]), Options(), ["CPU", ("CPUExecutionProvider", {"a": "b"})])
    assert found == [("CPUExecutionProvider", {})]


def test_a_plug_in_is_loaded_once_and_runs_on_the_device_asked_for(tmp_path: Path) -> None:
    library, options = Library([device("Toy", "GPU"), device("Toy", "NPU"), device("Toy", "GPU")]), Options()
    toy = ("Toy", {"library": str(tmp_path / "toy.so"), "x": "1"})
    assert add_providers(library, options, [toy, "CPU"]) is None
    assert options.added == [(["GPU"], {"x": "1"}), ("CPUExecutionProvider", {})]
    add_providers(library, options, [("Toy", {**toy[1], "device_type": "NPU"})])
    assert options.added[2] == (["NPU"], {"x": "1"}) and library.registered == [("Toy", str(tmp_path / "toy.so"))]
    for own, line in (
        ({"device_type": "TPU"}, "ToyExecutionProvider has no TPU, its device_type here is GPU or NPU"),
        ({}, None),
    ):
        if line:
            with pytest.raises(ModelError) as error:
                add_providers(library, options, [("Toy", {**toy[1], **own})])
            assert refused(error) == f"provider: {line}"


@pytest.mark.parametrize(
    ("library", "given", "line"),
    [
        (Library([]), {"library": "toy.so"},
         "ToyExecutionProvider is there and takes no device of this machine (V CPU)"),
        (Library([]), {"library": "toy.bad"}, "ToyExecutionProvider: cannot load"),
        (Library([]), {},
         "execution provider ToyExecutionProvider is not in this onnxruntime; it has CPUExecutionProvider"),
    ],
)  # fmt: skip
def test_plug_ins_that_do_not_work_are_said(
    monkeypatch: pytest.MonkeyPatch, library: Any, given: Any, line: str
) -> None:
    monkeypatch.setattr(providers, "_plugins", dict)
    with pytest.raises(ModelError) as error:
        add_providers(library, Options(), [("Toy", given)])
    assert refused(error) == f"provider: {line}"


def test_options_that_a_provider_refuses_are_said(tmp_path: Path) -> None:
    library = Library([device("Toy", "GPU")])
    toy = ("Toy", {"library": str(tmp_path / "toy.so")})
    with pytest.raises(ModelError) as error:
        add_providers(library, Options(), [toy, ("CPU", {"fails": "1"})])
    assert refused(error) == "provider: CPUExecutionProvider: no such option"


def test_known_providers_are_those_built_in_and_those_of_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(providers, "_plugins", lambda: {"Toy": 1, "CPUExecutionProvider": 2})
    assert known_providers(Library([])) == ["CPUExecutionProvider", "Toy"]


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


def test_of_an_error_the_first_line_is_said() -> None:
    assert first_line(ValueError("\n a\nb")) == "a" and first_line(ValueError("x" * 400)) == "x" * 300


@pytest.mark.parametrize("name", [name for name in CONTRACTS if name != "network"])
def test_shipped_graphs_are_within_their_contracts(name: str) -> None:
    """And have every input at its rank and type, as onnx says it."""
    import onnx

    graph = GraphStore().transform(name)
    model = onnx.load(str(find_artifact(name, name.split("_")[0]).path), load_external_data=False).graph
    kinds = {onnx.TensorProto.FLOAT: "tensor(float)", onnx.TensorProto.UINT16: "tensor(uint16)"}
    for found, wanted in ((model.input, CONTRACTS[name].inputs), (model.output, CONTRACTS[name].outputs)):
        types = {value.name: value.type.tensor_type for value in found}
        assert {n: (kinds[t.elem_type], len(t.shape.dim)) for n, t in types.items()} == dict(wanted)
    assert graph.name == name and not graph.lets_go
