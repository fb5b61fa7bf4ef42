"""The modes there are, by name."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping

from .mode import Mode

_NAMES = ("gaussians", "photos", "hybrid", "lossless", "free")


class _Modes(Mapping[str, Mode]):
    """A mode is loaded when it is asked for: who decodes planes needs neither network nor encoder."""

    def __getitem__(self, name: str) -> Mode:
        if name not in _NAMES:
            raise KeyError(name)
        mode: Mode = getattr(importlib.import_module(f".{name}", __package__), name.upper())
        return mode

    def __iter__(self) -> Iterator[str]:
        return iter(_NAMES)

    def __len__(self) -> int:
        return len(_NAMES)


MODES: Mapping[str, Mode] = _Modes()
