"""Write a container: a mode's sections and rows in, one file's bytes out. Layout: docs/FORMAT.md."""

from collections.abc import Sequence
from dataclasses import dataclass
from zlib import crc32

from numpy.typing import NDArray

from ..gaussian.notes import NO_NOTES, Notes
from ..scene.cameras import Camera
from . import layout as L
from .cameras import camera_sections
from .notes import note_sections
from .sections import NewSection
from .table import Row, picture_sections


@dataclass(frozen=True)
class Head:
    """What a file of any mode states.

    Attributes:
        cameras: one per view, or of a list those of its photos.
        origin: (3,) float64.
        profile, qp: for information.
        notes: what is said about the scene.
    """

    cameras: Sequence[Camera]
    origin: NDArray
    profile: str
    qp: float
    notes: Notes = NO_NOTES


def write_container(
    head: Head, metadata: Sequence[NewSection], rows: Sequence[Row], layers: int = 0, *, views: int | None = None
) -> bytes:
    """The file: metadata first, then pictures.

    Args:
        head: what it states.
        metadata: sections of the mode.
        rows: channels in the order in which their pictures are to stand.
        layers: layers or tiers.
        views: pictures of a row, where they are not as many as cameras.
    """
    cameras = head.cameras
    scene = L.SCENE_FIXED.pack(len(cameras), layers, head.qp, *head.origin, head.profile.encode("ascii"))
    sections = [
        NewSection(L.SCENE, 0, scene),
        *camera_sections(cameras),
        *note_sections(head.notes),
        *metadata,
        *picture_sections(rows, views or len(cameras)),
    ]
    table = b"".join(
        L.TABLE_ROW.pack(s.kind, L.REQUIRED * s.is_required, s.index, len(s.data), crc32(s.data)) for s in sections
    )
    start = L.HEADER.pack(L.MAGIC, L.MAJOR, L.MINOR, len(sections), 0, 0)[:-4]
    start += crc32(start + table).to_bytes(4, "little")
    return b"".join((start, table, *(section.data for section in sections)))
