"""Words of requests: kinds of options that are this program's own, beside those of `system.kinds`, and their values.

Raises:
    InputError: of what stands for none; says what is expected.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING

from ..errors import InputError, within
from ..system.kinds import count, indices, items, numbers, positive, refused, size, whole

if TYPE_CHECKING:
    from ..list.pruning.amount import Amount

_METRES = {"mm": 0.001, "cm": 0.01, "m": 1.0, "km": 1000.0, "in": 0.0254, "ft": 0.3048}

_AXES = "x", "y", "z"

ALL, FULL = "all", "full"
"""Every view, however many there are; and every pixel."""

AUTO, NO = "auto", "no"
"""Of views, those that the scene needs; of masks, none."""


@dataclass(frozen=True)
class AutoViews:
    """Views that are chosen: up to six by what they see, more as far from each other as there are.

    Attributes:
        count: how many; None for those that the capture needs.
    """

    count: int | None = None

    def __post_init__(self) -> None:
        if self.count is not None and whole(self.count) < 2:
            raise InputError(f"{self.count}, expected 2 or more", where="views")


@dataclass(frozen=True)
class Training:
    """For how many steps, or for how many seconds, a list is trained; with neither, for as many steps as are usual for
    so many photos.
    """

    steps: int | None = None
    seconds: float | None = None

    def __post_init__(self) -> None:
        for value, kind in ((self.steps, count), (self.seconds, positive)):
            if value is not None:
                with within("train"):
                    kind(value)
        if self.steps is not None and self.seconds is not None:
            raise InputError("expected steps or seconds, and one of them", where="train")

    def __str__(self) -> str:
        return AUTO if self == Training() else f"{self.seconds:g}s" if self.steps is None else str(self.steps)


@dataclass(frozen=True)
class Length:
    """A length that was measured.

    Attributes:
        metres: how long it is.
        ends: two pixels (u, v) of a view, or two points (x, y, z) of the world, scene units.
        view: of the pixels; None for points.
    """

    metres: float
    ends: tuple[tuple[float, ...], tuple[float, ...]]
    view: int | None = None


def views(given: object) -> tuple[int, ...] | AutoViews | str:
    """Indices; `auto` or `auto:3`, how many views to choose; `all`, itself."""
    if isinstance(given, AutoViews):
        return given
    word, _, number = given.partition(":") if isinstance(given, str) else ("", "", "")
    if word == ALL and not number:
        return ALL
    if word != AUTO:
        return indices(given)
    if number and not (number.isdecimal() and int(number) >= 2):
        raise refused(given, "auto or auto:N with N of 2 or more")
    return AutoViews(int(number)) if number else AutoViews()


def size_or_full(given: object) -> tuple[int, int] | str:
    """A size, or the word `full`."""
    return FULL if isinstance(given, str) and given == FULL else size(given)


def training(given: object) -> Training:
    """`800` or 800 to steps, `60s` to seconds."""
    if isinstance(given, Training):
        return given
    with contextlib.suppress(InputError):
        if isinstance(given, str) and given.endswith("s"):
            return Training(seconds=positive(given[:-1]))
        return Training(steps=count(given))
    raise refused(given, "steps such as 800 or seconds such as 60s")


def turn(given: object) -> tuple[float, float, float, float]:
    """`x,90`, an axis and degrees, or a quaternion `w,x,y,z`, to a quaternion, which is not normalised."""
    parts = given.split(",") if isinstance(given, str) else given
    try:
        axis, *rest = items(parts)
        if axis in _AXES:
            (degrees,) = numbers(1)(rest)
            half = math.radians(degrees) / 2
            w, x, y, z = math.cos(half), *(math.sin(half) * (name == axis) for name in _AXES)
        else:
            w, x, y, z = numbers(4)(parts)
    except (InputError, ValueError):
        w = x = y = z = 0.0
    if not any((w, x, y, z)):
        raise refused(given, "AXIS,DEGREES such as x,90 or a quaternion w,x,y,z")
    return w, x, y, z


def length(given: object) -> Length:
    """`2:417,318,1204,322=0.74m`, two pixels of view 2 and their distance, or `X,Y,Z,X,Y,Z=74cm`, two points."""
    if isinstance(given, Length):
        return given
    place, _, size = given.partition("=") if isinstance(given, str) else ("", "", "")
    view, colon, ends = place.rpartition(":")
    amount = size.strip().rstrip("".join(_METRES))
    with contextlib.suppress(InputError, KeyError):
        metres = positive(amount) * _METRES[size.strip()[len(amount) :].strip()]
        values = numbers(4 if colon else 6)(ends)
        half = len(values) // 2
        return Length(metres, (values[:half], values[half:]), whole(view) if colon else None)
    raise refused(given, f"VIEW:U,V,U,V=0.74m or X,Y,Z,X,Y,Z=0.74m, in {', '.join(_METRES)}")


def amount(given: object) -> Amount:
    """`0.5` or 0.5, a share; `45dB`, a quality; `200000` or 200000, how many."""
    from ..list.pruning.amount import Amount

    if isinstance(given, Amount):
        return given
    if not isinstance(given, str | Real) or isinstance(given, bool):
        raise refused(given, "a share such as 0.5, a quality such as 45dB, or a number")
    return Amount.of(str(given))
