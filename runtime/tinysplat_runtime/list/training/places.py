"""Where photos were taken, corrected with every step of training by what moves the Gaussians.

A camera that moves one way shows what Gaussians that move the other way do. So its gradient is a sum over theirs.
Steps are in pixels at the middle depth. Their mean stays zero, so that the scene stays where the cameras have it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...scene.cameras import Camera
from ...scene.frusta import middle_depth
from ...scene.viewpoints import Viewpoint, nearest_viewpoints, stepped
from .descent import RunningMean
from .settings import Settings

MOMENTUM, MEMORY = 0.9, 0.99
"""Adam's β₁ and β₂."""

ALONE = 7.0
"""Times the median of how far photos' steps are from their neighbours': one that is farther off says nothing of how its
neighbourhood drifts."""


class Places:
    """Cameras of photos, and how far these have shown them to be from where they were given.

    Attributes:
        given: as they were given.
        steps: (V, 6) float64 rotation vectors, radians, and shifts, scene units, in each camera's axes.
    """

    def __init__(self, cameras: Sequence[Camera], means: NDArray, settings: Settings) -> None:
        """Of photos of Gaussians with (N, 3) `means`, in the world."""
        self.given, self.steps, self._settings = tuple(cameras), np.zeros((len(cameras), 6)), settings
        self._axes = np.array([camera.c2w[:3, :3] for camera in cameras])
        self._depths = np.array([middle_depth(means, camera) for camera in cameras])
        focals = np.array([camera.focal for camera in cameras])
        self._pixel = np.repeat(np.stack([1 / focals, self._depths / focals], axis=1), 3, axis=1)
        self._means, self._squares = np.zeros_like(self.steps), np.zeros_like(self.steps)
        self._taken, self._mean = np.zeros(len(cameras)), RunningMean()

    def seen(self, view: int, camera: Camera) -> Camera:
        """A photo's camera, of any size, where the photo now stands."""
        turn, shift = np.split(self.steps[view], 2)
        return stepped(camera, turn, shift)

    def correct(self, view: int, means: NDArray, gradient: NDArray, way: float) -> None:
        """Take a step down the gradient of a photo's loss with respect to (N, 3) `means`, both in the world, at a share
        of the way.
        """
        camera = self.seen(view, self.given[view])
        moved = np.concatenate([np.cross(means - camera.centre, gradient).sum(axis=0), gradient.sum(axis=0)])
        slope = -(moved.reshape(2, 3) @ camera.c2w[:3, :3]).ravel() * self._pixel[view]
        if not np.isfinite(slope).all():
            return  # Gaussians beyond what float32 can tell, which training drops
        self._taken[view] += 1
        self._means[view] += (1 - MOMENTUM) * (slope - self._means[view])
        self._squares[view] += (1 - MEMORY) * (slope * slope - self._squares[view])
        mean = self._means[view] / (1 - MOMENTUM ** self._taken[view])
        size = np.sqrt(self._squares[view] / (1 - MEMORY ** self._taken[view]))
        length = self._settings.place * self._settings.pace.left(way)
        self.steps[view] -= length * self._pixel[view] * mean / np.maximum(size, 1e-30)
        self._centre()
        if self._settings.pace.is_averaged(way):
            self._mean.take(self.steps)

    def settle(self) -> None:
        """Go on from the mean of the steps that were averaged, if any were."""
        if self._mean.value is not None:
            self.steps = self._mean.value

    def viewpoints(self) -> tuple[Camera, ...]:
        """The cameras as they were given, with their steps."""
        shown = self._shown()
        off = np.linalg.norm(shown - shown[nearest_viewpoints(self.given)].mean(axis=1), axis=1)
        alone = off > ALONE * np.median(off)
        return tuple(
            Viewpoint.of(camera, turn=step[:3], shift=step[3:], is_alone=bool(is_alone))
            for camera, step, is_alone in zip(self.given, self.steps, alone, strict=True)
        )

    def _shown(self) -> NDArray:
        """(V, 3) by what angles the middle of each picture is moved and turned."""
        turn, shift = self.steps[:, :3], self.steps[:, 3:] / self._depths[:, None]
        return np.stack([turn[:, 0] - shift[:, 1], turn[:, 1] + shift[:, 0], turn[:, 2]], axis=1)

    def _centre(self) -> None:
        world = np.einsum("vij,vkj->vki", self._axes, self.steps.reshape(-1, 2, 3))
        self.steps -= np.einsum("vji,kj->vki", self._axes, world.mean(axis=0)).reshape(-1, 6)
