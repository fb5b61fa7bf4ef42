"""Few values in place of many: codebooks of numbers, and palettes of vectors."""

import numpy as np
from numpy.typing import NDArray

_LLOYD_ROUNDS = 30
_POWER_ROUNDS = 4
_TELLING = 32  # members of a group that tell its largest spread


def codebook(values: NDArray, size: int = 256) -> NDArray:
    """(size,) ascending float64 values that stand for (N,) with least mean squared error, by Lloyd's rounds.

    They begin where values are, ever denser with the cube root of their density (Panter and Dite 1951).
    """
    ordered = np.sort(values.astype(np.float64))
    total = np.concatenate([[0.0], np.cumsum(ordered)])
    distinct = np.unique(ordered)
    if len(distinct) <= size:
        return np.concatenate([distinct, np.full(size - len(distinct), distinct[-1])])
    counts, edges = np.histogram(ordered, bins=4 * size)
    mass = np.concatenate([[0.0], np.cumsum(np.cbrt(counts))])
    levels = np.interp((np.arange(size) + 0.5) / size * mass[-1], mass, edges)
    for _ in range(_LLOYD_ROUNDS):
        ends = np.searchsorted(ordered, (levels[1:] + levels[:-1]) / 2)
        bounds = np.concatenate([[0], ends, [len(ordered)]])
        members = np.diff(bounds)
        levels = np.where(members > 0, np.diff(total[bounds]) / np.maximum(members, 1), levels)
    return levels


def nearest(values: NDArray, levels: NDArray) -> NDArray:
    """Index (uint8, the shape of `values`) of the nearest of ascending `levels` (L,), L at most 256."""
    return np.searchsorted((levels[1:] + levels[:-1]) / 2, values).astype(np.uint8)


def palette(vectors: NDArray, size: int) -> tuple[NDArray, NDArray]:
    """At most `size` vectors (P, D) float32 that stand for (N, D), and the index (N,) int64 of each one's.

    A tree: every round splits the groups with the largest squared error at their mean, across the direction of their
    largest spread, so that time grows with N·D·log(size). Deterministic; k-means at these sizes takes minutes.
    """
    vectors = vectors.astype(np.float32)
    label = np.zeros(len(vectors), np.int64)
    groups = 1
    while groups < size:
        mean, error = _spread(vectors, label, groups)
        splittable = np.flatnonzero(error > 1e-12)
        if not len(splittable):
            break
        # half of what may still be added, so that the last rounds go to the worst groups
        room = min(size - groups, max(groups, 1), len(splittable))
        chosen = splittable[np.argsort(-error[splittable], kind="stable")[:room]]
        slot = np.full(groups, -1)
        slot[chosen] = np.arange(len(chosen))
        rows = np.flatnonzero(slot[label] >= 0)
        part = slot[label[rows]]
        centred = vectors[rows] - mean[chosen][part]
        few = slice(None, None, max(len(rows) // (_TELLING * len(chosen)), 1))
        above = (centred * _directions(centred[few], part[few], len(chosen))[part]).sum(axis=1) > 0
        label[rows[above]] = groups + part[above]
        groups += len(chosen)
    used, label = np.unique(label, return_inverse=True)
    return _spread(vectors, label, len(used))[0], label


def _spread(vectors: NDArray, label: NDArray, groups: int) -> tuple[NDArray, NDArray]:
    """Mean (G, D) float32 and sum of squared distances from it (G,) of each group."""
    count = np.maximum(np.bincount(label, minlength=groups), 1)
    mean = _sums(vectors, label, groups) / count[:, None]
    squares = np.bincount(label, ((vectors - mean[label]) ** 2).sum(axis=1), minlength=groups)
    return mean.astype(np.float32), squares


def _directions(centred: NDArray, part: NDArray, groups: int) -> NDArray:
    """(G, D) unit vectors along each group's largest spread, by a few rounds of power iteration."""
    axis = _sums(centred**2, part, groups).argmax(axis=1)
    direction = np.zeros((groups, centred.shape[1]), np.float32)
    direction[np.arange(groups), axis] = 1
    for _ in range(_POWER_ROUNDS):
        along = (centred * direction[part]).sum(axis=1)
        direction = _sums(centred * along[:, None], part, groups).astype(np.float32)
        direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-30)
    return direction


def _sums(rows: NDArray, label: NDArray, groups: int) -> NDArray:
    """(G, D) float64 sums of the rows of each group."""
    order = np.argsort(label, kind="stable")
    starts = np.searchsorted(label[order], np.arange(groups))
    filled = np.flatnonzero(np.diff(np.append(starts, len(label))))
    sums = np.zeros((groups, rows.shape[1]))
    if len(filled):
        sums[filled] = np.add.reduceat(rows[order], starts[filled], axis=0)
    return sums
