"""LPIPS (Zhang et al. 2018, version 0.1) with VGG-16 in torch, by weights that the user brings: none ship with this.

Two files are needed: the linear weights, which the package `lpips` carries (`pip install --no-deps lpips`; it is never
imported), and the backbone's ImageNet weights in torchvision's layout, named by the user or left in torch's cache by
torchvision. `find_lpips` looks for them; where either is missing there is no number, and torch is not imported.
"""

from __future__ import annotations

import importlib.util
import os
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.files import StrPath, check_readable

if TYPE_CHECKING:
    from torch.nn import Module

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
        """Load the weights; InputError where a file is unreadable, or holds other weights than the net's."""
        from torch import nn

        self._features, linear = nn.Sequential(), nn.ModuleDict()  # with torchvision's and lpips' names
        self._weighed: dict[Module, Module] = {}  # by what is compared
        inputs = 3
        for number, block in enumerate(BLOCKS):
            for outputs in block:
                self._features.append(nn.Conv2d(inputs, outputs, 3, padding=1)).append(nn.ReLU())
                inputs = outputs
            model = nn.Sequential(nn.Dropout(), nn.Conv2d(inputs, 1, 1, bias=False))
            linear[f"lin{number}"] = nn.ModuleDict({"model": model})
            self._weighed[self._features[-1]] = model[1]
            self._features.append(nn.MaxPool2d(2))
        _load(self._features, files.backbone, "features.")
        _load(linear, files.linear)

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
            for layer in self._features:
                x = layer(x)
                if weighed := self._weighed.get(layer):
                    unit = x / (x.square().sum(1, keepdim=True).sqrt() + _NORM_EPSILON)
                    distance += float(weighed((unit[:1] - unit[1:]).square()).mean())
        return distance


def _load(module: Module, path: Path, prefix: str = "") -> None:
    """Fill a module with a file's weights whose names begin so."""
    import torch

    check_readable(path)
    try:
        weights = torch.load(path, map_location="cpu", weights_only=True)
        module.load_state_dict({n.removeprefix(prefix): v for n, v in weights.items() if n.startswith(prefix)})
    except Exception as error:  # torch raises a dozen unrelated types on damaged files
        said = " ".join(str(error).split())[:300]
        raise InputError(f"not the net's weights ({type(error).__name__}: {said})", where=str(path)) from None


@lru_cache(maxsize=1)
def load_lpips(files: LpipsFiles, threads: int) -> Lpips:
    """The metric, loaded once a process, with so many threads of torch."""
    import torch

    torch.set_num_threads(threads)
    return Lpips(files)
