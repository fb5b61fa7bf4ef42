"""A subject, from what there is to photos: Source → Window → Shots."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tinysplat.datasets import Window
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.scenes import Scene

from ..rows import code_fingerprint, digest, model_fingerprint

DEPTHS = 16
"""Places along a pixel's ray, uniform in inverse depth from far to near."""

SHARE = 0.5
"""Share of them that must lie in the frame of a context view for the pixel to be covered."""


@dataclass(frozen=True)
class LeftOut:
    """Something that was not measured, and why, in a line.

    Attributes:
        where: scene, and window where only one is at fault.
        why: one line.
        count: windows lost, as far as can be told; a scene whose index cannot be read counts as one.
    """

    where: str
    why: str
    count: int = 1

    def __str__(self) -> str:
        return f"left out {self.where}: {self.why}"


@dataclass(frozen=True, eq=False)
class PhotoViews:
    """Views of one size.

    Attributes:
        images: (V, H, W, 3) float32 in [0, 1]; of what is drawn, NaN where a mask leaves pixels out.
        cameras: one per view.
    """

    images: NDArray
    cameras: tuple[Camera, ...]


@dataclass(frozen=True, eq=False)
class Shots:
    """A window's photos at one size, and its depth range; `scene` where its context is a scene folder's."""

    context: PhotoViews
    targets: PhotoViews
    near: float
    far: float
    scene: Scene | None = None


class Source(Protocol):
    """A scene with windows. Sources are small and picklable: worker processes read photos themselves."""

    @property
    def name(self) -> str:
        """The scene's name in results."""

    def windows(self) -> tuple[list[Window], list[LeftOut]]:
        """Windows that can be tried, and those whose entry is at fault; InputError if there is no index to read."""

    def shots(self, window: Window, size: tuple[int, int]) -> Shots:
        """Photos at (height, width); InputError names what is at fault."""

    def fingerprint(self, window: Window) -> str:
        """Changes when what the window's figures depend on, apart from model and code, changes."""


@dataclass(frozen=True)
class WindowJob:
    """A window and a model."""

    source: Source
    window: Window
    model: str
    size: tuple[int, int]

    def __str__(self) -> str:
        return f"{self.source.name} {self.window}, {self.model}"

    def shots(self) -> Shots:
        """The window's photos; InputError names what is at fault."""
        return self.source.shots(self.window, self.size)

    def stamp(self, *options: object) -> str:
        """Changes when anything that the window's figures depend on does: photos, network, code, libraries, options."""
        try:
            source = self.source.fingerprint(self.window)
        except (TinySplatError, OSError):
            source = ""  # the fault of the window, which will say so when it is measured
        return digest(source, model_fingerprint(self.model), self.size, code_fingerprint(), *options)


def covered_pixels(target: Camera, context: Sequence[Camera], near: float, far: float) -> NDArray:
    """Pixels whose ray runs inside the context views' frames: (H, W) bool.

    A place counts where any context view has it before its camera and within its picture, occluded or not. With
    targets between the contexts this leaves out the margins that no photo shows, whatever stands there.

    Args:
        target: the view looked at.
        context: the views that a network gets.
        near, far: z of the nearest and the farthest surface, scene units, 0 < near < far.
    """
    row, column = np.mgrid[: target.height, : target.width] + 0.5
    pixels = np.stack([column, row, np.ones_like(row)], axis=-1)
    rays = pixels @ np.linalg.inv(target.K).T @ target.c2w[:3, :3].T  # world, unit z in the target's frame
    inside = np.zeros((target.height, target.width))
    for inverse_depth in np.linspace(1 / far, 1 / near, DEPTHS):
        points = target.c2w[:3, 3] + rays / inverse_depth
        inside += np.any([_in_frame(points, camera) for camera in context], axis=0)
    return inside >= SHARE * DEPTHS


def _in_frame(points: NDArray, camera: Camera) -> NDArray:
    """Where world points (H, W, 3) appear in a camera's picture: (H, W) bool."""
    shown = (points - camera.c2w[:3, 3]) @ camera.c2w[:3, :3] @ camera.K.T
    z = shown[..., 2]
    x, y = (shown[..., i] / np.where(z > 0, z, 1) for i in (0, 1))
    return (z > 0) & (x >= 0) & (x <= camera.width) & (y >= 0) & (y <= camera.height)
