"""Which pixels of a capture become Gaussians: by what they show at first, later by what is still wrong there.

A capture has a Gaussian for every pixel of every photo. Some of them, larger, are enough: few where a photo is plain,
many where it has texture. `kept.py` says which of several photos shows a surface, and which see past it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...gaussian.gaussians import Gaussians, joined
from ...gaussian.sh import resized_sh
from ...system import disk
from . import FEW_PHOTOS, LEAST_GAUSSIANS, MOST_GAUSSIANS
from .contrast import contrast
from .kept import opacities_kept
from .settings import Settings

COARSE_SIZE = 1.7
"""Of themselves: how large Gaussians of layers that close holes begin."""

LARGEST = 8.0
"""Own pixels: no Gaussian begins larger."""

MOST_DETAIL = 2.0
"""Times as many Gaussians as where `Settings.overlap` photos show each surface, at most, however many show it."""

_ROUNDS = 20


@dataclass(frozen=True)
class Surface:
    """What of a capture's pixels may become Gaussians, and how much they show.

    Attributes:
        capture: per pixel, with cameras.
        weights: by layer, (V, H, W) float32, in proportion to which pixels are drawn.
        needed: how many Gaussians show it.
        texture: mean root of its contrast.
        alone: share of the photos' pixels that show what no other photo shows finer: 1 where none overlap.
        crowded: how many times as many its detail asks for as the photos' pixels can tell, at least 1.
    """

    capture: Gaussians
    weights: list[NDArray]
    needed: int
    texture: float
    alone: float
    crowded: float

    @classmethod
    def of(cls, capture: Gaussians, photos: Sequence[NDArray], settings: Settings, run_jobs: Callable) -> Surface:
        """Look at a capture's photos, by view (H, W, 3) float32 of any size of the capture's shape.

        Every surface counts once, in the view that shows it finest, and by the root of its contrast there: an edge
        needs Gaussians along it, and what lies beside it few. `run_jobs` maps a function over a list, on any threads.
        """
        weights = opacities_kept(capture, run_jobs)
        shape, finer = weights[0].shape[1:], photos[0][..., 0].size / weights[0][0].size
        contrasts = disk.zeros(weights[0].shape)
        for own, photo in zip(contrasts, photos, strict=True):
            own[:] = _of_size(contrast(photo)[..., None], *shape)[..., 0]
        mean = contrasts.mean()
        for number, layer in enumerate(weights):
            for view, own in enumerate(layer):
                own[:] = np.maximum(own, 0) * (1 + settings.texture * (mean if number else contrasts[view]))
        if not any(weight.any() for weight in weights):
            weights[0] = np.ones_like(weights[0])  # as views contradict each other everywhere, none is kept
        roots = disk.chosen(contrasts, lambda view: weights[0][view] > 0)
        np.sqrt(roots, out=roots)
        alone, least = roots.size / weights[0].size, 0 if len(photos) <= FEW_PHOTOS else 1
        finer *= min(max(1 / math.sqrt(settings.overlap * alone), least), MOST_DETAIL)
        asked = settings.detail * finer * float(roots.sum(dtype=np.float64))
        told = settings.told * len(photos) * photos[0][..., 0].size if len(photos) > FEW_PHOTOS else math.inf
        needed = min(max(round(min(asked, told)), LEAST_GAUSSIANS), MOST_GAUSSIANS)
        return cls(capture, weights, needed, float(roots.mean()), alone, max(asked / told, 1))

    def first(self, count: int, settings: Settings) -> Gaussians:
        """Gaussians (about `count`,) drawn from it, the more the more texture there is."""
        rng = np.random.default_rng(0)
        odds = _odds(self.weights, count)
        chosen, parts = _drawn(odds, count, rng), list[Gaussians]()
        for number, layer in enumerate(self.capture.layers):
            sizes = (settings.larger / np.sqrt(odds[0][chosen[0]])).clip(1, LARGEST) if number == 0 else COARSE_SIZE
            parts.append(_taken(layer, chosen[number], sizes, settings.opacity, settings.functions))
        return parts[0].changed(**joined(parts))


def further(capture: Gaussians, wrong: NDArray, count: int, settings: Settings, rng: np.random.Generator) -> Gaussians:
    """Gaussians (about `count`,) of a capture's pixels, the more the more is wrong there.

    Args:
        capture: per pixel, with cameras.
        wrong: (V, H, W) float32.
        count: how many.
        settings: how they begin.
        rng: chooses.
    """
    surface = capture.layers[0]
    shape = surface.opacities.shape[1:]
    weight = disk.zeros(surface.opacities.shape)
    for own, view, opacities in zip(weight, wrong, surface.opacities, strict=True):
        own[:] = _of_size(view[..., None], *shape)[..., 0] * opacities
    (chosen,) = _drawn(_odds([weight], count), count, rng)
    return _taken(surface, chosen, settings.added_size, settings.added_opacity, settings.functions)


def _of_size(picture: NDArray, height: int, width: int) -> NDArray:
    """(H, W, …) by nearest samples."""
    rows = (np.arange(height) * picture.shape[0] + picture.shape[0] // 2) // height
    columns = (np.arange(width) * picture.shape[1] + picture.shape[1] // 2) // width
    if picture.shape[:2] == (height, width):
        return picture
    return picture[rows.clip(0, picture.shape[0] - 1)][:, columns.clip(0, picture.shape[1] - 1)]


def _odds(weights: Sequence[NDArray], count: int) -> list[NDArray]:
    """Weights as odds, at most 1, that sum to `count`, or to all that have a weight."""
    scale = count / max(sum(float(weight.sum(dtype=np.float64)) for weight in weights), 1e-30)
    odds = [disk.zeros(weight.shape) for weight in weights]
    for _ in range(_ROUNDS + 1):
        for own, weight in zip(odds, weights, strict=True):
            np.minimum(np.multiply(weight, np.float32(scale), out=own), np.float32(1), out=own)
        expected = sum(float(own.sum(dtype=np.float64)) for own in odds)
        if not 0 < expected < 0.999 * count:
            break
        scale *= count / expected
    return odds


def _drawn(odds: Sequence[NDArray], count: int, rng: np.random.Generator) -> list[NDArray]:
    """Masks of what is drawn by its odds, `count` at most."""
    masks = [np.stack([rng.random(view.shape, np.float32) < view for view in part]) for part in odds]
    drawn = [np.flatnonzero(mask) for mask in masks]
    surplus = sum(map(len, drawn)) - count
    if surplus > 0:
        gone = np.zeros(surplus + count, bool)
        gone[rng.choice(gone.size, surplus, replace=False)] = True
        for mask, rows, off in zip(masks, drawn, np.split(gone, np.cumsum([*map(len, drawn)])[:-1]), strict=True):
            mask.flat[rows[off]] = False
    return masks


def _taken(layer: Gaussians, chosen: NDArray, sizes: NDArray | float, opacity: float, functions: int) -> Gaussians:
    """A layer's Gaussians of a mask, as a list, so many times as large."""
    count = int(np.count_nonzero(chosen))
    times = np.broadcast_to(np.asarray(sizes, np.float32), (count,))
    return Gaussians.unchecked(
        means=layer.means[chosen],
        quats=layer.quats[chosen],
        scales=layer.scales[chosen] * times[:, None],
        opacities=np.full(count, opacity, np.float32),
        sh=resized_sh(layer.sh[chosen], functions),
        origin=layer.origin,
        notes=layer.notes,
    )
