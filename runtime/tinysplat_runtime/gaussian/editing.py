"""Gaussians cut, moved and joined: what stands between reading one file and writing another.

Selections give a list (N,) of Gaussians, because what is left are no longer the pixels of views; movements keep pixels,
layers and cameras, which move along.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..scene.cameras import Camera
from ..scene.viewpoints import Viewpoint
from .gaussians import Gaussians, joined
from .notes import Notes
from .quaternions import matrices_to_quats, multiply_quats
from .sh import sh_basis, spread_directions

_DIRECTIONS = 64  # more than the 25 functions of degree 4, so that the fit below is exact


def select_views(gaussians: Gaussians, views: Iterable[int]) -> Gaussians:
    """The Gaussians of some views, all layers, as per-pixel Gaussians of those views.

    Raises:
        InputError: a list, or a view that does not exist or is given twice.
    """
    chosen = list(views)
    if not gaussians.is_per_pixel:
        raise InputError("a list has no views to choose from", where="views")
    count = len(gaussians.cameras)
    if not chosen or len(set(chosen)) < len(chosen) or not all(0 <= view < count for view in chosen):
        raise InputError(f"{chosen}, expected different views of 0 to {count - 1}", where="views")

    chosen_of = [g.taken(chosen).changed(cameras=tuple(g.cameras[view] for view in chosen)) for g in gaussians.layers]
    return Gaussians.stacked(chosen_of)


def trim_border(gaussians: Gaussians, pixels: int) -> Gaussians:
    """All layers as a list (N,), without the outermost `pixels` of every view of the first layer.

    Raises:
        InputError: a list, or a border that leaves nothing.
    """
    if not gaussians.is_per_pixel:
        raise InputError("a list has no border", where="trim border")
    _, height, width = gaussians.opacities.shape
    if not 0 <= 2 * pixels < min(height, width):
        raise InputError(f"{pixels} pixels of {width}x{height}, expected less than half of either", where="trim border")
    inside = np.zeros(gaussians.opacities.shape, bool)
    inside[:, pixels : height - pixels, pixels : width - pixels] = True
    others = [np.ones(layer.opacities.size, bool) for layer in gaussians.extra_layers]
    return _kept(gaussians.flat(), np.concatenate([inside.ravel(), *others]))


def drop_transparent(gaussians: Gaussians, min_opacity: float) -> Gaussians:
    """All layers as a list (N,), without Gaussians of an opacity below `min_opacity`.

    Raises:
        InputError: not 0 ≤ min_opacity ≤ 1, or nothing is left.
    """
    if not 0 <= min_opacity <= 1:
        raise InputError(f"{min_opacity:g}, expected 0 to 1", where="min opacity")
    flat = gaussians.flat()
    return _kept(flat, flat.opacities >= min_opacity)


def crop(gaussians: Gaussians, low: ArrayLike, high: ArrayLike) -> Gaussians:
    """All layers as a list (N,), without Gaussians whose mean lies outside the box from `low` to `high`, world units.

    Raises:
        InputError: an empty box, or nothing is left.
    """
    corners = np.array([low, high], np.float64)
    if not (corners[0] < corners[1]).all():
        raise InputError(f"from {corners[0].tolist()} to {corners[1].tolist()}, expected a box", where="crop")
    flat = gaussians.flat()
    means = flat.means.astype(np.float64) + flat.origin
    inside = ((means >= corners[0]) & (means <= corners[1])).all(axis=1)
    if not inside.any():
        low, high = ("(" + ", ".join(f"{x:.3g}" for x in corner) + ")" for corner in (means.min(0), means.max(0)))
        raise InputError(f"none of {len(means)} Gaussians lies in it, they lie from {low} to {high}", where="crop")
    return _kept(flat, inside)


def merge(parts: Sequence[Gaussians]) -> Gaussians:
    """All layers of several sets as one list (N,), relative to the first one's origin; notes and viewpoints joined."""
    flats = [part.flat() for part in parts]
    origin = flats[0].origin
    moved = [flat.changed(means=flat.means + (flat.origin - origin)) for flat in flats]
    notes = Notes.joined([part.notes for part in parts])
    viewpoints = tuple(camera for flat in flats for camera in flat.viewpoints)
    arrays: dict[str, Any] = joined(moved)
    return Gaussians(**arrays, origin=origin, notes=notes, viewpoints=viewpoints)


def cut_degree(gaussians: Gaussians, degree: int) -> Gaussians:
    """The same Gaussians with SH of at most `degree`."""
    if not 0 <= degree <= 4:
        raise InputError(f"{degree}, expected 0 to 4", where="SH degree")
    functions = (degree + 1) ** 2
    return Gaussians.stacked([replace(g, sh=g.sh[..., :functions, :]) for g in gaussians.layers])


def similarity(
    gaussians: Gaussians,
    rotation: ArrayLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    scale: float = 1.0,
    translation: ArrayLike = (0, 0, 0),
) -> Gaussians:
    """Move the scene: x becomes scale · R x + t for means and cameras; scales, rotations and SH follow.

    What the notes say of the unit is dropped where the scale is not 1.

    Args:
        gaussians: any.
        rotation: (3, 3) rotation R.
        scale: above 0.
        translation: t, (3,), world units.

    Raises:
        InputError: `rotation` is none, or a number is out of range.
    """
    R, t = np.array(rotation, np.float64), np.array(translation, np.float64)
    if R.shape != (3, 3) or not np.abs(R @ R.T - np.eye(3)).max() < 1e-6 or np.linalg.det(R) < 0:
        raise InputError("no rotation matrix", where="rotation")
    if not 0 < scale < np.inf:
        raise InputError(f"{scale:g}, expected a number above 0", where="scale")
    if t.shape != (3,) or not np.isfinite(t).all():
        raise InputError(f"{t.tolist()}, expected three finite numbers", where="translation")
    turn = None if np.array_equal(R, np.eye(3)) else R
    # a translation of a scene without an origin of its own goes into the means, as files without one need it there
    moved_origin = scale * (R @ gaussians.origin) + t if gaussians.origin.any() else np.zeros(3)
    shift = np.zeros(3) if gaussians.origin.any() else t

    def move(layer: Gaussians) -> Gaussians:
        return Gaussians(
            means=scale * (layer.means.astype(np.float64) @ R.T) + shift,
            quats=layer.quats if turn is None else multiply_quats(matrices_to_quats(R), layer.quats),
            scales=layer.scales * np.float32(scale),
            opacities=layer.opacities,
            sh=layer.sh if turn is None else rotate_sh(layer.sh, R),
            cameras=tuple(moved_camera(camera, R, scale, t) for camera in layer.cameras),
            origin=moved_origin,
            viewpoints=tuple(moved_camera(camera, R, scale, t) for camera in layer.viewpoints),
        )

    # a unit no longer fits what was enlarged
    notes = gaussians.notes if scale == 1 else replace(gaussians.notes, unit="")
    return Gaussians.stacked([move(layer) for layer in gaussians.layers]).with_notes(notes)


def rotate_sh(sh: NDArray, rotation: NDArray) -> NDArray:
    """Coefficients (…, B, 3) float64 of the same colours in a scene turned by R: c'(d) = c(Rᵀ d).

    Functions of one degree turn among themselves; their matrix follows from their values at fixed directions, which
    it must carry over: Y(d) A = Y(Rᵀ d).
    """
    degree = int(np.sqrt(sh.shape[-2])) - 1
    directions = spread_directions(_DIRECTIONS)
    here, there = sh_basis(directions, degree), sh_basis(directions @ rotation, degree)  # (64, B)
    turned = np.empty(sh.shape, np.float64)
    for n in range(degree + 1):
        band = slice(n * n, (n + 1) ** 2)
        matrix = np.linalg.lstsq(here[:, band], there[:, band], rcond=None)[0]
        turned[..., band, :] = matrix @ sh[..., band, :].astype(np.float64)
    return turned


def moved_camera(camera: Camera, rotation: NDArray, scale: float, translation: NDArray) -> Camera:
    """A camera moved along with a scene: see `similarity`."""
    c2w = camera.c2w.copy()
    c2w[:3, :3] = rotation @ c2w[:3, :3]
    c2w[:3, 3] = scale * rotation @ c2w[:3, 3] + translation
    if isinstance(camera, Viewpoint):
        return replace(camera, c2w=c2w, shift=scale * camera.shift)
    return replace(camera, c2w=c2w)


def _kept(flat: Gaussians, keep: NDArray) -> Gaussians:
    if not keep.any():
        raise InputError(f"none of {len(keep)} Gaussians is left", where="selection")
    return flat.taken(keep)
