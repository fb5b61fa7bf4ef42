"""Export a network to models/NAME.onnx, check it against torch, and enter it in the manifest.

    python -m export.network sweep [-o models/sweep.onnx]
    python -m export.network edge [--checkpoint DIR/edge.pt]
    python -m export.network mvsplat --checkpoint re10k.ckpt -o mvsplat.onnx [--half-weights]

A new network is an entry in `NETWORKS`: how to build it, and what its artifact says about itself.
Written outside models/, the file is complete but not listed; `--model FILE.onnx` takes it.
"""

import argparse
import hashlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import starmap
from pathlib import Path

from torch import nn
from torch.export import Dim

from tinysplat.checkpoints import load_network
from tinysplat.networks import edge, sweep
from tinysplat.networks import export_support as official
from tinysplat.networks.depthsplat import SCALE_RULES
from tinysplat.training.state import shipped_network
from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.network.predict import NetworkLimits
from tinysplat_runtime.system.progress import working

from .difference import parity
from .inputs import INPUT_AXES, INPUT_RANGES, example_inputs
from .manifest import MODELS, OPSET, register, stamp

TRAINED_EDGE = MODELS / "training" / "edge.pt"
"""The training run that the shipped weights of `edge` are from."""

HALF_TOLERANCE = 0.05
"""Parity expected of float16 weights, whose rounding a deep network amplifies."""


@dataclass(frozen=True)
class Network:
    """A network ready for export.

    Attributes:
        module: with its weights.
        outputs: ONNX names of what its forward returns, in order.
        limits: what it takes; written into its metadata and checked by the runtime.
        papers: licence, provenance and purpose.
        parity_sizes: (V, H, W) at which torch and ONNX are compared.
        parity_tolerance: largest accepted |torch − ONNX| over the output's largest magnitude, at the quantile below.
        parity_quantile: share of values that must keep the tolerance; below 1 where rounding can decide an argmin.
        opset: version of the ONNX operator set.
    """

    module: nn.Module
    outputs: tuple[str, ...]
    limits: NetworkLimits
    papers: Mapping[str, str]
    parity_sizes: tuple[tuple[int, int, int], ...] = ((2, 64, 96), (3, 96, 64), (6, 64, 64))
    parity_tolerance: float = 1e-3
    parity_quantile: float = 0.99
    opset: int = OPSET


def _sweep(options: argparse.Namespace) -> Network:
    if options.checkpoint is not None:
        raise InputError("sweep has no learned weights to load", where="--checkpoint")
    return Network(
        sweep.Sweep(),
        sweep.OUTPUT_NAMES,
        NetworkLimits(sweep.MIN_VIEWS, sweep.MAX_VIEWS, sweep.STRIDE, sweep.MIN_SIDE),
        {
            "licence": "Apache-2.0",
            "provenance": "no learned weights: tinysplat/networks/sweep.py",
            "purpose": "plane-sweep photo-consistency to two layers of Gaussians",
        },
        parity_tolerance=5e-4,  # colours: of two Gaussians at one depth rounding decides which is in front
    )


def _edge(options: argparse.Namespace) -> Network:
    checkpoint = options.checkpoint or TRAINED_EDGE
    module, steps = shipped_network(checkpoint)
    return Network(
        module,
        edge.OUTPUT_NAMES,
        NetworkLimits(edge.MIN_VIEWS, edge.MAX_VIEWS, edge.STRIDE, edge.MIN_SIDE),
        {
            "licence": "Apache-2.0",
            "provenance": f"weights of tinysplat.training, last of several runs ({steps} steps), on procedural scenes"
            " and photos with an open licence (docs/MODELS.md lists them), checkpoint SHA-256"
            f" {hashlib.sha256(checkpoint.read_bytes()).hexdigest()}",
            "purpose": "sweep, corrected by a small learned network, to two layers of Gaussians",
        },
    )


def _official(options: argparse.Namespace) -> Network:
    if options.checkpoint is None:
        raise InputError(f"{options.name} needs one; docs/MODELS.md says where it is", where="--checkpoint")
    loaded = load_network(options.checkpoint, options.name, options.scale_rule, options.sh_degree)
    file, release = loaded.checkpoint, loaded.checkpoint.release
    title = release.title if release else file.path.name
    rule = f", scale rule {loaded.scale_rule}" if loaded.name != "mvsplat" else ""
    return official_network(
        loaded.module,
        {
            "licence": "the checkpoint's own; see docs/MODELS.md",
            "provenance": f"{title}, SHA-256 {file.digest}",
            "purpose": f"{loaded.name} ({loaded.variant}{rule}): posed images to per-pixel Gaussians",
        },
    )


def official_network(network: nn.Module, papers: Mapping[str, str]) -> Network:
    """MVSplat or DepthSplat of `networks.build`, with weights, ready for export."""
    module = official.SceneNetwork(network)
    return Network(
        module,
        official.OUTPUT_NAMES,
        NetworkLimits(**module.limits),
        papers,
        ((2, 64, 96), (3, 96, 64), (4, 64, 64)),
        parity_quantile=1.0,
        opset=official.OPSET,
    )


NETWORKS: dict[str, Callable[[argparse.Namespace], Network]] = {
    "sweep": _sweep,
    "edge": _edge,
    **dict.fromkeys(("mvsplat", "depthsplat-small", "depthsplat-base", "depthsplat-large"), _official),
}


def write_graph(network: Network, path: Path, half_weights: bool = False) -> None:
    """Export the module and stamp its metadata into the file."""
    inputs = example_inputs(3, 64, 96)
    stride = network.limits.stride  # told to the tracer, as half the shape arithmetic is then gone
    dims = {"V": Dim.DYNAMIC, "H": stride * Dim("h"), "W": stride * Dim("w")}
    dynamic = {name: {axis: dims[dim] for axis, dim in axes.items()} for name, axes in INPUT_AXES.items()}
    model = official.export_program(network.module, inputs, dynamic, network.outputs, network.opset)
    papers = dict(network.papers)
    if half_weights:
        papers["weights"] = f"float16, off by at most {official.halve_weights(model):.1e} of a tensor's largest"
    stamp(model, {"role": "network", "inputs": INPUT_RANGES, **asdict(network.limits), **papers})
    official.save_model(model, path)


def main() -> None:
    """Write one network's artifact."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=sorted(NETWORKS))
    parser.add_argument("-o", "--output", type=Path, help="file to write (default models/NAME.onnx)")
    parser.add_argument("--checkpoint", type=Path, help="weights, for networks that have some")
    parser.add_argument("--scale-rule", choices=SCALE_RULES, help="of DepthSplat (default: by the checkpoint's hash)")
    parser.add_argument("--sh-degree", type=int, help="of MVSplat: 3, exact for images (default), or 4")
    parser.add_argument("--half-weights", action="store_true", help="store weights as float16, compute in float32")
    options = parser.parse_args()
    try:
        export(options)
    except TinySplatError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None


def export(options: argparse.Namespace) -> None:
    """Build, write, check, and register what belongs to models/.

    Raises:
        InputError: the options or the checkpoint are not acceptable.
        NumericError: torch and onnx disagree; the file stays, unregistered.
    """
    path = (options.output or MODELS / f"{options.name}.onnx").resolve()
    if not path.parent.is_dir():  # said before an export of minutes, not after it
        raise InputError(f"no folder {path.parent} to write to", where="--output")
    network = NETWORKS[options.name](options)
    if options.half_weights:  # rounded weights are other weights: sanity, not parity
        network = replace(network, parity_tolerance=HALF_TOLERANCE)
    with working("network to graph", quiet=False):
        write_graph(network, path, options.half_weights)
    with working("graph beside torch", quiet=False):
        examples = starmap(example_inputs, network.parity_sizes)
        worst = parity(path, "network", network.module, examples, network.parity_tolerance, network.parity_quantile)
    if path.parent == MODELS:
        register(
            options.name,
            path,
            "network",
            worst,
            **network.papers,
            **asdict(network.limits),
            made_by="export/network.py",
        )


if __name__ == "__main__":
    main()
