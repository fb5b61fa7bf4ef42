"""Of what several photos show, the pixels of one: from these a list begins.

Views see every surface as often as it was photographed, each time a little beside itself, and before it what views that
look past them got wrong. So a Gaussian goes

- where a near view sees past it: it lies before the surface there, more often than others bear it out;
- where another near view shows the same place as finely or finer, which then shows it for all.

Coarse layers, which close holes between surfaces, stay faint where no surface is.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ...gaussian.gaussians import Gaussians
from ...scene.cameras import Camera
from ...scene.neighbours import nearest_places, view_places
from ...system import disk

LOOKED_AT = 8
"""Nearest views that a Gaussian is held against."""

SAME_DEPTH = 0.03
"""Of the depth: surfaces of two views that lie no farther apart are one."""

AS_FINE = 1.1
"""A view shows a place as finely as another where its pixel there is at most so many times as wide."""


BEHIND = 0.15
"""Share of their opacity that Gaussians of further layers keep: enough to close holes, and little to see in front."""


def opacities_kept(gaussians: Gaussians, run_jobs: Callable = map) -> list[NDArray]:
    """By layer, (V, H, W) float32 opacities, and −1 for what goes.

    Args:
        gaussians: per pixel, with cameras.
        run_jobs: maps a function over a list, on any number of threads.
    """
    views = range(len(gaussians.cameras))
    depths = disk.zeros(gaussians.opacities.shape)
    for view in views:
        depths[view] = _depths(gaussians, view)
    near, kept = _near(gaussians.cameras, depths), [disk.zeros(layer.opacities.shape) for layer in gaussians.layers]

    def fill(part: tuple[int, int]) -> None:
        number, view = part
        kept[number][view].flat = _opacities(gaussians, part, near[view], depths)

    list(run_jobs(fill, [(number, view) for number in range(len(kept)) for view in views]))
    return kept


def _opacities(gaussians: Gaussians, part: tuple[int, int], near: Sequence[int], depths: NDArray) -> NDArray:
    """(n,) float32 opacities of a layer and view, by their numbers; −1 for what goes."""
    number, view = part
    layer, is_surface = gaussians.layers[number], number == 0
    borne_out, before, served = _judged(layer.means[view].reshape(-1, 3), view, near, gaussians, depths, is_surface)
    keep = (before <= borne_out) & (served == 0)
    share = np.float32(1 if is_surface else BEHIND)
    return np.where(keep, share * layer.opacities[view].ravel(), np.float32(-1))


def _judged(
    means: NDArray, view: int, near: Sequence[int], gaussians: Gaussians, depths: NDArray, is_surface: bool
) -> tuple[NDArray, NDArray, NDArray]:
    """What near views say of a view's Gaussians, and of those of further layers its own surface, as fine as any.

    Returns:
        (n,) each: how many of them have the same surface, before how many's surface it lies, and how many show it as
        finely or finer, and come first.
    """
    own = _z(means, gaussians.origin, gaussians.cameras[view])
    width = own / gaussians.cameras[view].focal if is_surface else np.full(len(means), np.inf)
    borne_out, before, served = (np.zeros(len(means), np.int32) for _ in range(3))
    for other in near if is_surface else (view, *near):
        camera, depth = gaussians.cameras[other], depths[other]
        row, column, z, inside = pixels_of(means, gaussians.origin, camera)
        there = np.where(inside, depth[row, column], np.inf)
        away = z / there - 1
        same = inside & (np.abs(away) <= SAME_DEPTH)
        borne_out += same
        before += inside & (away < -SAME_DEPTH)
        finest = width * (AS_FINE if other < view else 1 / AS_FINE)
        wins = there / camera.focal <= finest
        served += same & wins
    return borne_out, before, served


def pixels_of(means: NDArray, origin: NDArray, camera: Camera) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Row and column, depth, and whether a camera sees a place at all; (n,) each, of means (n, 3)."""
    projection = (camera.K @ camera.rotation).astype(np.float32)
    offset = (origin - camera.centre).astype(np.float32)
    x, y, z = ((means + offset) @ projection.T).T
    ahead = z > 0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        column, row = np.floor(x / z), np.floor(y / z)
    inside = ahead & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    return np.where(inside, row, 0).astype(np.intp), np.where(inside, column, 0).astype(np.intp), z, inside


def _z(means: NDArray, origin: NDArray, camera: Camera) -> NDArray:
    return (means + (origin - camera.centre).astype(np.float32)) @ camera.rotation[2].astype(np.float32)


def _depths(gaussians: Gaussians, view: int) -> NDArray:
    """(H, W) float32 z of a view's surface; what lies behind the camera hides nothing."""
    z = _z(gaussians.means[view], gaussians.origin, gaussians.cameras[view])
    return np.where(z > 0, z, np.inf).astype(np.float32)


def _near(cameras: Sequence[Camera], depths: NDArray) -> list[list[int]]:
    """For each view the nearest others."""
    seen = disk.chosen(depths, lambda view: np.isfinite(depths[view]))
    middle = float(np.median(seen, overwrite_input=True)) if seen.size else 1.0
    places = view_places(cameras, middle, middle)
    nearest: list[list[int]] = nearest_places(places, min(LOOKED_AT, len(cameras) - 1)).tolist()
    return nearest
