"""Where LPIPS's weights lie on this machine; imports no torch, so that evaluations without weights start fast."""

from __future__ import annotations

import importlib.util
import os
from dataclasses import dataclass
from pathlib import Path

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.files import StrPath, check_readable

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
    cached = _torch_cache() / BACKBONE_FILES[net]
    found_backbone = Path(backbone) if backbone is not None else cached if cached.is_file() else None
    found_linear = Path(linear) if linear is not None else _packaged_linear(net)
    if found_linear is None:
        return None, f"no linear weights of LPIPS-{net}: pip install --no-deps lpips brings them, or name a file"
    if found_backbone is None:
        return None, f"no backbone weights of LPIPS-{net}: name torchvision's {cached.name} (not in {cached.parent})"
    return LpipsFiles(net, found_backbone, found_linear), f"LPIPS-{net}: {found_backbone}, {found_linear}"


def _torch_cache() -> Path:
    """torch.hub's folder of checkpoints, by the rules of torch.hub.get_dir."""
    home = os.environ.get("TORCH_HOME") or Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache") / "torch"
    return Path(home).expanduser() / "hub" / "checkpoints"


def _packaged_linear(net: str) -> Path | None:
    """The linear weights in the installed package `lpips`, which needs torchvision and is not imported."""
    spec = importlib.util.find_spec("lpips")
    folders = list(spec.submodule_search_locations or ()) if spec is not None else []
    paths = (Path(folder) / "weights" / "v0.1" / f"{net}.pth" for folder in folders)
    return next((path for path in paths if path.is_file()), None)
