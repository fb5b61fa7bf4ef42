"""LPIPS (Zhang et al. 2018, version 0.1) in torch, with weights that the user brings: none ship with this project.

Two files are needed: the linear weights, which the package `lpips` carries (`pip install --no-deps lpips`; it is never
imported), and the backbone's ImageNet weights in torchvision's layout, named by the user or left in torch's cache by
torchvision. `find_lpips` looks for them; where either is missing there is no number, and torch is not imported. The
paper's figures are LPIPS with VGG.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.files import StrPath, check_readable

if TYPE_CHECKING:
    from torch import Tensor

BACKBONE_FILES = {"vgg": "vgg16-397923af.pth", "alex": "alexnet-owt-7be5be79.pth"}
"""torchvision's names of the classifiers' weights."""


@dataclass(frozen=True)
class LpipsFiles:
    """The two files that LPIPS needs.

    Attributes:
        net: `vgg` or `alex`.
        backbone: torchvision's file of the classifier's weights.
        linear: the package `lpips`'s file of linear weights.
    """

    net: str
    backbone: Path
    linear: Path


def find_lpips(
    net: str, backbone: StrPath | None = None, linear: StrPath | None = None
) -> tuple[LpipsFiles | None, str]:
    """Look for the weights of LPIPS; nothing is downloaded.

    Args:
        net: `vgg` or `alex`.
        backbone: the classifier's weights; None to look where torchvision leaves what it downloads.
        linear: the linear weights; None to look in the installed package `lpips`.

    Returns:
        The files, or None, and a line that says which were found or what is missing.

    Raises:
        InputError: an unknown net, or a file that was named does not exist.
    """
    if net not in BACKBONE_FILES:
        raise InputError(f"'{net}', accepted are {', '.join(BACKBONE_FILES)}", where="lpips")
    for path in (backbone, linear):
        if path is not None:
            check_readable(path)
    home = os.environ.get("TORCH_HOME") or Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache") / "torch"
    cached = Path(home).expanduser() / "hub" / "checkpoints" / BACKBONE_FILES[net]  # as torch.hub.get_dir has it
    advice = f"--lpips-backbone names torchvision's {BACKBONE_FILES[net]}, from download.pytorch.org/models"
    found_backbone = Path(backbone) if backbone is not None else cached if cached.is_file() else None
    found_linear = Path(linear) if linear is not None else _packaged_linear(net)
    if found_linear is None:
        return None, (
            f"no linear weights of LPIPS-{net}: `pip install --no-deps lpips` brings them, --lpips-linear names them;"
            f" {advice}"
        )
    if found_backbone is None:
        return None, f"no backbone weights of LPIPS-{net} in {cached.parent}: {advice}"
    return LpipsFiles(net, found_backbone, found_linear), f"LPIPS-{net}: {found_backbone}, {found_linear}"


def _packaged_linear(net: str) -> Path | None:
    """The linear weights in the installed package `lpips`, which needs torchvision and is not imported."""
    spec = importlib.util.find_spec("lpips")
    folders = list(spec.submodule_search_locations or ()) if spec is not None else []
    paths = (Path(folder) / "weights" / "v0.1" / f"{net}.pth" for folder in folders)
    return next((path for path in paths if path.is_file()), None)


_SHIFT, _SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)  # ImageNet's moments for inputs in [−1, 1]
_NORM_EPSILON = 1e-10


LAYERS: dict[str, tuple[str, ...]] = {
    "vgg": ("3-64", "64-64 =", "pool 2", "64-128", "128-128 =", "pool 2", "128-256", "256-256", "256-256 =", "pool 2",
            "256-512", "512-512", "512-512 =", "pool 2", "512-512", "512-512", "512-512 ="),
    "alex": ("3-64 11 4 2 =", "pool 3", "64-192 5 1 2 =", "pool 3", "192-384 =", "384-256 =", "256-256 ="),
}  # fmt: skip
"""Convolutions as channels in and out, kernel, stride and padding where they are not 3 1 1, each with a ReLU behind;
what stands at `=` is compared. In torchvision's `features` a pooling counts one place, a convolution two."""

MIN_SIDE = {"vgg": 16, "alex": 31}
"""Pictures with shorter sides leave a layer without pixels."""


class Lpips:
    """The metric: `lpips(image, reference)`, 0 for equal pictures, larger for less alike ones."""

    def __init__(self, files: LpipsFiles) -> None:
        """Load the weights.

        Raises:
            InputError: a file is unreadable, or holds other weights than the net's.
        """
        self._net = files.net
        backbone = {name.removeprefix("features."): value for name, value in _load(files.backbone).items()}
        linear = _load(files.linear)
        self._steps: list[Callable[[Tensor], Tensor]] = []
        self._linear: dict[int, Tensor] = {}  # by the step whose features it weighs
        place = 0
        for layer in LAYERS[files.net]:
            kind, *numbers = layer.removesuffix(" =").split()
            if kind == "pool":
                self._steps.append(partial(_pool, kernel=int(numbers[0])))
                place += 1
                continue
            inputs, outputs = map(int, kind.split("-"))
            kernel, stride, padding = map(int, numbers or (3, 1, 1))
            weight = _take(backbone, f"{place}.weight", (outputs, inputs, kernel, kernel), files.backbone)
            bias = _take(backbone, f"{place}.bias", (outputs,), files.backbone)
            self._steps.append(partial(_convolve, weight=weight, bias=bias, stride=stride, padding=padding))
            if layer.endswith("="):
                name = f"lin{len(self._linear)}.model.1.weight"
                self._linear[len(self._steps) - 1] = _take(linear, name, (1, outputs, 1, 1), files.linear)
            place += 2

    def __call__(self, image: NDArray, reference: NDArray) -> float:
        """Distance of two pictures (H, W, 3) in [0, 1]; values outside are clipped, NaN of the reference are alike.

        Raises:
            InputError: shapes differ, or pictures are too small for the net.
        """
        import torch

        shapes, least = (np.shape(image), np.shape(reference)), MIN_SIDE[self._net]
        if shapes[0] != shapes[1] or len(shapes[0]) != 3 or min(shapes[0][:2]) < least:
            raise InputError(
                f"{shapes[0]} and {shapes[1]}, expected two equal (H, W, 3), sides ≥ {least}", where="image"
            )
        reference = np.where(np.isnan(reference), image, reference)
        pair = torch.from_numpy(np.stack([np.clip(p, 0, 1, dtype=np.float32) for p in (image, reference)]))
        shift, scale = (torch.tensor(v)[:, None, None] for v in (_SHIFT, _SCALE))
        x = (pair.permute(0, 3, 1, 2) * 2 - 1 - shift) / scale  # (2, 3, H, W)
        distance = 0.0
        with torch.no_grad():
            for i, step in enumerate(self._steps):
                x = step(x)
                if i in self._linear:
                    unit = x / (x.square().sum(1, keepdim=True).sqrt() + _NORM_EPSILON)
                    distance += float(torch.conv2d((unit[:1] - unit[1:]).square(), self._linear[i]).mean())
        return distance


def _convolve(x: Tensor, weight: Tensor, bias: Tensor, stride: int, padding: int) -> Tensor:
    import torch

    return torch.conv2d(x, weight, bias, stride=stride, padding=padding).relu()


def _pool(x: Tensor, kernel: int) -> Tensor:
    import torch

    return torch.max_pool2d(x, kernel, 2)


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
