"""Export `enlarge` to models/enlarge.onnx, check it against torch, and enter it in the manifest.

python -m export.enlarge
"""

from itertools import starmap

import torch
from torch import Tensor
from torch.export import Dim

from tinysplat.networks import export_support as official
from tinysplat.networks.enlarge import HALO, OUTPUT_NAMES, Enlarge

from .difference import parity
from .manifest import MODELS, OPSET, register, stamp

PAPERS = {
    "licence": "Apache-2.0",
    "provenance": "no learned weights: tinysplat/networks/enlarge.py",
    "purpose": "what a network found on small photos, on the pixels of large ones",
}

SERVES = {"networks": ["edge", "sweep"], "pixels": 512 * 512, "halo": HALO}
"""Networks whose Gaussians it makes anew, how many pixels they run on then, and rows that a strip needs beside it."""

PARITY_RTOL = 1e-3
PARITY_QUANTILE = 0.99  # of two Gaussians at one depth rounding decides which is in front, and with it colours

AXES: dict[str, dict[int, str]] = {
    "photo": {2: "h", 3: "W"},
    "small": {2: "small_h", 3: "small_w"},
    "rows": {0: "h"},
    "columns": {0: "W"},
    "K": {},
    "c2w": {},
    "sources": {0: "S", 2: "H", 3: "W"},
    "source_K": {0: "S"},
    "rotation": {0: "S"},
    "translation": {0: "S"},
    "unit": {},
}


def example_inputs(height: int, width: int, sources: int, seed: int = 0) -> dict[str, Tensor]:
    """A wavy surface at z = 3 under smooth colours, its small photo of two thirds the sides; sources side by side."""
    small_height, small_width = 2 * height // 3, 2 * width // 3

    def waves(rows: int, columns: int, shift: float = 0.0) -> Tensor:
        y, x = torch.meshgrid((torch.arange(rows) + 0.5) / rows, (torch.arange(columns) + 0.5) / columns, indexing="ij")
        return torch.stack([0.5 + 0.3 * torch.sin(17 * (x + shift) + 9 * c * y) for c in range(3)])[None]

    generator = torch.Generator().manual_seed(seed)
    colours = waves(small_height, small_width)
    footprints = torch.cat(
        [0.33 + 0.02 * colours[:, :1], 0.6 + 0.1 * colours[:, 1:2], 0.4 + 0.1 * colours[:, 2:]], dim=1
    )
    change = 0.02 * torch.randn(1, 3, small_height, small_width, generator=generator)
    steps = torch.arange(1, sources + 1)
    translation = torch.zeros(sources, 3)
    translation[:, 0] = -0.1 * steps
    K_unit = torch.tensor([[1.0, 0.0, 0.5], [0.0, width / height, 0.5], [0.0, 0.0, 1.0]])
    return {
        "photo": waves(height, width),
        "small": torch.cat([colours, footprints, change], dim=1),
        "rows": (torch.arange(height) + 0.5) * small_height / height - 0.5,
        "columns": (torch.arange(width) + 0.5) * small_width / width - 0.5,
        "K": (K_unit * torch.tensor([[width], [height], [1.0]]))[None],
        "c2w": torch.eye(4)[None],
        "sources": torch.cat([waves(height, width, 0.033 * int(step)) for step in steps]),
        "source_K": K_unit.repeat(sources, 1, 1),
        "rotation": torch.eye(3).repeat(sources, 1, 1),
        "translation": translation,
        "unit": torch.tensor(1 / (0.15 * width)),
    }


def main() -> None:
    """Write the artifact."""
    path = MODELS / "enlarge.onnx"
    module = Enlarge()
    dims = {name: Dim.DYNAMIC for axes in AXES.values() for name in axes.values()}
    axes = {name: {axis: dims[dim] for axis, dim in of.items()} for name, of in AXES.items()}
    model = official.export_program(module, example_inputs(48, 60, 3), axes, OUTPUT_NAMES, OPSET)
    stamp(model, {"role": "enlarge", **SERVES, **PAPERS})
    official.save_model(model, path)
    examples = starmap(example_inputs, ((48, 60, 1), (33, 96, 3), (64, 40, 4)))
    worst = parity(path, "enlarge", module, examples, PARITY_RTOL, PARITY_QUANTILE)
    register("enlarge", path, "enlarge", worst, **PAPERS, made_by="export/enlarge.py")


if __name__ == "__main__":
    main()
