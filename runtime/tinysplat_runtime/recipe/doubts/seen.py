"""What doubts look at: a scene in small, corners of its photos, and how well these fit the cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...scene.cameras import Camera
from ...scene.intake.nerfstudio import BLENDER_FILE, FILE
from ...scene.look import LOOK_WIDTH, PLANES, neighbours, thumbnail_size
from ...scene.matches import Corners, corners, depths_told, inliers, matched
from ...scene.resampling import resize_cover
from ...scene.scenes import Frame, Scene
from ...system.evenly import evenly
from ...system.told import Told

CLOSER = 4
"""Times the side of a thumbnail in which corners are looked for: focal lengths show in a pixel of it."""

CHANCE, ENOUGH, CONFIRMED = 8, 30, 100
"""Corners: fewer fit by chance (another reading of right photos of thirty scenes gains 7.1 at most), so many say
something of depths and of photos that stand alone, and so many of all cameras."""

AGREEING = 0.25
"""Share of what two photos have in common that right cameras explain at least. Of corners 0.4 to 0.97 fit (ten scenes),
by chance 0.02; of pixels 0.26 to 0.73 have one depth from both sides, and fewer in nine of ten pairs of which one photo
is another scene's."""

FEW = 24
"""Photos whose corners are looked at."""


@dataclass(frozen=True, eq=False)
class Seen:
    """A scene in small: photos (V, H, W, 3), their cameras and names, depths (P,), and corners of some.

    An estimated range is in units of the poses and as wide as photos agree about, so nothing is said against it.
    """

    frames: tuple[Frame, ...]
    images: NDArray
    cameras: Sequence[Camera]
    names: tuple[str, ...]
    depths: NDArray
    corners: dict[int, Corners]
    is_estimated: bool
    are_opengl: bool = False

    @classmethod
    def of(cls, scene: Scene, told: Told) -> Seen:
        first = scene.cameras[0]
        small = scene.resized(*thumbnail_size(first))
        height, width = thumbnail_size(first, CLOSER * LOOK_WIDTH)
        closer = tuple(frame.resized(height, width) for frame in scene.frames)  # read once, and not kept
        scene.check_one_size()
        count = len(closer)
        looked = set(evenly(count, FEW))
        images, corners_of = [], {}
        frames = list(zip(scene.frames, closer, small.cameras, strict=True))
        for v, (frame, close, target) in enumerate(told.progress("checking photos", frames)):
            photo, camera = None, frame.camera
            if (
                frame.kept is not None
                and "image" not in frame.kept
                and camera.height >= height
                and camera.width >= width
            ):
                photo = frame.photo((camera.height, camera.width))
                frame.image(photo)  # is kept: the network will have it
            image = close.image(photo)
            images.append(resize_cover(image, target.height, target.width))
            if v in looked:
                corners_of[v] = corners(image)
        near, far = scene.depth_range()
        depths = 1 / np.linspace(1 / near, 1 / far, PLANES)
        names = tuple(
            f"photo {(v if frame.number is None else frame.number) + 1} ({frame.path.name})"
            for v, frame in enumerate(scene.frames)
        )
        are_opengl = any((scene.path / name).is_file() for name in (FILE, BLENDER_FILE))
        pictures = np.stack(images)
        return cls(closer, pictures, small.cameras, names, depths, corners_of, scene.is_estimated, are_opengl)

    @cached_property
    def closer(self) -> dict[int, Camera]:
        """The cameras of photos whose corners are known, in pixels of these."""
        return {v: self.frames[v].camera for v in sorted(self.corners)}

    @cached_property
    def places(self) -> dict[tuple[int, int], NDArray]:
        """What pairs of near photos have in common; see `matched`."""
        views = list(self.closer)
        beside = neighbours([*self.closer.values()])[:, :3].tolist()
        pairs = {(min(v, views[u]), max(v, views[u])) for v, us in zip(views, beside, strict=True) for u in us}
        return {(v, u): matched(self.corners[v], self.corners[u]) for v, u in sorted(pairs)}

    @cached_property
    def shares(self) -> dict[tuple[int, int], float]:
        """How many of these fit the cameras as given."""
        return {(v, u): inliers(places, self.closer[v], self.closer[u]) for (v, u), places in self.places.items()}

    @cached_property
    def confirmed(self) -> bool:
        """Whether corners of the photos agree with the cameras as given."""
        fits = sum(self.shares.values())
        return fits > max(CONFIRMED, AGREEING * sum(map(len, self.places.values())))

    @cached_property
    def corner_depths(self) -> NDArray:
        """Depths (N,) that corners tell, where these agree with the cameras."""
        if not self.confirmed:
            return np.empty(0)
        cameras = self.closer
        return np.concatenate([depths_told(places, cameras[v], cameras[u]) for (v, u), places in self.places.items()])

    @property
    def evened(self) -> NDArray:
        """Photos (V, H, W, 3) brought to their mean brightness, by factors of two at most."""
        level = self.images.mean(axis=(1, 2, 3), keepdims=True)
        return self.images * np.clip(level.mean() / level.clip(1e-3), 0.5, 2)
