"""How far an exported graph is from the module that it was made of."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import torch
from torch import Tensor, nn

from tinysplat_runtime.errors import NumericError
from tinysplat_runtime.graphs.artifacts import Artifact
from tinysplat_runtime.graphs.inference import open_graph


def parity(
    path: Path,
    contract: str,
    module: nn.Module,
    examples: Iterable[Mapping[str, Tensor]],
    tolerance: float,
    quantile: float = 1.0,
) -> dict[str, float]:
    """|torch − ONNX| by output, relative to its largest magnitude: worst of the examples, printed.

    Args:
        path: of the graph, whose outputs are those of the module, in order.
        contract: that it keeps.
        module: takes the examples' tensors in order.
        examples: inputs by name.
        tolerance: the largest that is accepted.
        quantile: share of an output's values that must keep it; below 1 where rounding can decide.

    Raises:
        NumericError: an output differs by more; the file stays, unregistered.
    """
    graph = open_graph(Artifact(path.stem, path), contract)
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
    print(path, {name: f"{value:.1e}" for name, value in worst.items()})
    if max(worst.values()) > tolerance:
        raise NumericError(f"torch and onnx differ by {worst}; nothing was registered", where=path.stem)
    return worst
