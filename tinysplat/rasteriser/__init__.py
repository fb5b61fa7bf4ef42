"""A differentiable rasteriser: what `tinysplat_runtime.render` draws, with gradients to the Gaussians.

    image, transmittance = render(means, quats, scales, opacities, colours, camera)

`projection` is torch operations; `compositing` draws with the runtime's compiled code, on the CPU.
"""

from __future__ import annotations

from torch import Tensor

from .compositing import composite
from .projection import PinholeCamera, project

__all__ = ["PinholeCamera", "render"]


def render(
    means: Tensor, quats: Tensor, scales: Tensor, opacities: Tensor, colours: Tensor, camera: PinholeCamera
) -> tuple[Tensor, Tensor]:
    """Draw Gaussians.

    Args:
        means: (N, 3) world, float32.
        quats: (N, 4) wxyz, unit.
        scales: (N, 3) standard deviations, scene units.
        opacities: (N,) in [0, 1].
        colours: (N, 3) RGB, not below 0.
        camera: where the picture is taken.

    Returns:
        The picture (H, W, 3) before a black background, and the transmittance (H, W); gradients reach every argument.
    """
    return composite(project(means, quats, scales, camera), opacities, colours, camera)
