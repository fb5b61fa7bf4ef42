"""A differentiable rasteriser: what `tinysplat_runtime.render` draws, with gradients to the Gaussians (needs numba).

    image, transmittance = render(means, quats, scales, opacities, colours, camera)

The runtime draws, and walks the picture a second time for gradients, as it does to train lists; on the CPU, wherever
the tensors are.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.sh import C0
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.system.threads import Crew

LEAST = 1e-9
"""Opacities, rests to 1 and lengths below say nothing, and have no gradient."""


def render(
    means: Tensor, quats: Tensor, scales: Tensor, opacities: Tensor, colours: Tensor, camera: Camera
) -> tuple[Tensor, Tensor]:
    """Draw Gaussians; those that are not finite show nowhere.

    Args:
        means: (N, 3) world, float32.
        quats: (N, 4) wxyz, unit.
        scales: (N, 3) standard deviations, scene units.
        opacities: (N,) in [0, 1].
        colours: (N, 3) RGB, not below 0.
        camera: where the picture is taken.

    Returns:
        The picture (H, W, 3) before a black background, and the transmittance (H, W); gradients reach every argument.

    Raises:
        InputError: the package numba is missing.
    """
    found: Tensor = _Picture.apply(means, quats, scales, opacities, colours, camera)
    return found[..., :3], found[..., 3]


@functools.cache
def _run_jobs(threads: int) -> Callable:
    return Crew(threads).map


class _Picture(torch.autograd.Function):
    """Fields of Gaussians to (H, W, 4), colours and transmittance."""

    @staticmethod
    def forward(ctx: Any, *given: Any) -> Tensor:
        *fields, ctx.camera = given
        try:
            from tinysplat_runtime.list.training.free import FreeGaussians
        except ImportError as error:
            raise InputError(f"{error}; pip install numba brings it", where="rasteriser") from None
        arrays = [field.detach().float().cpu().numpy() for field in fields]
        finite = np.all([np.isfinite(array.reshape(len(array), -1)).all(axis=1) for array in arrays], axis=0)
        means, quats, scales, opacities, colours = (np.where(finite, array.T, 0).T for array in arrays)
        gaussians = Gaussians.unchecked(
            means=means, quats=quats, scales=scales, opacities=opacities, sh=((colours - 0.5) / C0)[:, None]
        )
        units = np.maximum(scales.max(axis=1), LEAST)
        ctx.free = FreeGaussians(gaussians, units, _run_jobs(torch.get_num_threads()))
        ctx.save_for_backward(*fields, torch.from_numpy(units))
        return torch.from_numpy(ctx.free.draw(ctx.camera)).to(fields[-1])

    @staticmethod
    def backward(ctx: Any, *slopes: Tensor) -> tuple[Tensor | None, ...]:
        from tinysplat_runtime.list.training.kernels_free import LOG_SCALE, LOGIT, MOVE, SH_RED, TURN

        means, _, scales, opacities, _, units = ctx.saved_tensors
        found = torch.from_numpy(ctx.free.gradient(ctx.camera, slopes[0].float().cpu().contiguous().numpy()))
        by_value = found[:, : len(means)].T.to(means)
        by_move, by_log_scale = by_value[:, MOVE:LOG_SCALE], by_value[:, LOG_SCALE:TURN]
        return (
            by_move / units.to(means)[:, None],
            by_value[:, TURN:LOGIT],
            by_log_scale / scales.clamp_min(LEAST),
            by_value[:, LOGIT] / (opacities * (1 - opacities)).clamp_min(LEAST),
            by_value[:, SH_RED:] / C0,
            None,
        )
