"""Which frames of a video make a scene: apart by as much as the camera moved, and the sharpest of their surroundings.

A walk's pace varies and hands shake. Movement is measured against a frame shortly before by phase correlation of tiles
(Kuglin and Hines 1975), and added up; the video is cut into stretches of equal movement, and each gives its frame of
most fine detail. Standing still gives no frames, however long it takes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.footage import Video
from tinysplat_runtime.system.progress import progress

STEP = 0.06
"""Of the picture's width, moved between one chosen frame and the next: neighbours share nearly all that they show."""

MOST, FEWEST = 64, 8
"""Frames that are chosen where nobody says how many."""

LOOK_WIDTH = 192
"""Pixels across in which movement and detail are measured."""

_TILE = 32
_ANEW = 4  # pixels moved after which a frame is what the next ones are held against: slow movement adds up, noise not


def choose_frames(video: Video, count: int | None = None, *, quiet: bool = True) -> list[int]:
    """Indices of frames, rising.

    Args:
        video: the footage.
        count: how many, 2 or more; None for as many as its movement asks for, within `FEWEST` and `MOST`.
        quiet: whether to show no progress.

    Raises:
        InputError: there are fewer frames, or one cannot be decoded.
    """
    total = len(video.stamps)
    if total < max(count or 2, 2):
        raise InputError(f"{total} frames, expected {max(count or 2, 2)} or more", where=str(video.path))
    indices: list[int] = []

    def luma() -> Iterator[NDArray]:
        for index, thumbnail in progress(video.thumbnails(LOOK_WIDTH), total, "looking at frames", quiet=quiet):
            indices.append(index)
            yield thumbnail

    moved, detail = measured(luma())
    if count is None:
        count = int(np.clip(round(moved[-1] / STEP) + 1, FEWEST, MOST))
    return [indices[i] for i in stretches(moved, detail, min(count, len(moved)))]


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
        spectra = _spectra(picture)
        since = spectra if since is None else since
        step = _shift(since, spectra)
        moved.append(max(reached + step / picture.shape[1], moved[-1] if moved else 0.0))
        if step >= _ANEW:
            reached, since = moved[-1], spectra
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


def _spectra(picture: NDArray) -> NDArray:
    """(T, _TILE, _TILE/2 + 1) Fourier transforms of the picture's tiles, windowed."""
    rows, columns = (max(side // _TILE, 1) * _TILE for side in picture.shape)
    padded = np.pad(
        picture, [(0, max(side - n, 0)) for side, n in zip((rows, columns), picture.shape, strict=True)], mode="edge"
    )[:rows, :columns]
    tiles = padded.reshape(rows // _TILE, _TILE, columns // _TILE, _TILE).swapaxes(1, 2).reshape(-1, _TILE, _TILE)
    window = np.hanning(_TILE + 2)[1:-1]
    flat = tiles - tiles.mean(axis=(1, 2), keepdims=True)
    return np.fft.rfft2(flat * window * window[:, None])


def _shift(before: NDArray, after: NDArray) -> float:
    """The median over tiles of how far they moved, pixels."""
    cross = before * after.conj()
    peaks = np.fft.irfft2(cross / np.maximum(np.abs(cross), 1e-6), s=(_TILE, _TILE))
    best = peaks.reshape(len(peaks), -1).argmax(axis=1)
    offsets = np.stack(np.unravel_index(best, (_TILE, _TILE)), axis=-1)  # (T, 2), wrapped
    offsets = np.where(offsets > _TILE // 2, offsets - _TILE, offsets)
    return float(np.median(np.hypot(offsets[:, 0], offsets[:, 1])))
