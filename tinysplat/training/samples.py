"""What training and validation work on: context views, target views, and depth where it is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tinysplat.rasteriser import PinholeCamera, render
from tinysplat_runtime.gaussian.sh import C0


@dataclass(frozen=True)
class Sample:
    """Posed pictures of one scene, the context views first.

    Attributes:
        name: of the scene.
        images: (V + T, 3, H, W) float32 RGB in [0, 1].
        K: (V + T, 3, 3) float32 intrinsics in pixels.
        c2w: (V + T, 4, 4) float32, relative to the mean centre of the context views.
        near, far: depths handed to the network, scene units.
        views: V, the number of context views.
        depth: (V, H, W) exact z of the context views, or None.
    """

    name: str
    images: Tensor
    K: Tensor
    c2w: Tensor
    near: float
    far: float
    views: int
    depth: Tensor | None = None

    @classmethod
    def of(
        cls, name: str, images: NDArray, K: NDArray, c2w: NDArray, depth_range: tuple[float, float], views: int,
        depth: NDArray | None = None,
    ) -> Sample:  # fmt: skip
        """From arrays: images (N, H, W, 3), K (N, 3, 3), c2w (N, 4, 4) float64, depth (V, H, W) or None."""
        moved = np.array(c2w, np.float64)
        moved[:, :3, 3] -= moved[:views, :3, 3].mean(axis=0)
        return cls(
            name,
            torch.from_numpy(np.ascontiguousarray(images.transpose(0, 3, 1, 2), np.float32)),
            torch.from_numpy(np.asarray(K, np.float32)),
            torch.from_numpy(moved.astype(np.float32)),
            *depth_range,
            views,
            None if depth is None else torch.from_numpy(np.asarray(depth, np.float32)),
        )

    def to(self, device: torch.device) -> Sample:
        """The same on a device."""
        depth = None if self.depth is None else self.depth.to(device)
        tensors = {name: getattr(self, name).to(device) for name in ("images", "K", "c2w")}
        return replace(self, **tensors, depth=depth)

    def inputs(self) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """The network's inputs: images, unit K, c2w, near, far of the context views."""
        height, width = self.images.shape[2:]
        unit = self.K[: self.views] / self.K.new_tensor([[width], [height], [1]])
        near, far = (torch.full((self.views,), float(depth)) for depth in (self.near, self.far))
        return self.images[: self.views], unit, self.c2w[: self.views], near, far

    def targets(self) -> list[tuple[Tensor, PinholeCamera]]:
        """Target pictures (3, H, W) and their cameras."""
        height, width = self.images.shape[2:]
        return [
            (self.images[i], PinholeCamera(self.K[i], self.c2w[i], height, width))
            for i in range(self.views, len(self.images))
        ]


def render_outputs(outputs: tuple[Tensor, ...], camera: PinholeCamera) -> Tensor:
    """Draw what a network of two layers returns, SH of degree 0, before black: (3, H, W)."""
    surface, coarse = outputs[:5], outputs[5:10]
    means, quats, scales = (
        torch.cat([a.reshape(-1, a.shape[-1]), b.reshape(-1, b.shape[-1])])
        for a, b in zip(surface[:3], coarse[:3], strict=True)
    )
    opacities = torch.cat([surface[3].reshape(-1), coarse[3].reshape(-1)])
    colours = (0.5 + C0 * torch.cat([layer[4].reshape(-1, 3) for layer in (surface, coarse)])).clamp_min(0)
    image, _ = render(means, quats, scales, opacities, colours, camera)
    return image.permute(2, 0, 1)


def psnr(image: Tensor, target: Tensor) -> float:
    """Peak signal-to-noise ratio in dB of a picture clipped to [0, 1]."""
    return float(-10 * torch.log10((image.clamp(0, 1) - target).square().mean().clamp_min(1e-10)))
