"""Splats to a picture with gradients: what the runtime's compiled code draws, and its second walk (needs numba)."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.render.project import View, footprint_exponent, pixels_between
from tinysplat_runtime.render.renderer import NEAR_PLANE
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.system.threads import Crew

from .projection import PinholeCamera, ProjectedSplats

LEAST_OPACITY = 1e-9
"""Opacities below have no logarithm worth having, and no gradient."""


def composite(
    splats: ProjectedSplats, opacities: Tensor, colours: Tensor, camera: PinholeCamera
) -> tuple[Tensor, Tensor]:
    """Blend splats front to back (Kerbl et al. 2023), on the CPU, wherever the tensors are.

    Args:
        splats: of `project`.
        opacities: (N,) in [0, 1].
        colours: (N, 3).
        camera: its size is the picture's.

    Returns:
        The picture (H, W, 3) before a black background, and the transmittance (H, W).

    Raises:
        InputError: the package numba is missing.
    """
    log_opacities = opacities.clamp_min(LEAST_OPACITY).log()
    records = torch.cat([splats.centres, splats.factors, log_opacities[:, None], colours], dim=1)
    found: Tensor = _Picture.apply(records.float().cpu(), splats.depths.cpu(), camera.height, camera.width)
    found = found.to(colours)
    return found[..., :3], found[..., 3]


@functools.cache
def _run_jobs(threads: int) -> Callable:
    return Crew(threads).map


class _Drawing:
    """Lists of splats by the tiles of a picture, as the runtime's kernels take them."""

    def __init__(self, records: NDArray, depths: NDArray, height: int, width: int) -> None:
        """From (N, 9) float32 records, which begin as the runtime's do, and (N,) depths."""
        try:
            from tinysplat_runtime.render import kernels_project as of
            from tinysplat_runtime.render.lists import SplatBuffers
        except ImportError as error:
            raise InputError(f"{error}; pip install numba brings it", where="rasteriser") from None
        x, y, alpha_x, beta_x, gamma, log_opacities = records.T[: of.LOG_OPACITY + 1]
        tau = footprint_exponent(log_opacities)
        shows = (tau >= 0) & (depths > NEAR_PLANE) & np.isfinite(records).all(axis=1)
        root = np.sqrt(np.maximum(tau, 0))
        across, down = root * np.hypot(1, beta_x / gamma) / alpha_x, root / gamma
        x, y, across, down = np.where(shows, (x, y, across, down), np.float32(0))
        left, right = pixels_between(x - across, x + across, width)
        top, bottom = pixels_between(y - down, y + down, height)
        whole = np.zeros((len(records), of.RECORD), np.float32)
        whole[:, : records.shape[1]] = records
        shows &= (left <= right) & (top <= bottom)
        ends = (depths, left, np.where(shows, right, -1), top, bottom)
        for column, values in zip((of.DEPTH, of.LEFT, of.RIGHT, of.TOP, of.BOTTOM), ends, strict=True):
            whole[:, column] = values
        whole[:, of.REACH] = np.where(right - left >= of.CHORD_PX, 1 / alpha_x, 0)
        self.records = whole
        self.view = View.of(Camera(np.eye(3), np.eye(4), width, height), np.zeros(3), NEAR_PLANE)
        run_jobs = _run_jobs(torch.get_num_threads())
        self.buffers = SplatBuffers(0, run_jobs)
        self.visible = [self.buffers.adopt(whole, self.view)]

    def picture(self) -> Tensor:
        """(H, W, 4): colours and transmittance."""
        from tinysplat_runtime.render.kernels_blend import Picture, composite_tile

        size = self.view.camera.height, self.view.camera.width
        picture = Picture(np.empty((*size, 3), np.float32), np.empty(size, np.float32), np.empty((0, 0), np.float32))
        for lists in self.buffers.lists(self.visible, self.view):

            def draw(_: int, *tile: Any, rows: NDArray = lists.rows) -> None:
                composite_tile(self.records, rows, *tile, picture, False)

            self.buffers.work_on(lists, self.view, draw)
        return torch.cat([torch.from_numpy(picture.colour), torch.from_numpy(picture.left)[..., None]], dim=2)

    def sums(self, slopes: NDArray) -> Tensor:
        """(N, 9) sums of `kernels_gradient` for the gradient (H, W, 4) of a loss by the picture."""
        from tinysplat_runtime.render.kernels_gradient import PAIR, differentiate_tile

        found = torch.zeros(len(self.records), PAIR)
        for lists in self.buffers.lists(self.visible, self.view):
            pairs = np.empty((lists.rows.size, PAIR), np.float32)

            def walk(_: int, *tile: Any, rows: NDArray = lists.rows, pairs: NDArray = pairs) -> None:
                differentiate_tile(self.records, rows, *tile, slopes, pairs)

            self.buffers.work_on(lists, self.view, walk)
            found.index_add_(0, torch.from_numpy(lists.rows), torch.from_numpy(pairs))
        return found


class _Picture(torch.autograd.Function):
    """Records to a picture; the sums of the second walk give the gradient of each."""

    @staticmethod
    def forward(ctx: Any, records: Tensor, depths: Tensor, height: int, width: int) -> Tensor:
        ctx.save_for_backward(records)
        ctx.drawing = _Drawing(records.detach().numpy(), depths.numpy(), height, width)
        return ctx.drawing.picture()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        (records,) = ctx.saved_tensors
        sums = ctx.drawing.sums(gradients[0].contiguous().numpy())
        # Of the exponent ln o − u² − w², u = αx·dx + βx·dy and w = γ·dy
        pull, pull_u, pull_w, pull_uu, pull_uw, pull_ww = sums.T[:6]
        alpha_x, beta_x, gamma = records.T[2:5]
        by_record = (
            2 * alpha_x * pull_u,
            2 * (beta_x * pull_u + gamma * pull_w),
            -2 * (pull_uu - beta_x / gamma * pull_uw) / alpha_x,
            -2 * pull_uw / gamma,
            -2 * pull_ww / gamma,
            pull,
        )
        return torch.cat([torch.stack(by_record, dim=1), sums[:, 6:]], dim=1), None, None, None
