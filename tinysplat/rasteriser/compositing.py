"""Splats to a picture with gradients: numba where it is installed and the tensors are on the CPU, else torch."""

from __future__ import annotations

import importlib.util
from typing import Any, Literal

import torch
from torch import Tensor

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.render.prepare import ALPHA_MIN
from tinysplat_runtime.render.renderer import NEAR_PLANE

from .projection import PinholeCamera, ProjectedSplats
from .tiles import composite_in_tiles

HAS_NUMBA = importlib.util.find_spec("numba") is not None

Backend = Literal["auto", "numba", "torch"]


def visible_order(splats: ProjectedSplats, opacities: Tensor, camera: PinholeCamera) -> tuple[Tensor, Tensor]:
    """Splats whose footprint touches the picture: indices nearest first, ties in the order given, and half extents.

    Returns:
        (n,) int64 and (n, 2) pixels.
    """
    with torch.no_grad():
        a, b, c = splats.conics.unbind(-1)
        reach = 2 * torch.log(opacities.clamp_min(1e-12) / ALPHA_MIN)
        shows = (reach > 0) & (splats.depths > NEAR_PLANE)
        half = torch.sqrt(reach.clamp_min(0)[:, None] * torch.stack([c, a], dim=1) / (a * c - b * b)[:, None])
        size = half.new_tensor([camera.width, camera.height])
        shows &= ((splats.centres + half > 0) & (splats.centres - half < size)).all(dim=1)
        index = torch.nonzero(shows)[:, 0]
        order = index[torch.argsort(splats.depths[index], stable=True)]
        return order, half[order]


def composite(
    splats: ProjectedSplats, opacities: Tensor, colours: Tensor, camera: PinholeCamera, backend: Backend = "auto"
) -> tuple[Tensor, Tensor]:
    """Blend splats front to back (Kerbl et al. 2023).

    Args:
        splats: of `project`.
        opacities: (N,) in [0, 1].
        colours: (N, 3).
        camera: its size is the picture's.
        backend: numba takes float32 on the CPU; auto chooses it where it can.

    Returns:
        The picture (H, W, 3) before a black background, and the transmittance (H, W).

    Raises:
        InputError: numba is asked for and is not installed.
    """
    order, half_extents = visible_order(splats, opacities, camera)
    is_suited = colours.device.type == "cpu" and colours.dtype == torch.float32
    if backend == "numba" and not HAS_NUMBA:
        raise InputError("needs the package numba; pip install numba brings it", where="rasteriser")
    if backend == "numba" or (backend == "auto" and HAS_NUMBA and is_suited):
        size = (camera.height, camera.width)
        image, left = _Compiled.apply(splats.centres, splats.conics, opacities, colours, order, size)
        return image, left
    records = torch.cat([splats.centres, splats.conics, opacities[:, None], colours], dim=1)
    return composite_in_tiles(records[order], half_extents, camera.height, camera.width)


class _Compiled(torch.autograd.Function):
    """`kernels.composite` and its gradient."""

    @staticmethod
    def forward(
        ctx: Any,
        centres: Tensor,
        conics: Tensor,
        opacities: Tensor,
        colours: Tensor,
        order: Tensor,
        size: tuple[int, int],
    ) -> tuple[Tensor, Tensor]:
        from . import kernels

        image, left = torch.zeros(*size, 3), torch.ones(size)
        inputs = [tensor.detach().contiguous() for tensor in (centres, conics, opacities, colours)]
        arrays = [tensor.numpy() for tensor in (order, *inputs, image, left)]
        kernels.composite(*arrays)
        ctx.save_for_backward(order, *inputs, image, left)
        return image, left

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        from . import kernels

        order, *inputs, image, left = ctx.saved_tensors
        d_image, d_left = (gradient.contiguous() for gradient in gradients)
        behind = (image * d_image).sum(dim=-1) + left * d_left
        out = torch.zeros(len(inputs[0]), 9)
        arrays = [tensor.numpy() for tensor in (order, *inputs, behind, d_image, out)]
        kernels.composite_gradient(*arrays)
        return out[:, :2], out[:, 2:5], out[:, 5], out[:, 6:], None, None
