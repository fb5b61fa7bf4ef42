"""What bodies are made of: coded pictures and their channels."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from zlib import crc32

from ..errors import FormatError
from ..gaussian.planes import PlaneClass


@dataclass(frozen=True, slots=True)
class Picture:
    """One coded picture, or what else a row of the table holds for a view.

    Attributes:
        data: its bytes; None where they are cut off, or altered in a file that is recovered.
        length, crc: how many there are, and their CRC-32.
        end: where it ends in the file; 0 of one that is to be written.
    """

    data: memoryview | None
    length: int
    crc: int
    end: int = 0

    @classmethod
    def each_of(cls, payloads: Iterable[bytes]) -> tuple[Picture, ...]:
        """Pictures to be written."""
        return tuple(cls(memoryview(data), len(data), crc32(data)) for data in payloads)

    def checked(self, where: str) -> memoryview:
        """Its bytes; FormatError with `where` unless they are those that were written."""
        if self.data is None:
            raise FormatError("cut short, or its bytes were altered", where=where)
        if crc32(self.data) != self.crc:
            raise FormatError("CRC differs: the bytes were altered", where=where)
        return self.data


@dataclass(frozen=True)
class ChannelRecord:
    """One channel as stored or to be stored: a row of the table of pictures, without its layer.

    Attributes:
        plane_class, target: which channel of which class the values add to.
        qp: QP of its pictures.
        scale, offset: value = offset + code · scale; a constant channel is `offset` alone.
        pictures: one per view; empty for a constant channel.
    """

    plane_class: PlaneClass
    target: int
    qp: int
    scale: float
    offset: float
    pictures: tuple[Picture, ...] = ()

    @property
    def key(self) -> tuple[PlaneClass, int]:
        """Its class and target."""
        return self.plane_class, self.target

    @property
    def name(self) -> str:
        """For messages and reports."""
        return f"{self.plane_class.label}{self.target}"

    def lacks(self, view: int) -> bool:
        """Whether it has a picture of the view, but not its bytes."""
        return bool(self.pictures) and self.pictures[view].data is None
