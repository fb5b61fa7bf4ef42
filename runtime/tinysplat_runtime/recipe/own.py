"""How like its own photos a scene looks once it is a file: the render beside them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..container.reader import read_container
from ..gaussian.gaussians import FIELDS, Gaussians
from ..modes.decoder import decode_file
from ..network.ways import LEAST_EACH
from ..render import Renderer
from ..scene.cameras import Camera
from ..scene.viewchoice import ALL_VIEWS
from ..system.decibels import mean_decibels
from ..system.evenly import evenly
from ..system.told import NOBODY, Told
from .compress import Encoded
from .steps import Tools

LOW_DB = 20.0
"""Renders that differ more than this from their own photos point to something wrong with what was given."""

OWN_PIXELS = 1 << 20
"""Pixels of a photo that are drawn at most: a band across its middle; 12 million would take minutes and gigabytes."""

_SAMPLED = 16
"""Every so many-th row and column tell which rows of pixels a band is drawn with."""

OWN_VIEWS = 8
"""Photos of a capture that are looked at, spread over it."""


def compared(coded: Encoded, tools: Tools, model: str, told: Told = NOBODY) -> tuple[int, float]:
    """A file beside the photos that it was made of.

    Args:
        coded: the file, and its photos.
        tools: to do it with.
        model: the network of files that hold photos.
        told: who is told how many photos are compared.

    Returns:
        Its Gaussians, and dB, the mean over the photos that were looked at.
    """
    count, has_views = len(coded.photos.frames), coded.kind.has_views
    chosen = looked_at(count)
    file = read_container(coded.data, tools.limits, views=chosen if has_views else None)
    found = decode_file(file, tools.store, threads=tools.threads, model=model)
    seen = coded.photos.views(chosen)
    # compiled where judging and training have loaded that; a few pictures alone are drawn sooner without
    compiled = None if count >= LEAST_EACH else False
    psnr = own_psnr(found, seen.cameras, seen.images(judged=True), tools.threads, told, compiled=compiled)
    return found.count // len(chosen) * count if has_views else found.count, psnr


def looked_at(count: int) -> list[int]:
    """Which of so many photos a scene is compared with."""
    return list(range(count)) if count in ALL_VIEWS else evenly(count, OWN_VIEWS)


def own_psnr(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    images: NDArray,
    threads: int | None,
    told: Told = NOBODY,
    *,
    compiled: bool | None = False,
) -> float:
    """PSNR in dB of a scene's render at its own views to photos (V, H, W, 3), the mean over the views.

    Args:
        gaussians: the scene.
        cameras: of the photos.
        images: the photos, NaN where they do not count.
        threads, compiled: see `Renderer`.
        told: who is told how many photos are compared.
    """
    height, width = images.shape[1:3]
    rows = min(max(OWN_PIXELS // width, 1), height)
    first = (height - rows) // 2
    is_whole = rows == height or not gaussians.is_per_pixel
    whole = Renderer(gaussians, threads=threads, compiled=compiled) if is_whole else None

    def drawn(camera: Camera) -> NDArray:
        band = _rows_of(camera, slice(first, first + rows))
        if whole is not None:
            return whole.render(band)
        return Renderer(_about(gaussians, band), threads=threads, compiled=compiled, keep=False).render(band)

    return mean_decibels(map(drawn, told.progress("comparing photos", cameras)), images[:, first : first + rows])


def _rows_of(camera: Camera, rows: slice) -> Camera:
    K = camera.K.copy()
    K[1, 2] -= rows.start
    return Camera(K, camera.c2w, camera.width, rows.stop - rows.start)


def _about(gaussians: Gaussians, band: Camera) -> Gaussians:
    """The rows of pixels whose Gaussians lie in a band or near it; all of further layers."""
    points = gaussians.means[:, ::_SAMPLED, ::_SAMPLED] + (gaussians.origin - band.centre)
    y, z = np.moveaxis(points @ band.rotation[1:].T, -1, 0)
    v = band.K[1, 1] * y / np.maximum(z, 1e-12) + band.K[1, 2]
    margin = band.height / 4
    reached = np.flatnonzero(((z > 0) & (v > -margin) & (v < band.height + margin)).any(axis=(0, 2)))
    if not reached.size:
        return gaussians
    last = min((int(reached[-1]) + 2) * _SAMPLED, gaussians.opacities.shape[1])
    rows = slice(max(int(reached[0]) - 1, 0) * _SAMPLED, last)
    arrays = {name: np.ascontiguousarray(getattr(gaussians, name)[:, rows]) for name in FIELDS}
    cameras = tuple(_rows_of(camera, rows) for camera in gaussians.cameras)
    return gaussians.changed(**arrays, cameras=cameras)
