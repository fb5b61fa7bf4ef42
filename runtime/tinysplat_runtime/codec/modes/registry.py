"""The modes there are, by name."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from typing import Any

from ...container.bodies import BODIES
from .mode import Mode


class _Modes(Mapping[str, Mode[Any]]):
    """A mode of that name for every body, loaded when it is asked for: who decodes planes needs neither network nor
    encoder.
    """

    def __getitem__(self, name: str) -> Mode[Any]:
        if name not in list(self):
            raise KeyError(name)
        mode: Mode[Any] = getattr(importlib.import_module(f".{name}", __package__), name.upper())
        return mode

    def __iter__(self) -> Iterator[str]:
        return (body.mode for body in BODIES)

    def __len__(self) -> int:
        return len(BODIES)


MODES: Mapping[str, Mode[Any]] = _Modes()
