"""Which frames of a video make a scene: apart by as much as the camera moved, and the sharpest of their surroundings.

A walk's pace varies and hands shake. Movement is measured against a frame shortly before by phase correlation of tiles
(Kuglin and Hines 1975), and added up; the video is cut into stretches of equal movement, and each gives its frame of
most fine detail. Standing still gives no frames, however long it takes. Where tiles of a frame are not found again in
the next one, as in clips of few frames a second, it may have moved by any amount: both are wanted.
"""

import math
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.footage import Video
from tinysplat_runtime.system.told import NOBODY, Told

STEP = 0.06
"""Of the picture's width, moved between one chosen frame and the next: neighbours share nearly all that they show."""

LOST = 2 * STEP
"""What a frame is taken to have moved by whose tiles are not found again."""

FOUND = 0.2
"""Peak of the phase correlation of a tile that is found again; of tiles that have nothing in common it is 0.13."""

MOST, FEWEST = 64, 16
"""Frames that are chosen where nobody says how many."""

MOST_WITH_MORE = 128
"""Frames that there are at most, once some between those that could not be placed were added."""

LOOK_WIDTH = 192
"""Pixels across in which movement and detail are measured."""

_TILE = 32
_ANEW = 4  # pixels moved after which a frame is what the next ones are held against: slow movement adds up, noise not
_ADDED = 3  # frames that are added at once between two


@dataclass(frozen=True, eq=False)
class Walk:
    """A video that was looked through.

    Attributes:
        indices: (F,) of frames that can be decoded, rising.
        moved: (F,) float64 movement up to each frame in picture widths, rising from 0.
        detail: (F,) float64 fine detail of each.
    """

    indices: Sequence[int]
    moved: NDArray
    detail: NDArray

    def chosen(self, count: int | None = None) -> list[int]:
        """Indices of frames, rising: so many, or as many as the movement asks for, within `FEWEST` and `MOST`.

        Of a video of no more than `MOST` frames all are taken in which something moved: they are soon placed.
        """
        if count is None:
            differing = [0, *(np.flatnonzero(np.diff(self.moved)) + 1)]
            if len(self.moved) <= MOST and len(differing) >= min(FEWEST, len(self.moved)):
                return [self.indices[i] for i in differing]
            count = int(np.clip(math.ceil(self.moved[-1] / STEP) + 1, FEWEST, MOST))
        return [self.indices[i] for i in stretches(self.moved, self.detail, min(count, len(self.moved)))]

    def between(self, chosen: Sequence[int], missing: Set[int], most: int = MOST_WITH_MORE) -> list[int]:
        """Further frames beside those of the chosen that are missing, so that there are `most` at the most; rising."""
        places = [int(np.searchsorted(self.indices, index)) for index in chosen]
        gaps = [
            (i, j)
            for i, j in pairwise(places)
            if j - i > 1 and not missing.isdisjoint((self.indices[i], self.indices[j]))
        ]
        gaps.sort(key=lambda gap: self.moved[gap[0]] - self.moved[gap[1]])  # widest first
        room = most - len(chosen)
        added: list[int] = []
        for n, (i, j) in enumerate(gaps):
            count = min(_ADDED, j - i - 1, -(-(room - len(added)) // (len(gaps) - n)))
            inside = slice(i + 1, j)
            if count > 0:
                added += [i + 1 + k for k in stretches(self.moved[inside] - self.moved[i], self.detail[inside], count)]
        return sorted(self.indices[i] for i in added)


def look_through(video: Video, told: Told = NOBODY) -> Walk:
    """Measure a video's movement and detail, in one pass.

    Raises:
        InputError: there are fewer than two frames, or they cannot be decoded.
    """
    total = len(video.stamps)
    indices: list[int] = []

    def luma() -> Iterator[NDArray]:
        for index, thumbnail in told.progress("looking at frames", video.thumbnails(LOOK_WIDTH), total=total):
            indices.append(index)
            yield thumbnail

    walk = Walk(indices, *measured(luma()))
    if len(indices) < 2:
        raise InputError(f"{len(indices)} frames, expected 2 or more", where=str(video.path))
    return walk


def measured(thumbnails: Iterable[NDArray]) -> tuple[NDArray, NDArray]:
    """(F,) movement up to each frame in picture widths, rising from 0, and (F,) fine detail.

    Args:
        thumbnails: (h, w) uint8 of luma, of one size.
    """
    moved: list[float] = []
    detail: list[float] = []
    reached, since = 0.0, None
    for thumbnail in thumbnails:
        picture = thumbnail.astype(np.float32)
        detail.append(_detail(picture))
        tiles = _tiles(picture)
        since = tiles if since is None else since
        pixels = _shift(since, tiles)
        step = LOST if pixels is None else pixels / picture.shape[1]
        moved.append(max(reached + step, moved[-1] if moved else 0.0))
        if pixels is None or pixels >= _ANEW:
            reached, since = moved[-1], tiles
    return np.array(moved), np.array(detail)


def stretches(moved: NDArray, detail: NDArray, count: int) -> list[int]:
    """The frame of most detail in each of `count` stretches of equal movement, or of equal time where nothing moves.

    Args:
        moved: (F,) float64 movement up to each frame, rising from 0.
        detail: (F,) float64 fine detail of each.
        count: stretches, at most F.
    """
    frames = len(moved)
    along = moved / moved[-1] if moved[-1] > 0 else np.linspace(0, 1, frames)
    along = along + 1e-6 * np.arange(frames) / frames  # frames at rest have an order, too
    edges = np.searchsorted(along, np.linspace(0, along[-1], count + 1)[1:-1])
    chosen: list[int] = []
    for n, (start, stop) in enumerate(zip((0, *edges), (*edges, frames), strict=True)):
        first = max(int(start), chosen[-1] + 1 if chosen else 0)
        last = min(max(int(stop), first + 1), frames - (count - 1 - n))
        first = min(first, last - 1)
        chosen.append(first + int(np.argmax(detail[first:last])))
    return chosen


def _detail(picture: NDArray) -> float:
    """Mean square of the picture's Laplacian, which blur takes first, over its variance."""
    inner = picture[1:-1, 1:-1]
    laplacian = 4 * inner - picture[:-2, 1:-1] - picture[2:, 1:-1] - picture[1:-1, :-2] - picture[1:-1, 2:]
    return float((laplacian**2).mean() / (picture.var() + 1))


def _tiles(picture: NDArray) -> tuple[NDArray, NDArray]:
    """(T, _TILE, _TILE/2 + 1) Fourier transforms of the picture's tiles, windowed, and (T,) their contrast."""
    rows, columns = (max(side // _TILE, 1) * _TILE for side in picture.shape)
    padded = np.pad(
        picture, [(0, max(side - n, 0)) for side, n in zip((rows, columns), picture.shape, strict=True)], mode="edge"
    )[:rows, :columns]
    tiles = padded.reshape(rows // _TILE, _TILE, columns // _TILE, _TILE).swapaxes(1, 2).reshape(-1, _TILE, _TILE)
    window = np.hanning(_TILE + 2)[1:-1]
    flat = (tiles - tiles.mean(axis=(1, 2), keepdims=True)) * window * window[:, None]
    return np.fft.rfft2(flat), np.square(flat).mean(axis=(1, 2))


def _shift(before: tuple[NDArray, NDArray], after: tuple[NDArray, NDArray]) -> float | None:
    """How far tiles moved, pixels, all but a quarter of them; None where those of most contrast are not found again.

    Of a camera that keeps what it walks around in the middle, most of the picture hardly moves.
    """
    cross = before[0] * after[0].conj()
    peaks = np.fft.irfft2(cross / np.maximum(np.abs(cross), 1e-6), s=(_TILE, _TILE)).reshape(len(cross), -1)
    told = before[1] >= np.median(before[1])
    if np.median(peaks.max(axis=1)[told]) < FOUND:
        return None
    offsets = np.stack(np.unravel_index(peaks[told].argmax(axis=1), (_TILE, _TILE)), axis=-1)  # (T, 2), wrapped
    offsets = np.where(offsets > _TILE // 2, offsets - _TILE, offsets)
    return float(np.quantile(np.hypot(offsets[:, 0], offsets[:, 1]), 0.75))
