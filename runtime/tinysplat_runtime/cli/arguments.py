"""What words on a command line become: types for argparse, shared by all commands.

Each takes the word and returns its value, or raises ArgumentTypeError, which argparse turns into one line.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..errors import InputError

if TYPE_CHECKING:
    from ..prune.amount import Amount


def _word(name: str) -> Callable[[str], Any]:
    """What manifests have too, as argparse takes it: a function of `recipe.words`, loaded for the first word."""

    def parse(text: str) -> Any:
        from ..recipe import words

        try:
            return getattr(words, name)(text)
        except InputError as error:
            raise argparse.ArgumentTypeError(error.message) from None

    return parse


indices = _word("indices")
views = _word("views")
size = _word("size")
size_or_full = _word("size_or_full")
byte_count = _word("byte_count")
budget = _word("refinement")


def amount(text: str) -> Amount:
    """A share, a number of dB, or a count, as `prune.amount` has them."""
    from ..prune.amount import Amount

    try:
        return Amount.of(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(error.message) from None


def port(text: str) -> int:
    """A TCP port, 0 for any."""
    if not text.isdecimal() or int(text) > 65535:
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
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}', expected a whole number of 1 or more")
    return int(text)
