"""What a sparse scene is to show: the photos of a capture, or what that shows of itself, where nobody has them."""

from __future__ import annotations

import numpy as np

from ..gaussian.gaussians import Gaussians
from ..refine.photos import matched, sizes_of
from ..render import Renderer
from ..render.gradient import Target
from ..scene.scenes import Scene
from ..system.told import NOBODY, Told
from . import MOST_SIDE, NETWORK_SIDE

COVERED = 0.9
"""Pixels of a drawn picture that are less opaque say nothing."""


def for_network(scene: Scene) -> Scene:
    """A scene's photos at the size that a network makes a list's first Gaussians of."""
    camera = scene.cameras[0]
    share = NETWORK_SIDE / min(camera.height, camera.width)
    if min(camera.height, camera.width) <= MOST_SIDE:
        return scene
    return scene.resized(round(share * camera.height), round(share * camera.width))


def photos_of(capture: Gaussians, scene: Scene) -> list[Target]:
    """The photos that the views of per-pixel Gaussians were taken as, of their size; errors as `photos.matched`."""
    return sizes_of(capture, matched(capture, scene), closer=False)[0]


def own_pictures(capture: Gaussians, threads: int | None = None, told: Told = NOBODY) -> list[Target]:
    """Pictures from the views of per-pixel Gaussians, as our own drawing has them. From elsewhere it shows ghosts, and
    a scene that learns these loses more than it gains.
    """
    renderer, targets = Renderer(capture, threads), []
    for camera in told.progress("drawing its pictures", capture.cameras):
        seen = renderer.render(camera, outputs=("rgb", "alpha"))
        is_known = seen["alpha"][..., None] >= COVERED
        targets.append(Target(camera, np.where(is_known, seen["rgb"], np.float32(np.nan)).astype(np.float32)))
    return targets
