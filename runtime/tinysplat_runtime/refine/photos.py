"""The photos that Gaussians are held against: which of a scene's frames they are, and at which sizes.

Trust boundary: every view needs a photo of its own size and pose, whose values are numbers.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import Gaussians
from ..render.gradient import Target
from ..render.kernels_list import TILE_HEIGHT, TILE_WIDTH
from ..scene.cameras import Camera
from ..scene.matching import SAME_PLACE, reach_of, taken_as
from ..scene.scenes import Frame, Scene
from ..system import disk

SAME_PIXEL = 0.5
"""Largest difference in pixels of intrinsics."""

NOTHING = 0.0
"""Colour of a photo's pixels where a mask says that nothing is, so that Gaussians of other photos fade that show there.
Where something moved, nobody judges them."""

JUDGED_PIXELS = 256 * 256
"""Of a photo, about, by which Gaussians are judged: tiles spread over larger ones."""

COVERED = 0.4
"""A pixel is covered where no more than this transmittance is left."""

CLOSER = 2
"""Photos this many times as large are looked at too, where they are at hand: a scene is then good from closer."""


def matched(gaussians: Gaussians, scene: Scene) -> Scene:
    """The scene's frames that the views of the Gaussians were taken as, of their size and in their order.

    Raises:
        InputError: a list, or a view whose pose or intrinsics no frame has.
    """
    gaussians.check_pixels()
    if len(gaussians.cameras) < 2:
        raise InputError("one view, expected two or more: one photo says nothing about depth", where="gaussians")
    reach = reach_of(gaussians.cameras)
    height, width = gaussians.cameras[0].height, gaussians.cameras[0].width
    own = scene.views([_frame(view, camera, scene, reach) for view, camera in enumerate(gaussians.cameras)])
    if all((frame.camera.height, frame.camera.width) == (height, width) for frame in own.frames):
        return own  # with photos that are kept, and need not be read again
    return own.resized(height, width)


def _frame(view: int, camera: Camera, scene: Scene, reach: float) -> int:
    """The frame that has a view's pose."""
    best, nearest, away = taken_as(camera, scene, reach)
    if best is None:
        found = f"no photo has its pose; the nearest, {nearest}, lies {away:.3g} away"
        raise InputError(f"{found}, expected at most {SAME_PLACE * reach:.3g} and the same turn", where=f"view {view}")
    stated = scene.frames[best].resized(camera.height, camera.width).camera
    apart = float(np.abs(stated.K - camera.K).max())
    if apart > SAME_PIXEL:
        found = f"photo {best} at {camera.width}x{camera.height} has other intrinsics, {apart:.3g} px off"
        raise InputError(f"{found}, expected at most {SAME_PIXEL:g}: other sizes or crops?", where=f"view {view}")
    return best


def sizes_of(gaussians: Gaussians, scene: Scene, closer: bool = True) -> list[list[Target]]:
    """The photos at the size of the views, and at `CLOSER` times that size where they are that large.

    Args:
        gaussians: whose cameras the targets of the first size get.
        scene: of `matched`.
        closer: whether that second size is wanted.

    Raises:
        InputError: a photo that cannot be read.
    """
    height, width = gaussians.cameras[0].height, gaussians.cameras[0].width
    sizes = [targets_of(gaussians.cameras, scene.frames)]
    if closer and all(_is_as_large(frame, CLOSER * height, CLOSER * width) for frame in scene.frames):
        larger = [frame.resized(CLOSER * height, CLOSER * width) for frame in scene.frames]
        sizes.append(targets_of([frame.camera for frame in larger], larger))
    return sizes


def in_parts(photo: NDArray, first: int) -> NDArray:
    """A photo (H, W, 3), NaN but for tiles of about `JUDGED_PIXELS` together, spread over it; `first` moves them."""
    rows, columns = np.arange(photo.shape[0]) // TILE_HEIGHT, np.arange(photo.shape[1]) // TILE_WIDTH
    every = max(photo[..., 0].size // JUDGED_PIXELS, 1)
    is_judged = (rows[:, None] + 2 * columns + first) % every == 0
    return np.where(is_judged[..., None], photo, np.float32(np.nan))


def targets_of(cameras: Sequence[Camera], frames: Sequence[Frame]) -> list[Target]:
    """Photos of one size, and where nothing is in them, of a capture on disk.

    Args:
        cameras: of the photos, of one size.
        frames: which they are, of that size.

    Raises:
        InputError: a photo that cannot be read.
    """
    photos = disk.zeros((len(cameras), cameras[0].height, cameras[0].width, 3))
    shares = disk.zeros(photos.shape[:3]) if any(frame.is_on_background for frame in frames) else None
    targets = []
    for view, (camera, photo, frame) in enumerate(zip(cameras, photos, frames, strict=True)):
        photo[:] = frame.image()
        if not np.isfinite(photo).all():
            raise InputError("holds NaN or infinity, expected RGB in [0, 1]", where="photos")
        nothing = None
        if (known := frame.known()) is not None:
            photo[~known] = NOTHING if frame.is_on_background else np.nan
            if shares is not None and frame.is_on_background:
                nothing = shares[view]
                nothing[:] = ~known
        targets.append(Target(camera, photo, nothing=nothing))
    return targets


def _is_as_large(frame: Frame, height: int, width: int) -> bool:
    photo = frame.photo_camera or frame.camera
    return photo.height >= height and photo.width >= width
