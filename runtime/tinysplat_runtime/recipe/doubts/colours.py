"""How photos show the corners that they have in common: brightness and order of colours."""

from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from .seen import CHANCE, Seen

DARKER = 0.4
"""Of other photos' brightness, at the same corners."""

_NAMES = ("red", "green", "blue")


def colour_doubts(seen: Seen) -> list[str]:
    """A photo much darker or brighter than others, or of exchanged colours."""
    if len(seen.closer) < 3:
        return []
    samples = {pair: _samples(seen, pair) for pair, places in seen.places.items() if len(places) >= CHANCE}
    for v in seen.closer:
        own = [(one, other) if pair[0] == v else (other, one) for pair, (one, other) in samples.items() if v in pair]
        rest = [pair for pair in samples.items() if v not in pair[0]]
        if len(own) < 2 or not rest:
            continue
        levels = sorted((_level(*pair) for pair in own), key=lambda level: abs(np.log(level)))
        level = levels[(len(levels) - 1) // 2]  # of two the nearer to 1: one pair alone may be the other photo's fault
        usual = float(np.median([abs(np.log(_level(*pair))) for _, pair in rest]))
        if abs(np.log(level)) > -np.log(DARKER) and usual < -np.log(DARKER) / 2:
            word = "darker" if level < 1 else "brighter"
            return [f"{seen.names[v]} is much {word} than the others where they show the same ({level:.2g} times)"]
        if (order := _order(own)) and not _order([pair for _, pair in rest]):
            return [f"{seen.names[v]} has its colours exchanged: its {_said(order)}, where others show the same"]
    return []


def _samples(seen: Seen, pair: tuple[int, int]) -> tuple[NDArray, NDArray]:
    """(M, 3) colours of two photos at the corners that they have in common."""
    v, u = pair
    matches = seen.places[pair]
    colours = []
    for view, places in ((v, matches[:, :2]), (u, matches[:, 3:5])):
        image, camera = seen.images[view], seen.closer[view]
        height, width = image.shape[:2]
        column, row = (places * (width / camera.width, height / camera.height)).astype(int).T
        colours.append(image[row.clip(0, height - 1), column.clip(0, width - 1)].astype(np.float64))
    return colours[0], colours[1]


def _level(one: NDArray, other: NDArray) -> float:
    """How bright corners are in one photo, of what they are in another."""
    return float(np.median((one.mean(axis=1) + 1e-3) / (other.mean(axis=1) + 1e-3)))


def _order(pairs: list[tuple[NDArray, NDArray]]) -> tuple[int, ...]:
    """The order of a photo's channels in which its corners are of others' colours; nothing where it is its own."""
    one, other = (np.concatenate([pair[n] for pair in pairs]) for n in (0, 1))
    one, other = (colours / colours.mean(axis=1, keepdims=True).clip(1e-3) for colours in (one, other))
    off = {order: float(np.median(np.abs(one[:, order] - other).mean(axis=1))) for order in permutations(range(3))}
    best = min(off, key=lambda order: off[order])
    return best if 2 * off[best] < off[0, 1, 2] else ()


def _said(order: tuple[int, ...]) -> str:
    moved = [f"{_NAMES[n]} is {_NAMES[channel]}" for n, channel in enumerate(order) if n != channel]
    return ", ".join(moved)
