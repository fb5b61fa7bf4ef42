"""How far pictures of some Gaussians are from those of others, as 3DGS defines drawing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.scene.cameras import Camera


def error(found: Gaussians, wanted: Gaussians, cameras: Sequence[Camera]) -> float:
    """Mean squared error, over all cameras, of values cut at 1."""
    renderers = [Renderer(gaussians, 1, **DEFINITION) for gaussians in (found, wanted)]
    pictures = [[renderer.render(camera).clip(0, 1) for renderer in renderers] for camera in cameras]
    return float(np.mean([np.square(one - other).mean() for one, other in pictures]))


def psnr(found: Gaussians, wanted: Gaussians, cameras: Sequence[Camera]) -> float:
    """The same in dB."""
    return float(-10 * np.log10(error(found, wanted, cameras)))
