"""Feedforward networks: posed images in, per-pixel Gaussians out.

`build` makes the networks of the official checkpoints; docs/MODELS.md says which checkpoint needs which.
"""

from tinysplat_runtime.errors import InputError

from .depthsplat import SCALE_RULES, DepthSplat, DepthSplatConfig
from .harmonics import RENDERED_DEGREE
from .mvsplat import MVSplat

MVSPLAT_VARIANTS = ("re10k", "acid")
"""One architecture under two names: the checkpoints differ in weights only."""

DEPTHSPLAT_CONFIGS = {
    ("depthsplat-small", "re10k"): DepthSplatConfig("S", scales=1, upsample_factor=4),
    ("depthsplat-small", "dl3dv"): DepthSplatConfig("S", scales=1, upsample_factor=8),
    ("depthsplat-base", "re10k"): DepthSplatConfig("B", scales=2, upsample_factor=2),
    ("depthsplat-base", "dl3dv"): DepthSplatConfig("B", scales=2, upsample_factor=4),
    ("depthsplat-large", "re10k"): DepthSplatConfig("L", scales=2, upsample_factor=2),
}

OFFICIAL = (*(("mvsplat", variant) for variant in MVSPLAT_VARIANTS), *DEPTHSPLAT_CONFIGS)
"""Every (name, variant) that `build` knows."""


def build(
    name: str, variant: str = "re10k", scale_rule: str = "2025-04", sh_degree: int | None = None
) -> MVSplat | DepthSplat:
    """Make an official network with untrained weights, in evaluation mode.

    Args:
        name: "mvsplat", "depthsplat-small", "depthsplat-base" or "depthsplat-large".
        variant: architecture variant, named after its training set.
        scale_rule: of DepthSplat: "2025-04", or "2025-03" for checkpoints of March 2025.
        sh_degree: of MVSplat's output: 3 (the default), which is exact for images, or 4 for all coefficients.

    Raises:
        InputError: no such network, variant or rule; the message has those there are.
    """
    if (name, variant) not in OFFICIAL:
        known = ", ".join(f"{n} ({v})" for n, v in OFFICIAL)
        raise InputError(f"{name} ({variant}) is not a network known here; there are {known}", where="network")
    if scale_rule not in SCALE_RULES:
        raise InputError(f"{scale_rule!r}, expected one of {', '.join(SCALE_RULES)}", where="scale_rule")
    if name == "mvsplat":
        if sh_degree not in (None, 3, 4):
            raise InputError(f"{sh_degree}, expected 3 or 4", where="sh_degree")
        return MVSplat(RENDERED_DEGREE if sh_degree is None else sh_degree).eval()
    if sh_degree not in (None, 2):
        raise InputError(f"{sh_degree}, expected 2, the only degree of {name}", where="sh_degree")
    return DepthSplat(DEPTHSPLAT_CONFIGS[name, variant], scale_rule).eval()


__all__ = ["DEPTHSPLAT_CONFIGS", "OFFICIAL", "DepthSplat", "MVSplat", "build"]
