"""Export the stages of `edge`, photo by photo, to models/edge_STAGE.onnx, and enter them in the manifest.

python -m export.stages [STAGE …]
"""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor
from torch.export import Dim

from tinysplat.networks import edge
from tinysplat.networks.edge_stages import OF_ALL, STAGES, Stage
from tinysplat.networks.export_support import export_program, halve_weights, save_model
from tinysplat.networks.surfels import RING
from tinysplat.training.state import shipped_network
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.system.progress import working

from .difference import parity
from .inputs import example_inputs
from .manifest import MODELS, OPSET, register, stamp
from .network import HALF_TOLERANCE, TRAINED_EDGE

SIZES = ((4, 64, 96), (2, 96, 64), (5, 64, 64))
"""Views, height and width at which torch and ONNX are compared; the first is traced."""

QUANTILE = 0.99
"""Share of values that must keep the tolerance: rounding can decide between two candidates."""


def recorded(stages: Mapping[str, Stage], views: int, height: int, width: int) -> dict[str, dict[str, Tensor]]:
    """What each stage is given of the first of some views, whose neighbours are all others."""
    example = example_inputs(views, height, width)
    orders = [[v, *(u for u in range(views) if u != v)] for v in range(views)]
    calls: dict[str, dict[str, Tensor]] = {}
    known = {"K": example["K"], "c2w": example["c2w"], "far": example["far"], "images": example["images"]}
    known["ranges"] = torch.stack([1 / example["far"], 1 / example["near"] - 1 / example["far"]], dim=1)
    known["shown"] = known["images"]
    known["cells"], known["half"] = (torch.nn.functional.avg_pool2d(known["images"], side) for side in (8, 2))
    for name, stage in stages.items():
        results = []
        for v, order in enumerate(orders):
            given = {key: known[key][order if key in OF_ALL else slice(v, v + 1)] for key in stage.inputs}
            with torch.no_grad():
                values = stage(*given.values())
            results.append(values if isinstance(values, tuple) else (values,))
            calls.setdefault(name, given)
        joined = {
            key: torch.cat(of_each) for key, of_each in zip(stage.outputs, zip(*results, strict=True), strict=True)
        }
        known |= {
            {"level": "levels", "agreement": "agreements", "opacity": "alphas"}.get(k, k): v for k, v in joined.items()
        }
    return calls


def write(stage: Stage, given: Mapping[str, Tensor], path: Path, facts: Mapping[str, object]) -> None:
    """Export a stage for any number of neighbours and any size, with its weights as float16."""
    rows, columns = Dim("h"), Dim("w")
    axes: dict[str, dict[int, object]] = {}
    for key, cell in stage.inputs.items():
        axes[key] = {0: Dim.DYNAMIC} if key in OF_ALL else {}
        if cell is not None:
            ring = 2 * RING if key == "changes" else 0
            axes[key] |= {2: 16 // cell * rows + ring, 3: 16 // cell * columns + ring}
    model = export_program(stage, given, axes, stage.outputs, OPSET)
    halve_weights(model)
    stamp(model, {"role": "stage", **facts})
    save_model(model, path)


def export(names: list[str]) -> None:
    """Write, check and register stages; NumericError where torch and ONNX disagree."""
    network, steps = shipped_network(TRAINED_EDGE)
    stages = {name: kind(network.eval()).eval() for name, kind in STAGES.items()}
    provenance = f"weights of the network edge ({steps} steps)"
    facts = {"licence": "Apache-2.0", "provenance": provenance, "stride": edge.STRIDE, "min_side": edge.MIN_SIDE}
    examples = recorded(stages, *SIZES[0])
    for name in names:
        path, stage = MODELS / f"edge_{name}.onnx", stages[name]
        with working(name, quiet=False):
            write(stage, examples[name], path, facts)
            given = (recorded(stages, *size)[name] for size in SIZES)
            worst = parity(path, f"stage_{name}", stage, given, HALF_TOLERANCE, QUANTILE)
        purpose = f"edge, photo by photo: {(type(stage).__doc__ or '').strip().rstrip('.')}"
        register(f"edge_{name}", path, "stage", worst, **facts, purpose=purpose, made_by="export/stages.py")


def main() -> None:
    """Write all stages, or those named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stages", nargs="*", metavar="STAGE", help=", ".join(STAGES))
    try:
        export(parser.parse_args().stages or list(STAGES))
    except TinySplatError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
