"""Kinds of options: each function takes what was given, a word as people write it or a value, and returns the value.

Raises:
    InputError: of what stands for none; says what is expected.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Collection, Mapping, Sequence, Set
from dataclasses import dataclass
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

from ..errors import InputError, within
from ..system.files import StrPath
from ..system.printable import type_of

if TYPE_CHECKING:
    from ..list.pruning.amount import Amount
    from ..scene.cameras import Camera

_BYTES = {"": 1, "b": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9, "kib": 1 << 10, "mib": 1 << 20, "gib": 1 << 30}

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


def shown(value: object) -> str:
    """A value in a message: text in quotes, what JSON has as it is, of all else the type."""
    if not isinstance(value, str | int | float | list | tuple | dict | None):
        return type_of(value)
    text = f"'{value}'" if isinstance(value, str) else str(value)
    return text if len(text) <= 48 else f"{text[:45]}..."


def _refused(given: object, expected: str) -> InputError:
    return InputError(f"{shown(given)}, expected {expected}")


def flag(given: object) -> bool:
    """Whether."""
    if not isinstance(given, bool):
        raise _refused(given, "true or false")
    return given


def text(given: object) -> str:
    """Any text."""
    if not isinstance(given, str):
        raise _refused(given, "text")
    return given


def path(given: object) -> StrPath:
    """A file or folder."""
    if not isinstance(given, str | os.PathLike):
        raise _refused(given, "a path")
    return given


def written(given: object) -> StrPath:
    """A file to write."""
    return path(given)


def file(given: object) -> bytes | StrPath:
    """A file by its path, or its bytes."""
    if not isinstance(given, str | bytes | os.PathLike):
        raise _refused(given, "bytes or a path")
    return given


def cameras(given: object) -> Sequence[Camera] | StrPath:
    """Cameras, or the path of what `load_cameras` reads."""
    if isinstance(given, str | os.PathLike):
        return given
    if not isinstance(given, Sequence) or isinstance(given, bytes):
        raise _refused(given, "a list of cameras or the path of a scene")
    return tuple(given)


def whole(given: object) -> int:
    """A whole number."""
    is_word = isinstance(given, str) and given.strip().removeprefix("-").isdecimal() and len(given) < 20
    if not is_word and (not isinstance(given, Integral) or isinstance(given, bool)):
        raise _refused(given, "a whole number")
    return int(given)  # type: ignore[call-overload]


def count(given: object) -> int:
    """A whole number of 1 or more."""
    if whole(given) < 1:
        raise _refused(given, "1 or more")
    return whole(given)


def number(given: object) -> float:
    """A finite number."""
    try:
        value = float(given) if isinstance(given, Real | str) and not isinstance(given, bool) else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _refused(given, "a number")
    return value


def positive(given: object) -> float:
    """A finite number above 0."""
    if number(given) <= 0:
        raise _refused(given, "a number above 0")
    return number(given)


def ratio(given: object) -> float:
    """How many times as large."""
    if not 1e-9 <= number(given) <= 1e9:
        raise _refused(given, "a number of 1e-9 to 1e9")
    return number(given)


def numbers(length: int) -> Callable[[object], tuple[float, ...]]:
    """Reads so many finite numbers, in words with commas between them."""

    def kind(given: object) -> tuple[float, ...]:
        parts = given.split(",") if isinstance(given, str) else given
        try:
            values = tuple(map(number, _listed(parts)))
        except InputError:
            values = ()
        if len(values) != length:
            raise _refused(given, f"{length} numbers")
        return values

    return kind


def turn(given: object) -> tuple[float, float, float, float]:
    """`x,90`, an axis and degrees, or a quaternion `w,x,y,z`, to a quaternion, which is not normalised."""
    parts = given.split(",") if isinstance(given, str) else given
    try:
        axis, *rest = _listed(parts)
        if axis in _AXES:
            (degrees,) = numbers(1)(rest)
            half = math.radians(degrees) / 2
            w, x, y, z = math.cos(half), *(math.sin(half) * (name == axis) for name in _AXES)
        else:
            w, x, y, z = numbers(4)(parts)
    except (InputError, ValueError):
        w = x = y = z = 0.0
    if not any((w, x, y, z)):
        raise _refused(given, "AXIS,DEGREES such as x,90 or a quaternion w,x,y,z")
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
    raise _refused(given, f"VIEW:U,V,U,V=0.74m or X,Y,Z,X,Y,Z=0.74m, in {', '.join(_METRES)}")


def indices(given: object) -> tuple[int, ...]:
    """`0,4` to (0, 4), and ranges with their ends: `0-8:4,20` to (0, 4, 8, 20)."""
    if isinstance(given, str):
        return tuple(index for part in given.split(",") for index in _range(part, given))
    try:
        return tuple(map(whole, _listed(given)))
    except InputError:
        raise _refused(given, "a list of whole numbers") from None


def _listed(given: object) -> Collection[Any]:
    """What has items in order, such as a list or an array."""
    if not isinstance(given, Collection) or isinstance(given, str | bytes | Mapping | Set):
        raise _refused(given, "a list")
    return given


def _range(part: str, text: str) -> range:
    span, colon, step = part.strip().partition(":")
    first, dash, last = span.partition("-")
    numbers = [first, *([last] if dash else []), *([step] if colon else [])]
    is_range = all(number.isdecimal() and len(number) < 8 for number in numbers) and (dash or not colon)
    if not is_range or (colon and not int(step)) or (dash and int(last) < int(first)):
        raise _refused(text, "indices such as 0,4 or ranges such as 0-40:2")
    return range(int(first), int(last if dash else first) + 1, int(step) if colon else 1)


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
        raise _refused(given, "auto or auto:N with N of 2 or more")
    return AutoViews(int(number)) if number else AutoViews()


def size(given: object) -> tuple[int, int]:
    """`384x256`, the width first, or (256, 384), to (height, width)."""
    if isinstance(given, str):
        parts = given.lower().split("x")
        if len(parts) != 2 or not all(part.isdecimal() and int(part) > 0 for part in parts):
            raise _refused(given, "WIDTHxHEIGHT such as 384x256")
        return int(parts[1]), int(parts[0])
    sides = indices(given)
    if len(sides) != 2 or min(sides) < 1:
        raise _refused(given, "a height and a width of 1 or more")
    return sides[0], sides[1]


def size_or_full(given: object) -> tuple[int, int] | str:
    """A size, or the word `full`."""
    return FULL if isinstance(given, str) and given == FULL else size(given)


def grid(given: object) -> tuple[int, int, int]:
    """`2,256,384` or (2, 256, 384): views, height and width."""
    sides = indices(given)
    if len(sides) != 3 or min(sides) < 1:
        raise _refused(given, "V,H,W of 1 or more")
    return sides[0], sides[1], sides[2]


def bits(given: object) -> tuple[int, int]:
    """`5,4` or (5, 4): bits of SH coefficients of degree 1, and of those above."""
    both = indices(given)
    if len(both) != 2:
        raise _refused(given, "two numbers of 1 to 8")
    return both[0], both[1]


def colour(given: object) -> tuple[float, float, float]:
    """`white`, `black`, `#rrggbb` or three numbers of 0 to 1 to these numbers."""
    named = {"white": "#ffffff", "black": "#000000"}.get(given, given) if isinstance(given, str) else given
    with contextlib.suppress(ValueError, TypeError):
        if isinstance(named, str):
            levels = [level / 255 for level in bytes.fromhex(named.removeprefix("#"))]
        else:
            levels = [float(level) for level in named]  # type: ignore[attr-defined]
        if len(levels) == 3 and all(0 <= level <= 1 for level in levels):
            return levels[0], levels[1], levels[2]
    raise _refused(given, "white, black or #rrggbb")


def byte_count(given: object) -> int:
    """`100KB`, `1.5 MiB` or `4096` to bytes; KB is 1000."""
    if not isinstance(given, str):
        return count(given)
    number = given.rstrip("BbKkMmGgIi ")
    unit = given[len(number) :].strip().lower()
    try:
        value = float(number) * _BYTES[unit]
    except (KeyError, ValueError):
        value = 0.0
    if not 1 <= value < 1 << 40:
        raise _refused(given, "a size such as 100KB, 1.5MB or 4096")
    return int(value)


def decibels(given: object) -> float:
    """A PSNR to reach."""
    if not 0 < number(given) < 120:
        raise _refused(given, "more than 0 and less than 120 dB")
    return number(given)


def training(given: object) -> Training:
    """`800` or 800 to steps, `60s` to seconds."""
    if isinstance(given, Training):
        return given
    with contextlib.suppress(InputError):
        if isinstance(given, str) and given.endswith("s"):
            return Training(seconds=positive(given[:-1]))
        return Training(steps=count(given))
    raise _refused(given, "steps such as 800 or seconds such as 60s")


def amount(given: object) -> Amount:
    """`0.5` or 0.5, a share; `45dB`, a quality; `200000` or 200000, how many."""
    from ..list.pruning.amount import Amount

    if isinstance(given, Amount):
        return given
    if not isinstance(given, str | Real) or isinstance(given, bool):
        raise _refused(given, "a share such as 0.5, a quality such as 45dB, or a number")
    return Amount.of(str(given))
