"""What words on a command line become: types for argparse, shared by all commands.

Each takes the word and returns its value, or raises ArgumentTypeError, which argparse turns into one line.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TypeVar

from ..errors import InputError
from ..prune.amount import Amount
from ..recipe import words

T = TypeVar("T")


def _word(read: Callable[[str], T]) -> Callable[[str], T]:
    """What manifests have too, as argparse takes it."""

    def parse(text: str) -> T:
        try:
            return read(text)
        except InputError as error:
            raise argparse.ArgumentTypeError(error.message) from None

    return parse


indices = _word(words.indices)
views = _word(words.views)
size = _word(words.size)
size_or_full = _word(words.size_or_full)
byte_count = _word(words.byte_count)
budget = _word(words.refinement)
amount = _word(Amount.of)


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


def count(text: str) -> int:
    """A whole number, 1 or more."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}', expected a whole number of 1 or more")
    return int(text)
