"""A network for one number and size of photos: what compilers for NPUs want, as every shape is then known.

    python export/static.py models/edge.onnx 2x256x256 -o edge-2x256x256.onnx

The file holds standard operators alone, and what it says of itself. `export/network.py --static` does it on export.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import extra  # noqa: F401  (first: names what is missing)
import numpy as np
import onnx
import onnxruntime
from inputs import INPUT_AXES, example_inputs
from manifest import stamp
from onnxruntime.tools.onnx_model_utils import make_input_shape_fixed

from tinysplat_runtime.errors import InputError, NumericError, TinySplatError
from tinysplat_runtime.graphs.artifacts import Artifact
from tinysplat_runtime.graphs.inference import Graph, open_graph
from tinysplat_runtime.graphs.predict import NetworkLimits

Size = tuple[int, int, int]

TOLERANCE, QUANTILE = 1e-3, 0.99
"""Share of values that may not be off by more, relative to a tensor's largest: rounding decides what lies in front."""


def parse_size(text: str) -> Size:
    """`2x384x256`, the width before the height, to (views, height, width)."""
    parts = text.split("x")
    if len(parts) != 3 or not all(part.isdecimal() and int(part) for part in parts):
        raise argparse.ArgumentTypeError(f"'{text}', expected VIEWSxWIDTHxHEIGHT such as 2x256x256")
    return int(parts[0]), int(parts[2]), int(parts[1])


def fix_size(source: Path, target: Path, fixed: Size) -> None:
    """Write a network's artifact for one size: shape arithmetic folded, every tensor's shape stated.

    Args:
        source: an artifact of the role `network`.
        target: where to write; may be `source`.
        fixed: (V, H, W).

    Raises:
        InputError: the network does not take that size.
        NumericError: a shape in the graph depends on values, so that it cannot be fixed.
    """
    papers = dict(_checked(source, fixed).metadata)
    papers.pop("contract", None)
    model = onnx.load(str(source))
    dims = dict(zip("VHW", fixed, strict=True))
    for tensor in model.graph.input:
        shape = [dim.dim_value for dim in tensor.type.tensor_type.shape.dim]
        for axis, name in INPUT_AXES[tensor.name].items():
            shape[axis] = dims[name]
        make_input_shape_fixed(model.graph, tensor.name, shape)
    model = onnx.shape_inference.infer_shapes(_folded(model), data_prop=True)
    _state_shapes(model)
    views, height, width = fixed
    stamp(model, {**papers, "min_views": views, "max_views": views, "size": [height, width]})
    onnx.save(model, str(target))


def _checked(source: Path, fixed: Size) -> Graph:
    """The opened source, if it takes photos of that size without padding."""
    graph = open_graph(Artifact(source.stem, source), "network")
    limits = NetworkLimits.of(graph)
    views, *sides = fixed
    if not limits.min_views <= views <= limits.max_views:
        raise InputError(f"{views} views, {source.stem} takes {limits.min_views} to {limits.max_views}", where="size")
    if any(side % limits.stride or side < limits.min_side for side in sides):
        wanted = f"multiples of {limits.stride} from {limits.min_side} on"
        raise InputError(f"{sides[1]}x{sides[0]}, {source.stem} takes {wanted}", where="size")
    return graph


def _folded(model: onnx.ModelProto) -> onnx.ModelProto:
    """What onnxruntime's basic level leaves, which are standard operators: shapes' arithmetic is constants then."""
    options = onnxruntime.SessionOptions()
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
    options.log_severity_level = 4
    with tempfile.TemporaryDirectory() as folder:
        plain, folded = Path(folder, "plain.onnx"), Path(folder, "folded.onnx")
        onnx.save(model, str(plain))
        options.optimized_model_filepath = str(folded)
        onnxruntime.InferenceSession(str(plain), options, providers=["CPUExecutionProvider"])
        model = onnx.load(str(folded))
    standard = [opset for opset in model.opset_import if opset.domain == ""]  # it lists all domains that it knows
    del model.opset_import[:]
    model.opset_import.extend(standard)
    return model


def _state_shapes(model: onnx.ModelProto) -> None:
    """Give outputs the shapes that were inferred; NumericError where a tensor has none."""
    stated = {tensor.name: tensor for tensor in [*model.graph.value_info, *model.graph.output]}
    open_ended = [name for node in model.graph.node for name in node.output if name and not _is_fixed(stated.get(name))]
    if open_ended:
        raise NumericError(
            f"{len(open_ended)} shapes depend on values, the first that of {open_ended[0]}", where="size"
        )


def _is_fixed(tensor: onnx.ValueInfoProto | None) -> bool:
    shape = tensor.type.tensor_type.shape.dim if tensor is not None else ()
    has_shape = tensor is not None and tensor.type.tensor_type.HasField("shape")
    return has_shape and all(dim.HasField("dim_value") for dim in shape)


def differences(source: Path, target: Path, fixed: Size) -> Iterator[tuple[str, float]]:
    """|source − target| by output, relative to its largest magnitude, at the quantile, on an example."""
    inputs = {name: tensor.numpy() for name, tensor in example_inputs(*fixed).items()}
    one, other = (open_graph(Artifact(path.stem, path), "network").run(inputs) for path in (source, target))
    for name, want in one.items():
        error = np.nan_to_num(np.abs(other[name] - want), nan=np.inf) / max(float(np.abs(want).max()), 1e-30)
        yield name, float(np.quantile(error, QUANTILE))


def main() -> None:
    """Write the artifact and say what is in it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("network", type=Path, help="an artifact that export/network.py wrote")
    parser.add_argument("size", type=parse_size, metavar="VxWxH", help="of photos, such as 2x256x256")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args()
    try:
        if not options.output.absolute().parent.is_dir():
            raise InputError(f"no folder {options.output.parent} to write to", where="--output")
        fix_size(options.network, options.output, options.size)
        worst = max(off for _, off in differences(options.network, options.output, options.size))
        if worst > TOLERANCE:
            raise NumericError(f"differs from {options.network} by {worst:.1e}", where=str(options.output))
    except TinySplatError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    print(
        json.dumps(
            {
                "size": options.size,
                "difference": worst,
                "bytes": options.output.stat().st_size,
                "bytes before": options.network.stat().st_size,
            }
        )
    )


if __name__ == "__main__":
    main()
