"""Gaussians of pixels that a mask leaves out: nothing shows of them, and their planes cost next to nothing.

Where masks show a background, a Gaussian that lies there in several other photos is nothing either (the visual hull,
Laurentini 1994): what a network takes to be behind an outline.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import FIELDS, Gaussians
from ..scene.cameras import Camera
from ..scene.masks import filled
from ..scene.scenes import Scene
from ..system.evenly import evenly

JUDGES, SURE = 8, 2
"""Photos with a background, spread over all, in which every Gaussian's place is looked up, and how many of them have to
say that nothing is there, and no fewer than say otherwise: masks are not always right."""

LEAST_SHOWN = 1 / 255
"""Opacity below which nothing shows."""


def hidden(gaussians: Gaussians, scene: Scene) -> Gaussians:
    """Gaussians of which those whose pixels do not count have opacity 0, and values that continue those beside them.

    Args:
        gaussians: per pixel of the scene's photos, with coarser layers or none; their arrays may be changed.
        scene: the photos.
    """
    known = [frame.known() for frame in scene.frames]
    if all(one is None for one in known):
        return gaussians
    empty = {v: _inner(~one) for v, one in enumerate(known) if one is not None and scene.frames[v].is_on_background}
    judges = {view: empty[view] for view in np.array([*empty])[evenly(len(empty), JUDGES)].tolist()} if empty else {}
    for view, own in enumerate(known):
        for layer in gaussians.layers:
            shown = layer.opacities[view] >= LEAST_SHOWN
            if own is not None:
                shown &= _seen_by(layer.cameras[view], scene.cameras[view], own)
            others = {judge: place for judge, place in judges.items() if judge != view}
            shown[shown] = ~_is_nothing(layer, view, shown, others, scene.cameras)
            _hide(layer, view, shown)
    return gaussians


def _inner(empty: NDArray) -> NDArray:
    """Pixels (H, W) of a background whose neighbours are of it, too."""
    grown = np.pad(empty, 1, mode="edge")
    beside = grown[:-2, 1:-1] & grown[2:, 1:-1] & grown[1:-1, :-2] & grown[1:-1, 2:]
    return empty & beside


def _is_nothing(
    layer: Gaussians, view: int, which: NDArray, empty: Mapping[int, NDArray], cameras: Sequence[Camera]
) -> NDArray:
    """Of a view's Gaussians, `which` (H, W) has n, whether (n,) enough other photos show background at their places."""
    means = layer.means[view][which].astype(np.float64) + layer.origin
    votes, voters = np.zeros(len(means), int), np.zeros(len(means), int)
    for other, place in empty.items():
        camera = cameras[other]
        x, y, z = ((means - camera.centre) @ (camera.K @ camera.rotation).T).T
        with np.errstate(divide="ignore", invalid="ignore"):
            column, row = x / z, y / z
        inside = (z > 0) & (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
        row, column = (np.where(inside, at, 0).astype(int) for at in (row, column))
        votes += inside & place[row, column]
        voters += inside
    return (votes >= max(min(SURE, len(empty)), 1)) & (2 * votes >= voters)


def _seen_by(camera: Camera, photo: Camera, known: NDArray) -> NDArray:
    """Which pixels of a layer, (H, W), lie where a photo's known ones do, (h, w); beyond its frame as at its border."""
    to_photo = photo.K @ np.linalg.inv(camera.K)
    row, column = (
        np.floor(to_photo[n, n] * (np.arange(count) + 0.5) + to_photo[n, 2]).astype(int).clip(0, of - 1)
        for n, count, of in ((1, camera.height, len(known)), (0, camera.width, known.shape[1]))
    )
    return known[row[:, None], column]


def _hide(layer: Gaussians, view: int, known: NDArray) -> None:
    """Hide what is not known (H, W) of a view."""
    if known.all():
        return
    arrays: dict[str, Any] = {name: getattr(layer, name)[view] for name in FIELDS}
    arrays["opacities"][~known] = 0
    if not known.any():
        return
    camera, shift = layer.cameras[view], layer.origin - layer.cameras[view].centre
    seen = (arrays["means"].astype(np.float64) + shift) @ (camera.K @ camera.rotation).T  # (H, W, 3), depth last
    depth = seen[..., 2:]
    scales = np.log(np.maximum(arrays["scales"], np.finfo(np.float32).tiny) / depth)
    towards = arrays["quats"][known].sum(axis=0)
    quats = arrays["quats"] * np.where(arrays["quats"] @ towards < 0, -1, 1)[..., None]
    sh = arrays["sh"].reshape(*known.shape, -1)
    row, column = np.mgrid[: known.shape[0], : known.shape[1]] + 0.5
    pixels = np.stack([column, row], axis=-1)  # (H, W, 2), their centres
    offsets = seen[..., :2] / depth - pixels
    smooth = filled(np.concatenate([offsets, 1 / depth, scales, quats, sh], axis=2), known)[~known]
    offsets, inverse, sizes, turns, colours = np.split(smooth, [2, 3, 6, 10], axis=1)
    homogeneous = np.concatenate([pixels[~known] + offsets, np.ones_like(inverse)], axis=1) * (1 / inverse)
    arrays["means"][~known] = homogeneous @ np.linalg.inv(camera.K @ camera.rotation).T - shift
    arrays["scales"][~known] = np.exp(sizes) / inverse
    length = np.linalg.norm(turns, axis=1, keepdims=True)
    arrays["quats"][~known] = np.where(length > 1e-6, turns / np.maximum(length, 1e-6), [1, 0, 0, 0])
    arrays["sh"][~known] = colours.reshape(len(colours), -1, 3)
