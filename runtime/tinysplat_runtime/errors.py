"""Every error that this package raises on purpose.

    TinySplatError
    ├── InputError     what the user gave: photos, cameras, Gaussians, options
    ├── FormatError    a .tsplat file that is damaged, cut short or foreign
    ├── ModelError     an ONNX artifact that is missing or breaks its contract
    └── NumericError   values that a transform cannot represent

A message is one line: where (file, field, index), what was found, what would be accepted.
The command line turns any of them into that line and exit status 2.

Warnings are no errors: what they are about is used all the same.

    InputWarning         a part of what the user gave is left out, or likely wrong
    └── SceneWarning     what is likely wrong with photos or cameras
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from types import UnionType

from .system.printable import printable, type_of


class TinySplatError(Exception):
    """Base of all errors raised on purpose.

    Attributes:
        where: file, section or field at fault, outermost first, or None.
    """

    def __init__(self, message: str, *, where: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.where = where

    def __str__(self) -> str:
        return printable(f"{self.where}: {self.message}" if self.where else self.message)

    def within(self, where: str) -> TinySplatError:
        """The same error seen from one level further out, for instance from the file that held the field."""
        if self.where == where or (self.where or "").startswith(f"{where}: "):
            return self
        return type(self)(self.message, where=f"{where}: {self.where}" if self.where else where)


@contextmanager
def within(where: str, joint: str = ": ", known: str | None = None) -> Iterator[None]:
    """Errors of the block, seen from one level further out.

    Args:
        where: file, section or field.
        joint: what stands between it and the error's own place.
        known: errors whose own place begins so pass as they are.
    """
    try:
        yield
    except TinySplatError as error:
        if known is not None and (error.where or "").startswith(known):
            raise
        if joint == ": ":
            raise error.within(where) from None
        raise type(error)(error.message, where=f"{where}{joint}{error.where}" if error.where else where) from None


@contextmanager
def fast_for(where: str) -> Iterator[None]:
    """A block that imports what needs numba, for the option `where`.

    Raises:
        InputError: it is not installed; says how to.
    """
    try:
        yield
    except ImportError as error:
        raise InputError(f'needs {error.name}; pip install "tinysplat[fast]" brings it', where=where) from None


class InputError(TinySplatError):
    """What the user gave cannot be used as it is."""


class FormatError(TinySplatError):
    """A `.tsplat` file is damaged, cut short, foreign or beyond the limits."""


class ModelError(TinySplatError):
    """An ONNX artifact is missing, was altered, or breaks its contract."""


class NumericError(TinySplatError):
    """Values that the transform at hand cannot represent."""


class InputWarning(UserWarning):
    """A part of what the user gave is left out, read in another way than usual, or likely wrong."""


class SceneWarning(InputWarning):
    """Photos, cameras or depths of a scene do not seem to belong together; it is coded all the same."""


def check_is(value: object, kinds: type | UnionType, where: str, expected: str) -> None:
    """InputError where a value is of another kind than what is expected."""
    if not isinstance(value, kinds):
        raise InputError(f"{type_of(value)}, expected {expected}", where=where)


def warn(text: str, category: type[InputWarning] = InputWarning) -> None:
    """Issue a warning as of the line outside this package that called it."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith(__package__):
        frame, level = frame.f_back, level + 1
    warnings.warn(printable(text), category, stacklevel=level)
