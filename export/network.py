"""Export a network to models/NAME.onnx, check it against torch, and enter it in the manifest.

    python export/network.py sweep [-o models/sweep.onnx]

A new network is an entry in `NETWORKS`: how to build it, example inputs, and what its artifact says about itself.
Written outside models/, the file is complete but not listed; `--model FILE.onnx` takes it.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from manifest import MODELS, OPSET, add_metadata, register  # this folder is first on the path of a script
from torch import Tensor, nn

from tinysplat.networks import sweep
from tinysplat_runtime.artifacts import Artifact
from tinysplat_runtime.inference import open_graph

INPUT_AXES: dict[str, dict[int, str]] = {
    "images": {0: "V", 2: "H", 3: "W"},
    "K": {0: "V"},
    "c2w": {0: "V"},
    "near": {0: "V"},
    "far": {0: "V"},
}
"""Inputs of the role `network` and their dynamic axes."""


@dataclass(frozen=True)
class Limits:
    """What a network takes; written into its metadata and checked by the runtime.

    Attributes:
        min_views, max_views: accepted numbers of views.
        stride: H and W are multiples of it.
        min_side: smallest H and W.
    """

    min_views: int
    max_views: int
    stride: int
    min_side: int


@dataclass(frozen=True)
class Network:
    """An exportable network.

    Attributes:
        build: makes the module, from a checkpoint if it has weights.
        outputs: ONNX names of what its forward returns, in order.
        limits: what it takes.
        parity_sizes: (V, H, W) at which torch and ONNX are compared.
        parity_tolerance: largest accepted |torch − ONNX| over the output's largest magnitude, at the quantile below.
        parity_quantile: share of values that must keep the tolerance; below 1 where rounding can decide an argmin.
        papers: licence, provenance and purpose.
    """

    build: Callable[[Path | None], nn.Module]
    outputs: tuple[str, ...]
    limits: Limits
    parity_sizes: tuple[tuple[int, int, int], ...]
    parity_tolerance: float
    parity_quantile: float
    papers: Mapping[str, str]


def _build_sweep(checkpoint: Path | None) -> nn.Module:
    if checkpoint is not None:
        raise SystemExit("sweep has no learned weights, --checkpoint means nothing to it")
    return sweep.Sweep()


NETWORKS: dict[str, Network] = {
    "sweep": Network(
        _build_sweep,
        sweep.OUTPUT_NAMES,
        Limits(sweep.MIN_VIEWS, sweep.MAX_VIEWS, sweep.STRIDE, sweep.MIN_SIDE),
        ((2, 64, 96), (3, 96, 64), (6, 64, 64)),
        parity_tolerance=1e-4,
        parity_quantile=0.99,
        papers={
            "licence": "Apache-2.0",
            "provenance": "no learned weights: tinysplat/networks/sweep.py",
            "purpose": "plane-sweep photo-consistency to two layers of Gaussians",
        },
    ),
}


def example_inputs(views: int, height: int, width: int) -> dict[str, Tensor]:
    """A textured plane at z = 3 seen by cameras side by side, one unit apart in all."""
    row, column = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    focal = float(width)
    position = torch.linspace(-0.5, 0.5, views)
    x = (column - width / 2) / focal * 3 + position[:, None, None]  # (V, H, W) on the plane
    y = ((row - height / 2) / focal * 3).expand_as(x)
    waves = [torch.sin(7 * x + 3 * y + c) * torch.cos(5 * y - 2 * x * c) for c in range(3)]
    c2w = torch.eye(4).repeat(views, 1, 1)
    c2w[:, 0, 3] = position
    return {
        "images": 0.5 + 0.4 * torch.stack(waves, dim=1),
        "K": torch.tensor([[1.0, 0.0, 0.5], [0.0, width / height, 0.5], [0.0, 0.0, 1.0]]).repeat(views, 1, 1),
        "c2w": c2w,
        "near": torch.full((views,), 1.5),
        "far": torch.full((views,), 8.0),
    }


def write_graph(network: Network, module: nn.Module, path: Path) -> None:
    """Export the module and stamp its metadata into the file."""
    inputs = example_inputs(3, 64, 96)
    dynamic = {name: dict.fromkeys(axes, torch.export.Dim.DYNAMIC) for name, axes in INPUT_AXES.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter's own deprecations; what matters is the parity below
        torch.onnx.export(
            module.eval(), tuple(inputs.values()), str(path), input_names=list(inputs),
            output_names=list(network.outputs), dynamic_shapes=tuple(dynamic.values()), opset_version=OPSET,
            dynamo=True, external_data=False, verbose=False,
        )  # fmt: skip
    add_metadata(path, {"role": "network", **input_ranges(), **asdict(network.limits), **network.papers})


def input_ranges() -> dict[str, Any]:
    """The part of the metadata that every network shares: units and ranges of the inputs."""
    return {
        "inputs": {
            "images": "(V, 3, H, W) RGB in [0, 1]",
            "K": "(V, 3, 3) divided by image width and height",
            "c2w": "(V, 4, 4) OpenCV axes, relative to the mean camera centre",
            "near": "(V,) z > 0, scene units",
            "far": "(V,) z > near, scene units",
        }
    }


def measure_parity(network: Network, module: nn.Module, path: Path) -> dict[str, float]:
    """|torch − ONNX| by output, relative to its largest magnitude, at the network's quantile: worst of the sizes."""
    graph = open_graph(Artifact(path.stem, path), "network")
    worst: dict[str, float] = {}
    for size in network.parity_sizes:
        inputs = example_inputs(*size)
        with torch.no_grad():
            expected = module(*inputs.values())
        found = graph.run({name: tensor.numpy() for name, tensor in inputs.items()})
        for name, want in zip(network.outputs, expected, strict=True):
            error = (torch.from_numpy(found[name]) - want).abs().flatten() / want.abs().max().clamp_min(1e-30)
            rank = max(int(network.parity_quantile * error.numel()), 1)
            worst[name] = max(worst.get(name, 0.0), float(error.kthvalue(rank).values))
    return worst


def main() -> None:
    """Write one network's artifact."""
    parser = argparse.ArgumentParser(description="Export a network to ONNX and check it against torch.")
    parser.add_argument("name", choices=sorted(NETWORKS))
    parser.add_argument("-o", "--output", type=Path, help="file to write (default models/NAME.onnx)")
    parser.add_argument("--checkpoint", type=Path, help="weights, for networks that have some")
    options = parser.parse_args()
    network = NETWORKS[options.name]
    path = (options.output or MODELS / f"{options.name}.onnx").resolve()
    module = network.build(options.checkpoint)
    write_graph(network, module, path)
    worst = measure_parity(network, module, path)
    print(options.name, {name: f"{value:.1e}" for name, value in worst.items()})
    if max(worst.values()) > network.parity_tolerance:
        raise SystemExit(f"{options.name}: torch and onnx differ by {worst}; nothing was registered")
    if path.parent == MODELS:
        register(options.name, path, "network", worst, **network.papers, **asdict(network.limits),
                 made_by="export/network.py")  # fmt: skip


if __name__ == "__main__":
    main()
