"""Values as people write them, on a command line or in a manifest: each function takes a word and returns its value.

Raises:
    InputError: of a word that stands for none; says what is expected.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import InputError
from .types import check_types

_BYTES = {"": 1, "b": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9, "kib": 1 << 10, "mib": 1 << 20, "gib": 1 << 30}

ALL = "all"
"""Every view, however many there are."""

AUTO, NO = "auto", "no"
"""Of refinement: in as many steps as are usual for so many photos, and not at all."""


@dataclass(frozen=True)
class AutoViews:
    """Views that are chosen: up to six by what they see, more as far from each other as there are.

    Attributes:
        count: how many; None for those that the capture needs.
    """

    count: int | None = None

    def __post_init__(self) -> None:
        check_types(self)
        if self.count is not None and self.count < 2:
            raise InputError(f"{self.count}, expected 2 or more", where="views")


@dataclass(frozen=True)
class Refinement:
    """For how many steps, or for how many seconds, Gaussians are corrected; with neither, for as many steps as are
    usual for so many photos; with 0 steps, not at all.
    """

    steps: int | None = None
    seconds: float | None = None

    def __post_init__(self) -> None:
        check_types(self)
        if self.steps is not None and self.seconds is not None:
            raise InputError("expected steps or seconds, and one of them", where="refine")

    def __str__(self) -> str:
        if self == Refinement():
            return AUTO
        return f"{self.seconds:g}s" if self.steps is None else str(self.steps or NO)

    def __bool__(self) -> bool:
        return self.steps != 0


def indices(text: str) -> tuple[int, ...]:
    """`0,4` to (0, 4), and ranges with their ends: `0-8:4,20` to (0, 4, 8, 20)."""
    return tuple(index for part in text.split(",") for index in _range(part, text))


def _range(part: str, text: str) -> range:
    span, colon, step = part.strip().partition(":")
    first, dash, last = span.partition("-")
    numbers = [first, *([last] if dash else []), *([step] if colon else [])]
    is_range = all(number.isdecimal() and len(number) < 8 for number in numbers) and (dash or not colon)
    if not is_range or (colon and not int(step)) or (dash and int(last) < int(first)):
        raise InputError(f"'{text}', expected indices such as 0,4 or ranges such as 0-40:2")
    return range(int(first), int(last if dash else first) + 1, int(step) if colon else 1)


def views(text: str) -> tuple[int, ...] | AutoViews | str:
    """`0,4` to (0, 4); `auto` or `auto:3` to how many views to choose; `all` to itself."""
    word, _, count = text.partition(":")
    if text == ALL:
        return text
    if word != "auto":
        return indices(text)
    if count and not (count.isdecimal() and int(count) >= 2):
        raise InputError(f"'{text}', expected auto or auto:N with N of 2 or more")
    return AutoViews(int(count)) if count else AutoViews()


def size(text: str) -> tuple[int, int]:
    """`384x256`, the width first, to (height, width)."""
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isdecimal() and int(part) > 0 for part in parts):
        raise InputError(f"'{text}', expected WIDTHxHEIGHT such as 384x256")
    return int(parts[1]), int(parts[0])


def size_or_full(text: str) -> tuple[int, int] | str:
    """`384x256`, the width first, to (height, width), or the word `full`."""
    return text if text == "full" else size(text)


def byte_count(text: str) -> int:
    """`100KB`, `1.5 MiB` or `4096` to bytes; KB is 1000."""
    number = text.rstrip("BbKkMmGgIi ")
    unit = text[len(number) :].strip().lower()
    try:
        value = float(number) * _BYTES[unit]
    except (KeyError, ValueError):
        value = 0.0
    if not 1 <= value < 1 << 40:
        raise InputError(f"'{text}', expected a size such as 100KB, 1.5MB or 4096")
    return int(value)


def refinement(text: str) -> Refinement:
    """`20` to steps, `10s` to seconds, `auto` to neither, `no` to 0 steps."""
    if text in (AUTO, NO):
        return Refinement(steps=0 if text == NO else None)
    if text.isdecimal() and int(text) > 0:
        return Refinement(steps=int(text))
    try:
        seconds = float(text.removesuffix("s")) if text.endswith("s") else 0.0
    except ValueError:
        seconds = 0.0
    if not 0 < seconds < float("inf"):
        raise InputError(f"'{text}', expected steps such as 20, seconds such as 10s, auto or no")
    return Refinement(seconds=seconds)
