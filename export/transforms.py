"""Export VPT, VABR and their inverses to models/*.onnx and check each graph against its torch twin.

python -m export.transforms
"""

import argparse
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from tinysplat import transforms as T
from tinysplat.networks.geometry import quats_to_matrices
from tinysplat_runtime.graphs.inference import CONTRACTS
from tinysplat_runtime.system.progress import working

from .difference import parity
from .manifest import MODELS, OPSET, add_metadata, register

LICENCE = "Apache-2.0"
PARITY_RTOL = 1e-5  # summation order alone moves the projections by a few ulp


@dataclass(frozen=True)
class GraphExport:
    """What to export: role, module, and example inputs (V, H, W, degree) by name with their dynamic axes."""

    role: str
    module: nn.Module
    inputs: Callable[[int, int, int, int], dict[str, Tensor]]
    axes: dict[str, dict[int, str]]
    purpose: str


def _camera(views: int) -> dict[str, Tensor]:
    K = torch.tensor([[120.0, 1.5, 9.0], [0.0, 110.0, 7.0], [0.0, 0.0, 1.0]]).repeat(views, 1, 1)
    quat = T.unit_quats(torch.randn(views, 4))
    return {"K": K, "rotation": quats_to_matrices(quat), "rotation_quat": quat}


def _gaussians(v: int, h: int, w: int) -> dict[str, Tensor]:
    return {
        "means": torch.randn(v, h, w, 3) + torch.tensor([0.0, 0.0, 6.0]),
        "quats": torch.randn(v, h, w, 4),
        "scales": torch.rand(v, h, w, 3) * 0.1,
        "opacities": torch.rand(v, h, w),
    }


def _vpt_inputs(v: int, h: int, w: int, degree: int) -> dict[str, Tensor]:
    camera = _camera(v)
    camera["rotation"], camera["rotation_quat"] = torch.eye(3).repeat(v, 1, 1), torch.tensor([[1.0, 0, 0, 0]] * v)
    return {**_gaussians(v, h, w), **camera, "centre_high": torch.randn(v, 3), "centre_low": torch.randn(v, 3) * 1e-7}


def _sh(v: int, h: int, w: int, degree: int) -> Tensor:
    return torch.randn(v, h, w, (degree + 1) ** 2, 3)


def _codes(*shape: int) -> Tensor:
    return torch.randint(0, 4096, shape, dtype=torch.uint16)


def _synthesis_inputs(v: int, h: int, w: int, degree: int) -> dict[str, Tensor]:
    d, planes, k = 3 * (degree + 1) ** 2, 12, 5
    geometry, color = _codes(v, planes + 1, h, w), _codes(v, k + 1, h, w)
    geometry[:, -1], color[:, -1] = 1, 1
    mix = torch.randn(v, 11, planes + 1) * 1e-4
    mix[..., -1] = torch.rand(v, 11) + 1.5
    return {
        "geometry_codes": geometry,
        "geometry_mix": mix,
        "color_codes": color,
        "color_mix": torch.randn(k + 1, d) * 1e-3,
        **_camera(v),
        "centre": torch.randn(v, 3),
        "inverse_depth": torch.tensor(0.0),
        "relative_rotation": torch.tensor(0.0),
        "depth_limits": torch.tensor([1.0, 3.0]),
    }


_VIEW, _GRID = {0: "V"}, {0: "V", 1: "H", 2: "W"}
_PLANES = {0: "V", 1: "P", 2: "H", 3: "W"}
_CAMERA_AXES = dict.fromkeys(("K", "rotation", "rotation_quat"), _VIEW)
_SYNTHESIS_AXES = {
    "geometry_codes": _PLANES,
    "geometry_mix": {0: "V", 2: "P"},
    **_CAMERA_AXES,
    "centre": _VIEW,
    "inverse_depth": {},
    "relative_rotation": {},
    "depth_limits": {},
}

GRAPHS = {
    "analysis_vpt": GraphExport(
        "analysis",
        T.ViewProjection(),
        _vpt_inputs,
        {
            **dict.fromkeys(("means", "quats", "scales", "opacities"), _GRID),
            **_CAMERA_AXES,
            "centre_high": _VIEW,
            "centre_low": _VIEW,
        },
        "VPT: Gaussians and cameras to planes, and the second moment of the rotations",
    ),
    "analysis_moment": GraphExport(
        "analysis",
        T.CoefficientMoment(),
        lambda v, h, w, degree: {"sh": _sh(v, h, w, degree)},
        {"sh": {**_GRID, 3: "B"}},
        "VABR: second moment of the SH coefficients",
    ),
    "analysis_project": GraphExport(
        "analysis",
        T.CoefficientProjection(),
        lambda v, h, w, degree: {"sh": _sh(v, h, w, degree), "projection": torch.randn(3 * (degree + 1) ** 2, 5)},
        {"sh": {**_GRID, 3: "B"}, "projection": {0: "d", 1: "k"}},
        "VABR: SH coefficients to k planes",
    ),
    "synthesis": GraphExport(
        "synthesis",
        T.Synthesis(),
        _synthesis_inputs,
        {**_SYNTHESIS_AXES, "color_codes": {0: "V", 1: "k", 2: "H", 3: "W"}, "color_mix": {0: "k", 1: "d"}},
        "integer planes to Gaussians: dequantisation, inverse VABR, inverse VPT",
    ),
}


def _positional(name: str, graph: GraphExport, size: tuple[int, int, int, int]) -> dict[str, Tensor]:
    """Inputs in the order of the module's forward, under the ONNX names."""
    inputs = graph.inputs(*size)
    return {onnx_name: inputs[onnx_name] for onnx_name in CONTRACTS[name].inputs}


def export(name: str, graph: GraphExport) -> dict[str, float]:
    """Write models/NAME.onnx; returns the largest difference to torch, relative to the output's largest magnitude."""
    path = MODELS / f"{name}.onnx"
    inputs = _positional(name, graph, (2, 6, 5, 2))
    dims: dict[str, torch.export.Dim] = {}

    def dim(symbol: str) -> torch.export.Dim:
        return dims.setdefault(symbol, torch.export.Dim.DYNAMIC)

    shapes = tuple({axis: dim(symbol) for axis, symbol in graph.axes[n].items()} for n in inputs)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            graph.module.eval(),
            tuple(inputs.values()),
            str(path),
            input_names=list(inputs),
            output_names=list(CONTRACTS[name].outputs),
            dynamic_shapes=shapes,
            opset_version=OPSET,
            dynamo=True,
            external_data=False,
            verbose=False,
        )
    add_metadata(path, {"role": graph.role, "licence": LICENCE, "purpose": graph.purpose})
    examples = (_positional(name, graph, size) for size in ((2, 6, 5, 2), (1, 1, 1, 1), (5, 17, 33, 4)))
    return parity(path, name, graph.module, examples, PARITY_RTOL)


def main() -> None:
    """Export every graph of the transforms."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    torch.manual_seed(0)
    for name, graph in GRAPHS.items():
        with working(name, quiet=False):
            worst = export(name, graph)
        register(
            name,
            MODELS / f"{name}.onnx",
            graph.role,
            worst,
            licence=LICENCE,
            purpose=graph.purpose,
            made_by="export/transforms.py",
        )


if __name__ == "__main__":
    main()
