"""Types of what was given, held against the annotations of the data classes that take it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields
from numbers import Integral, Real
from typing import Any

from ..errors import InputError
from ..system.printable import type_of

_KINDS: Mapping[str, tuple[Any, str]] = {
    "str": (str, "text"),
    "bool": (bool, "true or false"),
    "int": (Integral, "a whole number"),
    "float": (Real, "a number"),
    "StrPath": ((str, os.PathLike), "a path"),
    "bytes": (bytes, "bytes"),
}
"""By the names in annotations: accepted types, and how messages call them."""


def check_types(record: Any) -> None:
    """InputError naming the field of a data class whose value is of none of the types that its annotation names."""
    for one in fields(record):
        value, names = getattr(record, one.name), str(one.type).split(" | ")
        if not set(names) <= {*_KINDS, "None"} or (value is None and "None" in names):
            continue
        kinds = [_KINDS[name] for name in names if name != "None"]
        if not any(isinstance(value, kind) and isinstance(value, bool) <= (kind is bool) for kind, _ in kinds):
            raise InputError(f"{shown(value)}, expected {' or '.join(text for _, text in kinds)}", where=one.name)


def shown(value: object) -> str:
    """A value in a message: text in quotes, what JSON has as it is, of all else the type."""
    if not isinstance(value, str | int | float | list | tuple | dict | None):
        return type_of(value)
    text = f"'{value}'" if isinstance(value, str) else str(value)
    return text if len(text) <= 48 else f"{text[:45]}..."
