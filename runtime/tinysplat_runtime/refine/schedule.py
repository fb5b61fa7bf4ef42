"""When refinement does what: at which size a step is taken, and how its photos are drawn."""

from __future__ import annotations

import math
from dataclasses import dataclass

HALVED_FROM = 96 * 96
"""Pixels of a view from which steps are taken at half of the size first."""

SHARE_BELOW = 2 / 3
"""Most of all steps that are taken at it."""

GOLDEN = (math.sqrt(5) - 1) / 2
"""Strides of this share of a circle leave no large gap anywhere, however many there are."""


@dataclass(frozen=True)
class Turn:
    """How a step draws its photos.

    Attributes:
        size: which of the sizes that there are of a photo.
        place: from which of the places between a photo's and its neighbours' it is drawn as if, by number, which goes
            round; None where it is drawn in the other way that there is (`settings.Settings.leaves_own_out`).
    """

    size: int
    place: int | None


def turn(step: int, sizes: int) -> Turn:
    """The turn of a step, counted from 0: one size after the other, then by turns as if from between and the other
    way.

    From its own place a photo's own surfaces would hide what is wrong with all others.
    """
    place, is_other = divmod(step // sizes, 2)
    return Turn(step % sizes, None if is_other else place)


def order(step: int, photos: int) -> list[int]:
    """In which order a step takes photos: each once, those next to each other in the list far apart, and another one
    first in the next step.
    """
    stride = max(round(GOLDEN * photos), 1)
    while math.gcd(stride, photos) > 1:
        stride += 1
    return [(step + stride * turn) % photos for turn in range(photos)]


def steps_below(pixels: int, most: int, limit: int) -> int:
    """Steps to take at half of the size before those at full size.

    Args:
        pixels: of a view.
        most: how many at most.
        limit: most steps of both sizes together.
    """
    return min(most, int(SHARE_BELOW * limit)) if pixels >= HALVED_FROM else 0


def held_back(photos: int, one_of: int) -> list[int]:
    """Which photos judge and do not correct: one of so many, two at least, spread over all but the first and last; 0
    for none.
    """
    count = max(round(photos / one_of), 2) if one_of else 0
    return [round((photos - 1) * (number + 1) / (count + 1)) for number in range(count)]
