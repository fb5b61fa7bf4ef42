"""Kinds of options: each function takes what was given, a word as people write it or a value, and returns the value.

Raises:
    InputError: of what stands for none; says what is expected.
"""

import contextlib
import math
import os
from collections.abc import Callable, Collection, Mapping, Sequence, Set
from numbers import Integral, Real
from typing import Any, TypeVar

from ..errors import InputError
from .files import StrPath
from .printable import type_of

Value = TypeVar("Value")

_BYTES = {"": 1, "b": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9, "kib": 1 << 10, "mib": 1 << 20, "gib": 1 << 30}


def shown(value: object) -> str:
    """A value in a message: text in quotes, what JSON has as it is, of all else the type."""
    if not isinstance(value, str | int | float | list | tuple | dict | None):
        return type_of(value)
    text = f"'{value}'" if isinstance(value, str) else str(value)
    return text if len(text) <= 48 else f"{text[:45]}..."


def refused(given: object, expected: str) -> InputError:
    """The error of what is no value of a kind."""
    return InputError(f"{shown(given)}, expected {expected}")


def of_type(expected: str, *types: type) -> Callable[[object], Any]:
    """The kind of what is of one of these types."""

    def kind(given: object) -> object:
        if not isinstance(given, types):
            raise refused(given, expected)
        return given

    return kind


def such(kind: Callable[[object], Value], holds: Callable[[Value], bool], expected: str) -> Callable[[object], Value]:
    """A kind of whose values only those are taken of which something holds."""

    def narrower(given: object) -> Value:
        value = kind(given)
        if not holds(value):
            raise refused(given, expected)
        return value

    return narrower


flag: Callable[[object], bool] = of_type("true or false", bool)

text: Callable[[object], str] = of_type("text", str)

path: Callable[[object], StrPath] = of_type("a path", str, os.PathLike)
"""A file or folder."""

written: Callable[[object], StrPath] = of_type("a path", str, os.PathLike)
"""A file to write."""

file: Callable[[object], bytes | StrPath] = of_type("bytes or a path", str, bytes, os.PathLike)
"""A file by its path, or its bytes."""


def cameras(given: object) -> Sequence[object] | StrPath:
    """Cameras, or the path of a scene or file that has some."""
    if isinstance(given, str | os.PathLike):
        return given
    if not isinstance(given, Sequence) or isinstance(given, bytes):
        raise refused(given, "a list of cameras or the path of a scene")
    return tuple(given)


def whole(given: object) -> int:
    """A whole number."""
    is_word = isinstance(given, str) and given.strip().removeprefix("-").isdecimal() and len(given) < 20
    if not is_word and (not isinstance(given, Integral) or isinstance(given, bool)):
        raise refused(given, "a whole number")
    return int(given)  # type: ignore[call-overload]


count = such(whole, lambda value: value >= 1, "1 or more")


def number(given: object) -> float:
    """A finite number."""
    try:
        value = float(given) if isinstance(given, Real | str) and not isinstance(given, bool) else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise refused(given, "a number")
    return value


positive = such(number, lambda value: value > 0, "a number above 0")

ratio = such(number, lambda value: 1e-9 <= value <= 1e9, "a number of 1e-9 to 1e9")
"""How many times as large."""

decibels = such(number, lambda value: 0 < value < 120, "more than 0 and less than 120 dB")
"""A PSNR to reach."""

port = such(whole, lambda value: 0 <= value <= 65535, "a port of 0 to 65535")
"""A TCP port, 0 for any."""


def numbers(length: int | None = None) -> Callable[[object], tuple[float, ...]]:
    """Reads so many finite numbers, or any number of them, in words with commas between them."""

    def kind(given: object) -> tuple[float, ...]:
        parts = given.split(",") if isinstance(given, str) else given
        try:
            values = tuple(map(number, items(parts)))
        except InputError:
            values = ()
        if not values or length not in (None, len(values)):
            raise refused(given, f"{length} numbers" if length else "numbers such as 0,6,12")
        return values

    return kind


def texts(given: object) -> tuple[str, ...]:
    """`paper,balanced` to a tuple of its words."""
    parts = given.split(",") if isinstance(given, str) else items(given)
    values = tuple(text(part).strip() for part in parts)
    if not all(values):
        raise refused(given, "words such as paper,balanced")
    return values


def indices(given: object) -> tuple[int, ...]:
    """`0,4` to (0, 4), and ranges with their ends: `0-8:4,20` to (0, 4, 8, 20)."""
    if isinstance(given, str):
        return tuple(index for part in given.split(",") for index in _range(part, given))
    try:
        return tuple(map(whole, items(given)))
    except InputError:
        raise refused(given, "a list of whole numbers") from None


def items(given: object) -> Collection[Any]:
    """What has items in order, such as a list or an array."""
    if not isinstance(given, Collection) or isinstance(given, str | bytes | Mapping | Set):
        raise refused(given, "a list")
    return given


def _range(part: str, text: str) -> range:
    span, colon, step = part.strip().partition(":")
    first, dash, last = span.partition("-")
    numbers = [first, *([last] if dash else []), *([step] if colon else [])]
    is_range = all(number.isdecimal() and len(number) < 8 for number in numbers) and (dash or not colon)
    if not is_range or (colon and not int(step)) or (dash and int(last) < int(first)):
        raise refused(text, "indices such as 0,4 or ranges such as 0-40:2")
    return range(int(first), int(last if dash else first) + 1, int(step) if colon else 1)


def size(given: object) -> tuple[int, int]:
    """`384x256`, the width first, or (256, 384), to (height, width)."""
    if isinstance(given, str):
        parts = given.lower().split("x")
        if len(parts) != 2 or not all(part.isdecimal() and int(part) > 0 for part in parts):
            raise refused(given, "WIDTHxHEIGHT such as 384x256")
        return int(parts[1]), int(parts[0])
    sides = indices(given)
    if len(sides) != 2 or min(sides) < 1:
        raise refused(given, "a height and a width of 1 or more")
    return sides[0], sides[1]


grid = such(indices, lambda sides: len(sides) == 3 and min(sides) > 0, "V,H,W of 1 or more")
"""`2,256,384` or (2, 256, 384): views, height and width."""

bits = such(indices, lambda both: len(both) == 2, "two numbers of 1 to 8")
"""`5,4` or (5, 4): bits of SH coefficients of degree 1, and of those above."""


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
    raise refused(given, "white, black or #rrggbb")


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
        raise refused(given, "a size such as 100KB, 1.5MB or 4096")
    return int(value)
