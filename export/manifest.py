"""Write an exported graph into models/ and its entry into manifest.json, once parity has been shown."""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

import onnx

from tinysplat_runtime.graphs.inference import CONTRACT_VERSION
from tinysplat_runtime.system.jsonfields import JsonObject

ROOT = Path(__file__).resolve().parents[1]
MODELS = ROOT / "models"
MAX_IR_VERSION = 10  # what every onnxruntime that is allowed reads
OPSET = 18


def add_metadata(path: Path, metadata: JsonObject) -> None:
    """Stamp role, contract, ranges, licence and provenance into the file; lower its IR version."""
    model = onnx.load(str(path))
    stamp(model, metadata)
    onnx.save(model, str(path))


def stamp(model: onnx.ModelProto, metadata: JsonObject) -> None:
    """As `add_metadata`, on a model in memory."""
    model.ir_version = min(model.ir_version, MAX_IR_VERSION)
    model.producer_name, model.producer_version, model.doc_string = "tinysplat", "", ""
    _drop_debris(model)
    del model.metadata_props[:]
    entry = model.metadata_props.add()
    entry.key, entry.value = "tinysplat", json.dumps({"contract": CONTRACT_VERSION, **metadata}, sort_keys=True)
    onnx.checker.check_model(model)


def _drop_debris(model: onnx.ModelProto) -> None:
    """Remove the exporter's notes, in subgraphs too: they hold stack traces with paths of the exporting machine."""
    for function in model.functions:
        _clear_notes([function, *function.node])
    _drop_from_graph(model.graph)


def _drop_from_graph(graph: onnx.GraphProto) -> None:
    _clear_notes([graph, *graph.node, *graph.value_info, *graph.initializer, *graph.input, *graph.output])
    for node in graph.node:
        for attribute in node.attribute:
            for inner in (attribute.g, *attribute.graphs):
                if inner.node:
                    _drop_from_graph(inner)


def _clear_notes(holders: Sequence[object]) -> None:
    for holder in holders:
        if hasattr(holder, "metadata_props"):
            del holder.metadata_props[:]
        holder.doc_string = ""


def register(name: str, path: Path, role: str, parity: dict[str, float], **facts: object) -> None:
    """Write the manifest entry of an artifact.

    Args:
        name: its name for users.
        path: the .onnx file, inside models/.
        role: network, analysis or synthesis.
        parity: largest torch-onnx difference by output; every one must be finite.
        facts: licence, provenance and whatever else the entry should say.
    """
    if not all(value < float("inf") for value in parity.values()):
        raise SystemExit(f"{name}: parity {parity} is not finite; no manifest entry is written")
    target = MODELS / "manifest.json"
    manifest = json.loads(target.read_text()) if target.exists() else {"artifacts": {}}
    opset = next(o.version for o in onnx.load(str(path), load_external_data=False).opset_import if o.domain == "")
    manifest["artifacts"][name] = {
        "file": path.name,
        "role": role,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "bytes": path.stat().st_size,
        "opset": opset,
        "contract": CONTRACT_VERSION,
        "parity": {key: float(f"{value:.3g}") for key, value in parity.items()},
        **facts,
    }
    manifest["artifacts"] = dict(sorted(manifest["artifacts"].items()))
    target.write_text(json.dumps(manifest, indent=2, ensure_ascii=False) + "\n", "utf-8")
