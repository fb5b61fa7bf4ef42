"""What training and validation work on: context views, target views, and depth where it is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tinysplat.rasteriser import render
from tinysplat_runtime.gaussian.sh import C0
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.system.decibels import decibels

Picture: TypeAlias = tuple[NDArray, NDArray, NDArray]
"""Image (H, W, 3) float32 RGB in [0, 1], K (3, 3) in pixels, c2w (4, 4)."""


@dataclass(frozen=True)
class TargetPicture:
    """A picture that the Gaussians of a sample shall give when they are drawn.

    Attributes:
        image: (3, h, w) float32 RGB in [0, 1], of any size.
        K: (3, 3) float32 intrinsics in pixels.
        c2w: (4, 4) float32, relative to the mean centre of the sample's views.
    """

    image: Tensor
    K: Tensor
    c2w: Tensor

    def camera(self) -> Camera:
        """Where it is taken."""
        height, width = self.image.shape[1:]
        return Camera(self.K.cpu().double().numpy(), self.c2w.cpu().double().numpy(), width, height)


@dataclass(frozen=True)
class Sample:
    """Posed views of one scene, and pictures from other places.

    Attributes:
        name: of the scene.
        images: (V, 3, H, W) float32 RGB in [0, 1].
        K: (V, 3, 3) float32 intrinsics in pixels.
        c2w: (V, 4, 4) float32, relative to their mean centre.
        near, far: depths handed to the network, scene units.
        targets: pictures to draw.
        depth: (V, H, W) z of the views, 0 where it is not known, or None.
    """

    name: str
    images: Tensor
    K: Tensor
    c2w: Tensor
    near: float
    far: float
    targets: tuple[TargetPicture, ...]
    depth: Tensor | None = None

    @classmethod
    def of(
        cls,
        name: str,
        views: Sequence[Picture],
        targets: Sequence[Picture],
        depth_range: tuple[float, float],
        depth: NDArray | None = None,
    ) -> Sample:
        """From arrays.

        Args:
            name: of the scene.
            views: of one size.
            targets: of any sizes.
            depth_range: near and far.
            depth: (V, H, W) float or None.
        """
        images, K, c2w = (np.stack(part) for part in zip(*views, strict=True))
        centre = np.asarray(c2w, np.float64)[:, :3, 3].mean(axis=0)

        def moved(pose: NDArray) -> Tensor:
            poses = np.array(pose, np.float64)
            poses[..., :3, 3] -= centre
            return torch.from_numpy(poses.astype(np.float32))

        return cls(
            name,
            torch.from_numpy(np.ascontiguousarray(images.transpose(0, 3, 1, 2), np.float32)),
            torch.from_numpy(np.asarray(K, np.float32)),
            moved(c2w),
            *depth_range,
            tuple(
                TargetPicture(
                    torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1), np.float32)),
                    torch.from_numpy(np.asarray(intrinsics, np.float32)),
                    moved(pose),
                )
                for image, intrinsics, pose in targets
            ),
            None if depth is None else torch.from_numpy(np.asarray(depth, np.float32)),
        )

    def to(self, device: torch.device) -> Sample:
        """The same on a device."""
        depth = None if self.depth is None else self.depth.to(device)
        tensors = {name: getattr(self, name).to(device) for name in ("images", "K", "c2w")}
        targets = tuple(TargetPicture(t.image.to(device), t.K.to(device), t.c2w.to(device)) for t in self.targets)
        return replace(self, **tensors, targets=targets, depth=depth)

    def inputs(self) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """The network's inputs: images (V, 3, H, W), unit K (V, 3, 3), c2w (V, 4, 4), near and far (V,)."""
        views, _, height, width = self.images.shape
        unit = self.K / self.K.new_tensor([[width], [height], [1]])
        near, far = (torch.full((views,), float(depth)) for depth in (self.near, self.far))
        return self.images, unit, self.c2w, near, far


def render_outputs(outputs: tuple[Tensor, ...], camera: Camera) -> Tensor:
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
    """Peak signal-to-noise ratio in dB of a picture clipped to [0, 1] to one of the same shape."""
    return decibels(float((image.clamp(0, 1) - target).square().mean()))
