"""Depth on which all photos of a capture agree: a search over planes, between the stages `estimate` and `dress`.

A network finds depth in a few photos at a time, and where photos of different groups show one corner it often lies some
pixels apart, which blurs every picture that is drawn of both. Here every pixel of every photo has a plane, which starts
as what the network found, and tries those of its neighbours, the depths that maps of other photos put there, and its
own a little nearer and farther; the cheapest stays (PatchMatch stereo, Bleyer, Rhemann & Rother 2011; in red and black
pixels by turns, Galliani, Lasinger & Schindler 2015). A plane costs what it shows unlike the better half of the photo's
sources (so chosen in COLMAP, Schönberger et al. 2016, and ACMH, Xu & Tao 2019), how far their own maps are from it, and
a little for leaving the network's depth where nothing has texture and for jumps between alike neighbours. A pixel
leaves the network's depth only where that is clearly cheaper at the end.

All of it is done at half of the photos' size, where windows see more. Photos do not wait for each other within a pass,
so one is worked on with its sources alone, and no result depends on threads. Constants: docs/lab/depth.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..scene.cameras import Camera
from ..scene.neighbours import Neighbours
from ..scene.scenes import Frame
from ..system import disk
from ..system.told import NOBODY, Told
from .kernels_joint import Compared, medians, put, search

SOURCES = 5
"""Nearest partners that a photo is compared with."""

FORWARD = 3
"""How many of these offer their depths as candidates."""

PASSES, MARGIN = 4, 0.1
"""Passes, and the least gain over the network's depth for which a pixel leaves it at the end."""

FEW, FEW_PASSES, FEW_MARGIN = 6, 2, 0.15
"""The same for this few photos, which contradict a wrong plane less often."""

CLEAN = 1
"""Radius in pixels of the median that removes speckles where there is no texture."""

BELOW, ABOVE = 0.8, 1.1
"""Factors by which inverse depths may exceed the network's range for a photo; not below 0.3 of the far plane's."""

FLATTEN = 3
"""Radius in pixels of the median that smooths slopes."""


@dataclass(frozen=True, eq=False)
class Photos:
    """Photos of one exposure at the size of maps.

    Attributes:
        colours: (V, h, w, 3) float32 in [0, 1].
        Ks: (V, 3, 3) float64 intrinsics at that size, pixels.
        cameras: where they were taken.
        near, far: depths between which the scene lies, scene units.
        marks: (V, h, w) of `marks_of`; None where all pixels count.
    """

    colours: NDArray
    Ks: NDArray
    cameras: Sequence[Camera]
    near: float
    far: float
    marks: NDArray | None = None


def joint_depth(inverse: NDArray, photos: Photos, run_jobs: Callable, told: Told = NOBODY) -> NDArray:
    """Correct the inverse depths of a capture's photos.

    Args:
        inverse: (V, h, w) float32, what a network found, per scene unit.
        photos: what they show.
        run_jobs: calls a function of each of a list, as `system.threads.Crew.map` does.
        told: is told of each pass.

    Returns:
        (V, h, w) float32; photos without a partner as they were.
    """
    views = range(len(inverse))
    neighbours = Neighbours.of(photos.cameras, photos.near, photos.far)
    beside = [_Beside.of(v, partners[:SOURCES], photos) for v, partners in enumerate(neighbours.partners)]
    matched = [v for v in views if len(beside[v].views) > 1]
    passes, margin = (PASSES, MARGIN) if len(views) > FEW else (FEW_PASSES, FEW_MARGIN)
    planes, found = disk.zeros((len(views), 3, *inverse.shape[1:])), disk.zeros(inverse.shape)

    def start(v: int) -> None:
        planes[v] = _sloped(inverse[v])
        show(v)

    def show(v: int) -> None:
        """What a photo has found becomes what others are held against."""
        marks = None if photos.marks is None else photos.marks[v]
        found[v] = planes[v, 0] if marks is None else np.where(np.isnan(marks), planes[v, 0], marks)

    def improve(v: int) -> None:
        low, high = max(float(inverse[v].min()) * BELOW, 0.3 / photos.far), float(inverse[v].max()) * ABOVE
        beside[v].search(photos.colours, found, inverse[v], planes[v], beside[v].candidates(found), low, high)

    def settle(v: int) -> None:
        """The better of what was found and what the network says becomes a photo's."""
        none, own = np.zeros((0, *inverse.shape[1:]), np.float32), planes[v, 0].copy()
        now, before = (
            beside[v].search(photos.colours, found, inverse[v], _sloped(maps), none, 0, 1) for maps in (own, inverse[v])
        )
        medians(np.where(before - now < margin, inverse[v], own), CLEAN, planes[v, 0])

    run_jobs(start, views)
    for job in told.progress("agreeing on depth", [*[improve] * passes, settle]):
        run_jobs(job, matched)
        for v in matched:
            show(v)
    return planes[:, 0]


def marks_of(frames: Sequence[Frame], height: int, width: int) -> NDArray | None:
    """What pixels of maps at half of the photos' size are held to be in place of what is found there.

    Returns:
        (V, height, width) float32: NaN where anything may be; 0, infinitely far, where a mask says that nothing is; −1,
        which no other photo is held against, where something moves. None where all pixels count.
    """
    marks = None
    for v, frame in enumerate(frames):
        if (known := frame.known()) is None:
            continue
        if marks is None:
            marks = disk.zeros((len(frames), height, width))
            marks[:] = np.nan
        half = np.pad(known, ((0, 2 * height - len(known)), (0, 2 * width - known.shape[1])), mode="edge")
        is_whole = half.reshape(height, 2, width, 2).all(axis=(1, 3))
        marks[v][~is_whole] = 0 if frame.is_on_background else -1
    return marks


@dataclass(frozen=True, eq=False)
class _Beside:
    """A photo beside its sources.

    Attributes:
        views: its index, then theirs (S).
        A, b: (S, 3, 3) and (S, 3) float64: its pixel p = (x, y, 1) of inverse depth w lies in a source at A·p + w·b.
    """

    views: list[int]
    A: NDArray
    b: NDArray

    @classmethod
    def of(cls, v: int, sources: Sequence[int], photos: Photos) -> _Beside:
        """Photo `v`."""
        cameras, Ks = photos.cameras, photos.Ks
        A, b = np.zeros((len(sources), 3, 3)), np.zeros((len(sources), 3))
        inverse = np.linalg.inv(Ks[v])
        for s, u in enumerate(sources):
            turn = Ks[u] @ cameras[u].rotation
            A[s] = turn @ cameras[v].rotation.T @ inverse
            b[s] = turn @ (cameras[v].centre - cameras[u].centre)
        return cls([v, *sources], A, b)

    def candidates(self, found: NDArray) -> NDArray:
        """(C, h, w) inverse depths that the maps of the nearest sources, of all photos' (V, h, w), put there."""
        out = np.zeros((min(FORWARD, len(self.b)), *found.shape[1:]), np.float32)
        for own, u, A, b in zip(out, self.views[1:], self.A, self.b, strict=False):
            put(found[u], np.linalg.inv(A), b, own)
        return out

    def search(
        self, colours: NDArray, found: NDArray, first: NDArray, planes: NDArray, candidates: NDArray, low: float,
        high: float,
    ) -> NDArray:  # fmt: skip
        """`kernels_joint.search` of the photo, whose planes are changed, among all photos' colours and maps; what each
        pixel's plane costs, (h, w).
        """
        pixels = colours[self.views].reshape(len(self.views), first.size, 3)
        spent = np.zeros(first.shape, np.float32)
        photos = Compared(
            pixels.mean(axis=2),
            pixels.reshape(len(pixels), -1),
            found[self.views].reshape(len(pixels), -1),
            self.A.astype(np.float32),
            self.b.astype(np.float32),
        )
        search(photos, planes, first, candidates, np.float32(low), np.float32(high), spent)
        return spent


def _sloped(inverse: NDArray) -> NDArray:
    """(3, h, w) planes of inverse depths (h, w): slopes are differences to the right and below, smoothed."""
    planes = np.empty((3, *inverse.shape), np.float32)
    planes[0] = inverse
    for axis, out in ((1, planes[1]), (0, planes[2])):
        medians(np.diff(inverse, axis=axis, append=inverse.take([-1], axis)), FLATTEN, out)
    return planes
