"""LPIPS (Zhang et al. 2018, version 0.1) with VGG-16 in torch, by weights that the user brings: none ship with this.

Two files are needed: the linear weights, which the package `lpips` carries (`pip install --no-deps lpips`; it is never
imported), and the backbone's ImageNet weights in torchvision's layout, named by the user or left in torch's cache by
torchvision. `find_lpips` looks for them; where either is missing there is no number, and torch is not imported.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.files import StrPath, check_readable

if TYPE_CHECKING:
    from torch import Tensor

BACKBONE_FILE = "vgg16-397923af.pth"
"""torchvision's name of the classifier's weights."""


@dataclass(frozen=True)
class LpipsFiles:
    """The two files that LPIPS needs.

    Attributes:
        backbone: torchvision's file of the classifier's weights.
        linear: the package `lpips`'s file of linear weights.
    """

    backbone: Path
    linear: Path


def find_lpips(backbone: StrPath | None = None, linear: StrPath | None = None) -> tuple[LpipsFiles | None, str]:
    """Look for the weights of LPIPS; nothing is downloaded.

    Args:
        backbone: the classifier's weights; None to look where torchvision leaves what it downloads.
        linear: the linear weights; None to look in the installed package `lpips`.

    Returns:
        The files, or None, and a line that says which were found or what is missing.

    Raises:
        InputError: a file that was named does not exist.
    """
    for path in (backbone, linear):
        if path is not None:
            check_readable(path)
    home = os.environ.get("TORCH_HOME") or Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache") / "torch"
    cached = Path(home).expanduser() / "hub" / "checkpoints" / BACKBONE_FILE  # as torch.hub.get_dir has it
    advice = f"--lpips-backbone names torchvision's {BACKBONE_FILE}, from download.pytorch.org/models"
    found_backbone = Path(backbone) if backbone is not None else cached if cached.is_file() else None
    found_linear = Path(linear) if linear is not None else _packaged_linear()
    if found_linear is None:
        return None, (
            f"no linear weights of LPIPS-vgg: `pip install --no-deps lpips` brings them, --lpips-linear names them;"
            f" {advice}"
        )
    if found_backbone is None:
        return None, f"no backbone weights of LPIPS-vgg in {cached.parent}: {advice}"
    return LpipsFiles(found_backbone, found_linear), f"LPIPS-vgg: {found_backbone}, {found_linear}"


def _packaged_linear() -> Path | None:
    """The linear weights in the installed package `lpips`, which needs torchvision and is not imported."""
    spec = importlib.util.find_spec("lpips")
    folders = list(spec.submodule_search_locations or ()) if spec is not None else []
    paths = (Path(folder) / "weights" / "v0.1" / "vgg.pth" for folder in folders)
    return next((path for path in paths if path.is_file()), None)


_SHIFT, _SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)  # ImageNet's moments for inputs in [−1, 1]
_NORM_EPSILON = 1e-10


BLOCKS = ((64, 64), (128, 128), (256, 256, 256), (512, 512, 512), (512, 512, 512))
"""Channels of VGG-16's convolutions of 3 × 3 between its poolings; what stands behind the last of each is compared."""

MIN_SIDE = 16
"""Pictures with shorter sides leave a layer without pixels."""


class Lpips:
    """The metric: `lpips(image, reference)`, 0 for equal pictures, larger for less alike ones."""

    def __init__(self, files: LpipsFiles) -> None:
        """Load the weights.

        Raises:
            InputError: a file is unreadable, or holds other weights than the net's.
        """
        backbone = {name.removeprefix("features."): value for name, value in _load(files.backbone).items()}
        linear = _load(files.linear)
        self._blocks: list[tuple[list[tuple[Tensor, Tensor]], Tensor]] = []
        place, inputs = 0, 3  # in torchvision's `features` a convolution counts two, with its ReLU, and a pooling one
        for number, block in enumerate(BLOCKS):
            convolutions = []
            for outputs in block:
                weight = _take(backbone, f"{place}.weight", (outputs, inputs, 3, 3), files.backbone)
                convolutions.append((weight, _take(backbone, f"{place}.bias", (outputs,), files.backbone)))
                place, inputs = place + 2, outputs
            weighed = _take(linear, f"lin{number}.model.1.weight", (1, inputs, 1, 1), files.linear)
            self._blocks.append((convolutions, weighed))
            place += 1

    def __call__(self, image: NDArray, reference: NDArray) -> float:
        """Distance of two pictures (H, W, 3) in [0, 1]; values outside are clipped, NaN of the reference are alike.

        Raises:
            InputError: shapes differ, or pictures are too small for the net.
        """
        import torch

        one, other = np.shape(image), np.shape(reference)
        if one != other or len(one) != 3 or min(one[:2]) < MIN_SIDE:
            raise InputError(f"{one} and {other}, expected two equal (H, W, 3), sides ≥ {MIN_SIDE}", where="image")
        reference = np.where(np.isnan(reference), image, reference)
        pair = torch.from_numpy(np.stack([np.clip(p, 0, 1, dtype=np.float32) for p in (image, reference)]))
        shift, scale = (torch.tensor(v)[:, None, None] for v in (_SHIFT, _SCALE))
        x = (pair.permute(0, 3, 1, 2) * 2 - 1 - shift) / scale  # (2, 3, H, W)
        distance = 0.0
        with torch.no_grad():
            for number, (convolutions, linear) in enumerate(self._blocks):
                x = torch.max_pool2d(x, 2) if number else x
                for weight, bias in convolutions:
                    x = torch.conv2d(x, weight, bias, padding=1).relu()
                unit = x / (x.square().sum(1, keepdim=True).sqrt() + _NORM_EPSILON)
                distance += float(torch.conv2d((unit[:1] - unit[1:]).square(), linear).mean())
        return distance


def _load(path: Path) -> Mapping[str, Tensor]:
    import torch

    check_readable(path)
    try:
        weights = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises a dozen unrelated types on damaged files
        said = str(error).strip().split("\n")[0][:120]
        raise InputError(f"unreadable weights ({type(error).__name__}: {said})", where=str(path)) from None
    if not isinstance(weights, dict):
        raise InputError("expected a dictionary of weights", where=str(path))
    return weights


def _take(weights: Mapping[str, Tensor], name: str, shape: tuple[int, ...], path: Path) -> Tensor:
    import torch

    value = weights.get(name)
    if not isinstance(value, torch.Tensor) or tuple(value.shape) != shape:
        fault = "missing" if value is None else f"of shape {tuple(getattr(value, 'shape', ()))}"
        raise InputError(f"{fault}, expected {shape}", where=f"{path}: {name}")
    return value.float()


@lru_cache(maxsize=1)
def load_lpips(files: LpipsFiles, threads: int) -> Lpips:
    """The metric, loaded once a process, with so many threads of torch."""
    import torch

    torch.set_num_threads(threads)
    return Lpips(files)
