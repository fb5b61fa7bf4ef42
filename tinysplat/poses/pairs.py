"""Which of many photos are compared: those taken shortly after one another, and those that look alike.

How many of their largest features two photos share says in half a millisecond what a comparison says in thirty. A walk
that comes back to where it was closes only by pairs that no order gives, and without them halves of a scene hang
together by one pair and lie apart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.scene.lenses import load_pycolmap
from tinysplat_runtime.system.told import NOBODY, Told

if TYPE_CHECKING:
    from pycolmap import Database

ALIKE, MORE_ALIKE = 10, 20
"""Of the photos that share most features, how many one is compared with, at first and again."""

_LARGEST = 256  # features of a photo, that are looked at for that
_OVERLAP = 6  # photos before each that it is compared with
_FEW_PLACES = 12  # of a rig's, each compared with each
_DISTINCT = 0.8  # of the distance to the second nearest feature is a match's at most


def shared_features(names: Sequence[str], database: Path, told: Told = NOBODY) -> NDArray:
    """(N, N) int64, of how many of their largest features two photos have each other's as their nearest by far."""
    with load_pycolmap().Database.open(database) as opened:
        numbers = [opened.read_image_with_name(name).image_id for name in names]
        largest = [_largest_features(opened, number) for number in numbers]
    shared = np.zeros((len(names), len(names)), np.int64)
    for j in told.progress("choosing pairs of photos", range(len(names)), costs=range(len(names))):
        for i in range(j):
            alike = largest[i] @ largest[j].T
            if min(alike.shape) > 1:
                nearest = alike.argmax(axis=1)
                second, first = np.partition(alike, -2, axis=1)[:, -2:].T
                is_distinct = 1 - first < _DISTINCT**2 * (1 - second)
                is_mutual = alike.argmax(axis=0)[nearest] == np.arange(len(nearest))
                shared[i, j] = shared[j, i] = np.count_nonzero(is_distinct & is_mutual)
    return shared


def _largest_features(database: Database, image: int) -> NDArray:
    """(n, 128) float32 unit vectors of a photo's features."""
    keypoints, descriptors = np.asarray(database.read_keypoints(image)), database.read_descriptors(image)
    sizes = np.hypot(keypoints[:, 2], keypoints[:, 4])  # the axes of an affine frame
    chosen = np.argsort(-sizes, kind="stable")[:_LARGEST]
    vectors = np.asarray(getattr(descriptors, "data", descriptors)).astype(np.float32)[chosen]  # an array before 4
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True).clip(1e-6)


def pairs_of_many(shared: NDArray, alike: int) -> list[tuple[int, int]]:
    """Pairs of photos, lower index first, that may show the same: near in order, or among the so many that share most
    features; `shared` is (N, N), see `shared_features`.
    """
    count = len(shared)
    pairs = {(i, j) for j in range(count) for i in range(max(j - _OVERLAP, 0), j)}
    for i, row in enumerate(shared):
        best = np.argsort(-row, kind="stable")[:alike].tolist()
        pairs |= {(min(i, j), max(i, j)) for j in best if row[j]}
    return sorted(pairs)


def pairs_of_rig(names: Sequence[str], rig: Mapping[str, NDArray]) -> list[tuple[int, int]]:
    """Pairs of photos, lower index first, of places near in order: by the same camera, or level ones side by side."""
    number = {name: i for i, name in enumerate(names)}
    taken = [*dict.fromkeys(name.partition("/")[2] for name in names)]
    steps = {*range(1, len(taken) if len(taken) <= _FEW_PLACES else _OVERLAP + 1), *(1 << n for n in range(1, 7))}
    level = [name for name in rig if abs(rig[name][2][1]) < 0.5]
    beside = [(one, other) for one in level for other in level if abs(rig[one][2] @ rig[other][2]) < 0.5]
    beside += [(name, name) for name in rig]
    apart = [(i, i + step) for i in range(len(taken)) for step in sorted(steps) if i + step < len(taken)]
    named = ((f"{one}/{taken[i]}", f"{other}/{taken[j]}") for i, j in apart for one, other in beside)
    pairs = {(number[one], number[other]) for one, other in named if one in number and other in number}
    return sorted((min(pair), max(pair)) for pair in pairs)
