"""How photos were taken: cameras as they were given, how far the photos contradict them, and how they were exposed.

Poses of apps and of long recordings drift, by a pixel and more, and so does exposure. Neighbours drift alike, so a
camera that nobody has corrected is corrected as those beside it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .cameras import Camera, finite_array, posed

NEAREST = 2
"""Viewpoints that a camera between them is corrected by."""

SAME = 1e-6
"""Nearer cameras are the same, as distances of docs/FORMAT.md, CAMS, are."""


@dataclass(frozen=True, eq=False)
class Viewpoint(Camera):
    """A photo's camera as it was given, the step from there to where its photo fits the scene, in its axes, and how the
    photo was exposed.

    Attributes:
        turn: (3,) float64 rotation vector, radians.
        shift: (3,) float64, scene units.
        is_alone: its neighbours' steps contradict its own, by which no other camera is then corrected.
        gain: (3,) float64, by what red, green and blue of the scene are multiplied in the photo.

    Raises:
        InputError: one of them is not finite, a gain not above 0, or as `Camera`.
    """

    turn: NDArray = field(default_factory=lambda: np.zeros(3))
    shift: NDArray = field(default_factory=lambda: np.zeros(3))
    is_alone: bool = False
    gain: NDArray = field(default_factory=lambda: np.ones(3))

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("turn", "shift", "gain"):
            object.__setattr__(self, name, finite_array(name, getattr(self, name), (3,)))
        if not (self.gain > 0).all():
            raise InputError(f"{self.gain.tolist()}, expected numbers above 0", where="gain")

    @classmethod
    def of(cls, camera: Camera, **seen: Any) -> Viewpoint:
        """A camera with some of `turn`, `shift`, `is_alone` and `gain`."""
        return cls(camera.K, camera.c2w, camera.width, camera.height, **seen)


def viewpoint_of(camera: Camera) -> Viewpoint:
    """A camera as it is, with a step of nothing and gains of 1 where it has none."""
    return camera if isinstance(camera, Viewpoint) else Viewpoint.of(camera)


def stepped(camera: Camera, turn: NDArray, shift: NDArray) -> Camera:
    """A camera turned by a rotation vector (3,) and moved by (3,) scene units, both in its axes."""
    R = camera.c2w[:3, :3]
    c2w = posed(R @ rotation_of(turn), camera.centre + R @ shift)
    return Camera(camera.K, c2w, camera.width, camera.height)


def corrected(camera: Camera, viewpoints: Sequence[Camera]) -> tuple[Camera, NDArray]:
    """A camera that is given as the viewpoints were, as it stands in the scene, and the (3,) gain of a photo there: by
    the nearest of them, each the more the nearer it is; as it is, and 1, where none has a step or gain.
    """
    if not any(isinstance(viewpoint, Viewpoint) for viewpoint in viewpoints):
        return camera, np.ones(3)
    apart = _distances(camera, *_poses(viewpoints))
    if apart.min() > SAME:
        alone = np.array([viewpoint_of(viewpoint).is_alone for viewpoint in viewpoints])
        apart[alone] += np.ptp(apart) + 1
    nearest = np.argsort(apart, kind="stable")[:NEAREST]
    shares = 1 / np.maximum(apart[nearest], SAME)
    near = [viewpoint_of(viewpoints[n]) for n in nearest]
    seen = np.array([[one.turn, one.shift, np.log(one.gain)] for one in near])
    turn, shift, log_gain = np.einsum("v,vij->ij", shares / shares.sum(), seen)
    return stepped(camera, turn, shift), np.exp(log_gain)


def nearest_viewpoints(viewpoints: Sequence[Camera]) -> NDArray:
    """(V, `NEAREST`) int64: those of the others that a camera at each would be corrected by."""
    poses, nearest = _poses(viewpoints), np.empty((len(viewpoints), min(NEAREST, len(viewpoints))), np.int64)
    for v, viewpoint in enumerate(viewpoints):
        apart = _distances(viewpoint, *poses)
        apart[v] = np.inf
        nearest[v] = np.argsort(apart, kind="stable")[:NEAREST]
    return nearest


def _poses(viewpoints: Sequence[Camera]) -> tuple[NDArray, NDArray]:
    """Centres (V, 3) and rotations (V, 3, 3)."""
    c2w = np.array([viewpoint.c2w[:3] for viewpoint in viewpoints])
    return c2w[..., 3], c2w[..., :3]


def _distances(camera: Camera, centres: NDArray, rotations: NDArray) -> NDArray:
    """(V,) float64 how far a camera is from each: in places, over how far apart these lie, and in radians."""
    spread = math.sqrt(np.square(centres - centres.mean(axis=0)).sum(axis=1).mean()) or 1.0
    turned = rotations - camera.c2w[:3, :3]
    return np.linalg.norm(centres - camera.centre, axis=1) / spread + np.linalg.norm(turned, axis=(1, 2)) / math.sqrt(2)


def rotation_of(turn: NDArray) -> NDArray:
    """(3, 3) float64 of a rotation vector (3,), radians (Rodrigues)."""
    angle = float(np.linalg.norm(turn))
    if not angle:
        return np.eye(3)
    x, y, z = turn / angle
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * across + (1 - math.cos(angle)) * across @ across
