"""Whether photos and cameras belong together: a look before the network runs, the render beside them after."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import Gaussians
from ..render import Renderer
from ..scene.cameras import Camera
from ..scene.look import PLANES, UNSEEN, look, thumbnail_size
from ..scene.scenes import Scene

LOW_DB = 20.0
"""Renders that differ more than this from their own photos point to something wrong with what was given."""

SUSPICIOUS = 0.08
"""Cost of a look from which on other readings of the cameras are tried; real scenes lie at 0.03 to 0.13."""

BETTER = 0.75
"""A reading is named as the likely one where its cost is below this share of the cost as given."""

BLANK = 4 / 255
"""A thumbnail whose brightness spans less shows nothing."""

UNITS = (1000.0, 100.0, 10.0, 0.1, 0.01, 0.001)


def own_psnr(gaussians: Gaussians, images: NDArray, threads: int | None) -> float:
    """PSNR in dB of Gaussians' render at their own views to photos (V, H, W, 3), the mean over the views."""
    renderer = Renderer(gaussians, threads=threads, compiled=False)
    errors = [
        float(np.mean((renderer.render(camera) - image) ** 2, dtype=np.float64))
        for camera, image in zip(gaussians.cameras, images, strict=True)
    ]
    return float(np.mean([-10 * math.log10(max(error, 1e-12)) for error in errors]))


def likely_fault(scene: Scene) -> str | None:
    """What is likely wrong with a scene's cameras or depth range, in a few words; None where nothing stands out.

    Photos whose thumbnails agree much better once the cameras are read in another way were given in that way.
    """
    height, width = thumbnail_size(scene.cameras[0])
    small = scene.resized(height, width)
    images, cameras = small.images(), small.cameras
    blank = [str(n) for n, image in enumerate(images) if np.ptp(image.mean(axis=-1)) < BLANK]
    if blank:
        return f"photos of one colour show nothing to find depth by: {', '.join(blank)}"
    near, far = scene.depth_range()
    depths = 1 / np.linspace(1 / near, 1 / far, PLANES)

    def cost(read: Sequence[Camera]) -> float:
        return float(np.mean([seen.cost for seen in look(images, read, depths)]))

    given = cost(cameras)
    if given < SUSPICIOUS:
        return None
    readings = {
        "c2w holds world-to-camera matrices (w2c): with their inverses": [_inverse(camera) for camera in cameras],
        "c2w has OpenGL axes (y up, z backward) where OpenCV's are expected: with y and z turned": [
            _flipped(camera) for camera in cameras
        ],
        **{
            f"translations are in other units than near and far: times {unit:g}": [_scaled(c, unit) for c in cameras]
            for unit in UNITS
        },
    }
    costs = {text: cost(read) for text, read in readings.items()}
    best = min(costs, key=costs.__getitem__)
    if costs[best] < BETTER * given:
        return f"{best}, photos agree far better"
    if given > 0.97 * UNSEEN:
        return "the cameras stand back to back: no photo shows what another does between near and far"
    return None


def _inverse(camera: Camera) -> Camera:
    return Camera(camera.K, camera.w2c, camera.width, camera.height)


def _flipped(camera: Camera) -> Camera:
    return Camera(camera.K, camera.c2w @ np.diag([1.0, -1.0, -1.0, 1.0]), camera.width, camera.height)


def _scaled(camera: Camera, factor: float) -> Camera:
    c2w = camera.c2w.copy()
    c2w[:3, 3] *= factor
    try:
        return Camera(camera.K, c2w, camera.width, camera.height)
    except InputError:  # beyond what a camera may have
        return camera
