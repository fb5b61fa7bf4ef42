"""What words on a command line become: types for argparse, shared by all commands.

Each takes the word and returns its value, or raises ArgumentTypeError, which argparse turns into one line.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class AutoViews:
    """Views chosen by coverage and baseline.

    Attributes:
        count: how many.
    """

    count: int = 2


@dataclass(frozen=True)
class Budget:
    """For how many steps, or for how many seconds; one of them is None."""

    steps: int | None = None
    seconds: float | None = None


def budget(text: str) -> Budget:
    """`20` to steps, `10s` to seconds."""
    if text.isdigit() and int(text) > 0:
        return Budget(steps=int(text))
    try:
        seconds = float(text.removesuffix("s")) if text.endswith("s") else 0.0
    except ValueError:
        seconds = 0.0
    if not 0 < seconds < float("inf"):
        raise argparse.ArgumentTypeError(f"'{text}', expected steps such as 20 or seconds such as 10s")
    return Budget(seconds=seconds)


def size(text: str) -> tuple[int, int]:
    """`256x384` to (height, width)."""
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isdigit() and int(part) > 0 for part in parts):
        raise argparse.ArgumentTypeError(f"'{text}', expected HEIGHTxWIDTH such as 256x384")
    return int(parts[0]), int(parts[1])


def size_or_full(text: str) -> tuple[int, int] | str:
    """`256x384` to (height, width), or the word `full`."""
    return text if text == "full" else size(text)


def indices(text: str) -> list[int]:
    """`0,4` to [0, 4]."""
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}', expected indices such as 0,4") from None


def port(text: str) -> int:
    """A TCP port, 0 for any."""
    if not text.isdigit() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"'{text}', expected a port of 0 to 65535")
    return int(text)


def positive(text: str) -> float:
    """A finite number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"'{text}', expected a number above 0")
    return value


def numbers(length: int) -> Callable[[str], tuple[float, ...]]:
    """Reads `length` finite numbers with commas between them."""

    def parse(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(part) for part in text.split(","))
        except ValueError:
            values = ()
        if len(values) != length or not all(abs(value) < float("inf") for value in values):
            raise argparse.ArgumentTypeError(f"'{text}', expected {length} numbers with commas between them")
        return values

    return parse


def views(text: str) -> list[int] | AutoViews:
    """`0,4` to [0, 4]; `auto` or `auto:3` to how many views to choose."""
    word, _, count = text.partition(":")
    if word != "auto":
        return indices(text)
    if count and not (count.isdigit() and int(count) >= 2):
        raise argparse.ArgumentTypeError(f"'{text}', expected auto or auto:N with N of 2 or more")
    return AutoViews(int(count)) if count else AutoViews()


def count(text: str) -> int:
    """A whole number, 1 or more."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}', expected a whole number of 1 or more")
    return int(text)


_BYTES = {"": 1, "b": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9, "kib": 1 << 10, "mib": 1 << 20, "gib": 1 << 30}


def byte_count(text: str) -> int:
    """`100KB`, `1.5 MiB` or `4096` to bytes; KB is 1000."""
    number = text.rstrip("BbKkMmGgIi ")
    unit = text[len(number) :].strip().lower()
    try:
        value = float(number) * _BYTES[unit]
    except (KeyError, ValueError):
        value = 0.0
    if not 1 <= value < 1 << 40:
        raise argparse.ArgumentTypeError(f"'{text}', expected a size such as 100KB, 1.5MB or 4096")
    return int(value)
