"""What stands between an official network and its ONNX artifact: the contract's shape, tidying, halved weights.

The networks themselves are written to export (closed-form inverses, SH rotation as polynomials, sizes as tensors);
here are the steps that concern the file. `export/network.py` puts them together. Needs onnx and onnxscript.
"""

import logging
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from tinysplat_runtime.errors import ModelError

from .depthsplat import DepthSplat
from .mvsplat import MVSplat

OUTPUT_NAMES = ("means", "quats", "scales", "opacities", "sh", "depth")
"""ONNX names of what `SceneNetwork` returns, in order."""

OPSET = 20
"""From here on GELU is one standard operator, not five passes over the largest tensors; onnxruntime 1.20 has it."""

MIN_SIDE = 64
"""The fixtures' size; below it a vision transformer of 14-pixel patches has next to nothing to look at."""

MIN_HALVED = 256
"""Tensors with fewer values stay float32: biases, norms and constants, a few kilobytes in all."""

MAX_FILE_BYTES = 1_900_000_000
"""Weights beyond this lie beside the graph, in FILE.onnx.data: a protobuf message ends at 2 GiB."""


class SceneNetwork(nn.Module):
    """An official network under the contract of the role `network`: one scene, no batch axis.

    Args:
        network: of `networks.build`, with weights.
    """

    def __init__(self, network: MVSplat | DepthSplat) -> None:
        super().__init__()
        self.network = network

    @property
    def limits(self) -> dict[str, int]:
        """What the artifact's metadata says of acceptable inputs."""
        if isinstance(self.network, DepthSplat):
            return {"min_views": 2, "max_views": 12, "stride": 4 * self.network.config.lowest, "min_side": MIN_SIDE}
        return {"min_views": 2, "max_views": 6, "stride": 16, "min_side": MIN_SIDE}

    def forward(self, images: Tensor, K: Tensor, c2w: Tensor, near: Tensor, far: Tensor) -> tuple[Tensor, ...]:
        """Tensors of `OUTPUT_NAMES` (V, H, W, …) from images (V, 3, H, W), K, c2w (V, …), near and far (V,)."""
        gaussians = self.network(images[None], K[None], c2w[None], near[None], far[None])
        return tuple(getattr(gaussians, name)[0] for name in OUTPUT_NAMES)


def export_program(
    module: nn.Module,
    inputs: Mapping[str, Tensor],
    dynamic_axes: Mapping[str, Mapping[int, Any]],
    outputs: Sequence[str],
    opset: int,
) -> Any:
    """Trace a network to an ONNX model with dynamic sizes.

    Folding and deduplication come before the exporter's rewriting, whose time grows with the square of the graph.

    Args:
        module: what to trace.
        inputs: example inputs by name, of any shape, in the order of `forward`; of three views or more, or V becomes
            a constant.
        dynamic_axes: per input, `torch.export` dimensions by axis.
        outputs: names of what `forward` returns.
        opset: version of the ONNX operator set.

    Returns:
        onnx.ModelProto.
    """
    from onnx_ir.passes.common import CommonSubexpressionEliminationPass
    from onnxscript import optimizer

    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it reports libraries that nothing here uses
    with torch.no_grad(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter's own deprecations; what matters is parity
        program: Any = torch.onnx.export(
            module.eval(),
            tuple(inputs.values()),
            input_names=list(inputs),
            output_names=list(outputs),
            dynamic_shapes=tuple(dict(dynamic_axes[name]) for name in inputs),
            opset_version=opset,
            dynamo=True,
            optimize=False,
            verbose=False,
        )
    optimizer.fold_constants(program.model)
    optimizer.remove_unused_nodes(program.model)
    CommonSubexpressionEliminationPass()(program.model)
    optimizer.optimize(program.model)
    return program.model_proto


def halve_weights(model: Any) -> float:
    """Store the large float32 weights of a model as float16, cast back when the graph is loaded.

    Computation stays float32 (onnxruntime folds the casts at load), so this halves the file, not the memory or time.

    Args:
        model: onnx.ModelProto, changed in place.

    Returns:
        Largest |weight − halved| over the largest |weight| of the same tensor.

    Raises:
        ModelError: a weight is beyond float16's range.
    """
    import onnx
    from onnx import helper, numpy_helper

    worst, casts = 0.0, []
    for weight in model.graph.initializer:
        if weight.data_type != onnx.TensorProto.FLOAT or np.prod(weight.dims, dtype=np.int64) < MIN_HALVED:
            continue
        values = numpy_helper.to_array(weight)
        if np.abs(values).max() > np.finfo(np.float16).max:
            raise ModelError(f"weight {weight.name} reaches {np.abs(values).max():g}, float16 ends at 65504")
        half, name = values.astype(np.float16), weight.name
        worst = max(worst, float(np.abs(half - values).max() / max(np.abs(values).max(), 1e-30)))
        weight.CopyFrom(numpy_helper.from_array(half, f"{name}_half"))
        casts.append(helper.make_node("Cast", [f"{name}_half"], [name], to=onnx.TensorProto.FLOAT))
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    return worst


def save_model(model: Any, path: Path, max_bytes: int = MAX_FILE_BYTES) -> None:
    """Write a model; weights beyond `max_bytes` in all go to a file of the same name plus `.data`.

    Args:
        model: onnx.ModelProto with its weights inside.
        path: the .onnx file.
        max_bytes: of weights that may stay inside.
    """
    import onnx

    beside = path.with_name(path.name + ".data")
    beside.unlink(missing_ok=True)  # onnx appends to a file that is there
    weights = sum(len(weight.raw_data) for weight in model.graph.initializer)
    onnx.save(model, str(path), save_as_external_data=weights > max_bytes, location=beside.name, size_threshold=1024)
