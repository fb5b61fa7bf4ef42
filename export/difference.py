"""How far an exported graph is from the module that it was made of."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import torch
from torch import Tensor, nn

from tinysplat_runtime.graphs.inference import Graph


def parity(
    graph: Graph, module: nn.Module, examples: Iterable[Mapping[str, Tensor]], quantile: float = 1.0
) -> dict[str, float]:
    """|torch − ONNX| by output, relative to its largest magnitude: worst of the examples.

    Args:
        graph: whose outputs are those of the module, in order.
        module: takes the examples' tensors in order.
        examples: inputs by name.
        quantile: share of an output's values that must keep what is returned; below 1 where rounding can decide.
    """
    worst: dict[str, float] = {}
    for inputs in examples:
        with torch.no_grad():
            expected = module(*inputs.values())
        outputs = graph.run({name: tensor.contiguous().numpy() for name, tensor in inputs.items()})
        for (name, found), want in zip(
            outputs.items(), expected if isinstance(expected, tuple) else (expected,), strict=True
        ):
            error = (torch.from_numpy(found) - want).abs().flatten() / want.abs().max().clamp_min(1e-30)
            rank = max(int(quantile * error.numel()), 1)
            value = float(error.nan_to_num(nan=torch.inf).kthvalue(rank).values)  # else NaN would pass for parity
            worst[name] = max(worst.get(name, 0.0), value)
    return worst
