"""Store what onnxruntime makes of a network's graph when it opens it, so that it opens in about half the time.

    python -m export.optimised edge

Writes models/NAME.optimised.onnx beside models/NAME.onnx, by which files of photos go on naming the network, and enters
it in the manifest. Its operators are onnxruntime's own where it joins some, but bind no processor.
"""

import argparse
import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import onnxruntime

from tinysplat_runtime.graphs.artifacts import MANIFEST, find_artifact
from tinysplat_runtime.graphs.inference import open_graph

from .inputs import example_inputs
from .manifest import MODELS

SIZES = ((2, 64, 96), (3, 96, 64))
"""Of photos on which both graphs have to compute the same."""


def store(source: Path, target: Path) -> None:
    """Write the graph after all optimisations but those for one processor."""
    options = onnxruntime.SessionOptions()
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_EXTENDED
    options.optimized_model_filepath = str(target)
    onnxruntime.InferenceSession(str(source), options, providers=["CPUExecutionProvider"])
    model = onnx.load(str(target))
    used = {node.domain for node in model.graph.node}
    imports = [entry for entry in model.opset_import if entry.domain in used]  # of others, older versions know fewer
    del model.opset_import[:]
    model.opset_import.extend(imports)
    onnx.save(model, str(target))


def main() -> None:
    """Write one network's stored graph."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", help="a network of models/")
    artifact = replace(find_artifact(parser.parse_args().name, "network", MODELS), optimised=None)
    target = MODELS / f"{artifact.name}.optimised.onnx"
    store(artifact.path, target)
    data = target.read_bytes()
    digest = hashlib.sha256(data).hexdigest()
    graphs = [open_graph(one, "network") for one in (artifact, replace(artifact, path=target, sha256=digest))]
    for size in SIZES:
        inputs = {name: tensor.numpy() for name, tensor in example_inputs(*size).items()}
        first, second = (graph.run(inputs) for graph in graphs)
        if not all(np.array_equal(first[name], second[name]) for name in first):
            raise SystemExit(f"{target}: computes something else than {artifact.path}; not entered")
    manifest = json.loads((MODELS / MANIFEST).read_text("utf-8"))
    manifest["artifacts"][artifact.name]["optimised"] = {
        "file": target.name,
        "sha256": digest,
        "bytes": len(data),
        "made_by": "export/optimised.py",
    }
    (MODELS / MANIFEST).write_text(json.dumps(manifest, indent=2, ensure_ascii=False) + "\n", "utf-8")
    print(target, len(data))


if __name__ == "__main__":
    main()
