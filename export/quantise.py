"""Quantise convolutions of a network's artifact to int8, calibrated on scenes.

python export/quantise.py models/edge.onnx SCENES -o edge-int8.onnx

SCENES is a folder of scene folders, other ones than what is measured with the result. Weights become signed 8-bit
numbers per output channel, activations unsigned ones by the ranges they reach on the calibration photos (onnxruntime's
static quantisation). Only layers under `--layers` change: what geometry is computed from needs float32.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import extra  # noqa: F401  (first: names what is missing)
import numpy as np
import onnx
from manifest import stamp
from numpy.typing import NDArray
from onnx import numpy_helper
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static

from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.graphs.artifacts import Artifact
from tinysplat_runtime.graphs.inference import open_graph
from tinysplat_runtime.graphs.predict import NetworkLimits, network_inputs
from tinysplat_runtime.scene.intake.cameras_json import CAMERAS_FILE
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.viewchoice import choose_views
from tinysplat_runtime.system.progress import working

LAYERS, FLOAT_LAYERS = ("unet",), ("unet.entry",)
"""Of `edge`: its U-Net but for the first layer, whose input has channels of very different ranges."""


class Calibration(CalibrationDataReader):  # type: ignore[misc]
    """Inputs of the network, one scene's two views after the other."""

    def __init__(self, inputs: Sequence[Mapping[str, NDArray]]) -> None:
        self._left: Iterator[Mapping[str, NDArray]] = iter(inputs)

    def get_next(self) -> Mapping[str, NDArray] | None:
        """The next inputs, None behind the last."""
        return next(self._left, None)


def calibration_inputs(folder: Path, limits: NetworkLimits, side: int, count: int) -> list[dict[str, NDArray]]:
    """Inputs from two views of each of the first `count` scenes of a folder, side × side pixels.

    Raises:
        InputError: the folder holds no scene, or a scene cannot be read.
    """
    paths = sorted(path.parent for path in folder.glob(f"*/{CAMERAS_FILE}"))[:count]
    if not paths:
        raise InputError(f"no folder with {CAMERAS_FILE} in it", where=str(folder))
    inputs = []
    for path in paths:
        scene = load_scene(path)
        near, far = scene.depth_range()
        views = scene.views(choose_views(scene.cameras, near, far, max(2, limits.min_views))).resized(side, side)
        inputs.append(network_inputs(views.images(), views.cameras, near, far, limits))
    return inputs


def convolutions(model: onnx.ModelProto, layers: Sequence[str], float_layers: Sequence[str]) -> list[str]:
    """Names of the nodes whose weights are called as `layers` begin, and not as `float_layers` do.

    Raises:
        InputError: there are none.
    """
    nodes = [node for node in model.graph.node if node.op_type == "Conv"]
    chosen = [node.name for node in nodes if _under(node, layers) and not _under(node, float_layers)]
    if not chosen:
        have = ", ".join(sorted({node.input[1].split(".")[0] for node in nodes})) or "none"
        raise InputError(f"no convolution under {', '.join(layers)}; there are {have}", where="--layers")
    return chosen


def _under(node: onnx.NodeProto, layers: Sequence[str]) -> bool:
    return bool(node.input[1].startswith(tuple(layers)))


def unfold_half_weights(model: onnx.ModelProto, nodes: Sequence[str]) -> None:
    """Make float16 weights of some nodes float32 ones, in place: the quantiser takes no casts for weights."""
    weights = {node.input[1] for node in model.graph.node if node.name in nodes}
    stored = {tensor.name: tensor for tensor in model.graph.initializer}
    kept = []
    for node in model.graph.node:
        if node.op_type == "Cast" and node.output[0] in weights and node.input[0] in stored:
            tensor = stored[node.input[0]]
            tensor.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(tensor).astype(np.float32), node.output[0]))
        else:
            kept.append(node)
    del model.graph.node[:]
    model.graph.node.extend(kept)


def quantise(source: Path, target: Path, options: argparse.Namespace) -> int:
    """Write `target`; returns how many convolutions are int8 in it.

    Raises:
        InputError, ModelError: a path, the network or the scenes are not acceptable.
    """
    if not target.parent.is_dir():
        raise InputError(f"no folder {target.parent} to write to", where="--output")
    graph = open_graph(Artifact(source.stem, source), "network")
    inputs = calibration_inputs(options.scenes, NetworkLimits.of(graph), options.size, options.count)
    model = onnx.load(str(source))
    chosen = convolutions(model, options.layers, options.float_layers)
    unfold_half_weights(model, chosen)
    logging.getLogger().setLevel(logging.ERROR)  # the quantiser's advice to fold shapes, which are dynamic here
    with tempfile.TemporaryDirectory() as folder:
        plain, quantised = Path(folder, "plain.onnx"), Path(folder, "quantised.onnx")
        onnx.save(model, str(plain))
        quantize_static(
            str(plain),
            str(quantised),
            Calibration(inputs),
            quant_format=QuantFormat.QDQ,
            nodes_to_quantize=chosen,
            op_types_to_quantize=["Conv"],
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
        )
        model = onnx.load(str(quantised))
    papers = dict(graph.metadata)
    papers.pop("contract")
    papers["weights"] = f"{papers.get('weights', 'float32')}; int8 in {len(chosen)} convolutions, calibrated on photos"
    stamp(model, papers)
    onnx.save(model, str(target))
    return len(chosen)


def main() -> None:
    """Write the quantised artifact and say what is in it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("network", type=Path, help="an artifact that export/network.py wrote")
    parser.add_argument("scenes", type=Path, help="folder of scene folders with cameras.json")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--layers", nargs="+", default=LAYERS, help="beginnings of weights' names (default: unet)")
    parser.add_argument("--float-layers", nargs="*", default=FLOAT_LAYERS, help="of those, what stays float32")
    parser.add_argument("--size", type=int, default=256, help="side of the calibration photos, pixels")
    parser.add_argument("--count", type=int, default=8, help="scenes to calibrate on")
    options = parser.parse_args()
    try:
        with working("calibration", quiet=False):
            count = quantise(options.network, options.output, options)
    except TinySplatError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    print(
        json.dumps(
            {
                "int8 convolutions": count,
                "bytes": options.output.stat().st_size,
                "bytes before": options.network.stat().st_size,
            }
        )
    )


if __name__ == "__main__":
    main()
