"""What words on a command line become: types for argparse, shared by all commands.

Each takes the word and returns its value, or raises ArgumentTypeError, which argparse turns into one line.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from ..errors import InputError


class Input(str):
    """Name of a file or folder that a command reads."""


class Output(str):
    """Name of a file, or of a folder, that a command writes."""


def _word(name: str) -> Callable[[str], Any]:
    """What options are made of, as argparse takes it: a function of `recipe.words`, loaded for the first word."""

    def parse(text: str) -> Any:
        from ..recipe import words

        try:
            return getattr(words, name)(text)
        except InputError as error:
            raise argparse.ArgumentTypeError(error.message) from None

    return parse


indices = _word("indices")
size = _word("size")
grid = _word("grid")
byte_count = _word("byte_count")
positive = _word("positive")
count = _word("count")
colour = _word("colour")


def port(text: str) -> int:
    """A TCP port, 0 for any."""
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"'{text}', expected a port of 0 to 65535")
    return int(text)
