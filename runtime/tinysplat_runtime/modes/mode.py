"""What a mode is."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from ..codec.job import Job
from ..codec.layers import OpenFile
from ..container.body import Body
from ..gaussian.gaussians import Gaussians

if TYPE_CHECKING:  # who decodes loads no encoder
    from ..codec.search import Coder

BodyKind = TypeVar("BodyKind", bound=Body)


@dataclass(frozen=True)
class Mode(Generic[BodyKind]):
    """What a file can carry; `container/bodies.py` has the body of the same mode, which reads and describes itself.

    Attributes:
        name: as users say; its body's `mode`.
        encode: a job to the file's bytes; InputError and NumericError for what cannot be coded.
        decode: an opened file and its body to its Gaussians; FormatError where it is damaged.
        coder: what codes a job at any Q_g, of modes in which a size or a fidelity can be searched for.
    """

    name: str
    encode: Callable[[Job], bytes]
    decode: Callable[[OpenFile, BodyKind], Gaussians]
    coder: Callable[[Job], Coder] | None = None

    def coder_of(self, job: Job) -> Coder:
        """What codes a job: where nothing can be searched for, in one way."""
        from ..codec.search import Once

        return self.coder(job) if self.coder else Once(job.profile, lambda: self.encode(job))


def find_mode(name: str) -> Mode[Any]:
    """The mode of a body, loaded now: who decodes planes needs neither network nor encoder."""
    mode: Mode[Any] = getattr(importlib.import_module(f".{name}", __package__), name.upper())
    return mode
