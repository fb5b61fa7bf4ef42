"""The decoder's graph in onnxruntime-web under node, beside onnxruntime on this machine.

    npm install onnxruntime-web
    python checks/web.py F.tsplat

Decodes F with synthesis.onnx as usual, keeps what goes into the graph and what comes out, has `web.mjs` run the same
graph in WebAssembly, and compares.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import tinysplat_runtime as ts
from tinysplat_runtime.graphs.artifacts import find_artifact
from tinysplat_runtime.graphs.inference import Graph

RELATIVE_TOLERANCE = 1e-5  # of an array's largest value: float32 sums in another order

NODE_TYPES = {"uint16": "uint16", "float32": "float32"}


def record(file: str) -> tuple[dict[str, NDArray], dict[str, NDArray]]:
    """Inputs and outputs of the synthesis graph for the first part of `file`'s first layer that is decoded.

    The decoder runs the graph's halves, geometry and colours, one by one; what the other half needs is then a stand-in
    of any size, so that the larger array of a name is the real one.
    """
    inputs: dict[str, NDArray] = {}
    outputs: dict[str, NDArray] = {}
    run_into = Graph.run_into

    def recording(self: Graph, given: Mapping[str, NDArray], wanted: Mapping[str, NDArray]) -> None:
        run_into(self, given, wanted)
        if not set(wanted) & set(outputs):
            outputs.update({name: array.copy() for name, array in wanted.items()})
            for name, array in given.items():
                if name not in inputs or array.size > inputs[name].size:
                    inputs[name] = array.copy()

    Graph.run_into = recording  # type: ignore[method-assign]
    try:
        ts.Runtime(threads=1).decompress(Path(file).read_bytes())
    finally:
        Graph.run_into = run_into  # type: ignore[method-assign]
    return inputs, outputs


def main(file: str) -> int:
    """Run the check; returns the exit status."""
    inputs, expected = record(file)
    model = find_artifact("synthesis", "synthesis").path
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        table = {}
        for key, array in inputs.items():
            array = np.ascontiguousarray(array)
            (folder / key).write_bytes(array.tobytes())
            table[key] = {"type": NODE_TYPES[array.dtype.name], "shape": array.shape}
        (folder / "inputs.json").write_text(json.dumps(table))
        script = Path(__file__).with_name("web.mjs")
        subprocess.run(["node", str(script), str(model), str(folder)], check=True)
        faults = 0
        for key, array in expected.items():
            found = np.frombuffer((folder / f"out_{key}").read_bytes(), np.float32).reshape(array.shape)
            error = float(np.abs(found - array).max() / max(np.abs(array).max(), 1e-30))
            faults += not error <= RELATIVE_TOLERANCE
            print(f"{key:10} {array.shape} differs by {error:.2g} of its largest value")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
