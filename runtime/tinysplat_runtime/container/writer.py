"""Write a container: layers' metadata and coded planes in, one file's bytes out. Layout: docs/FORMAT.md."""

from __future__ import annotations

from collections.abc import Sequence
from zlib import crc32

from numpy.typing import NDArray

from ..gaussian.notes import NO_NOTES, Notes
from ..scene.cameras import Camera
from . import layout as L
from .layers import CodedLayer, intrinsics
from .notes import note_sections
from .planes import layer_sections, plane_sections
from .sections import NewSection
from .units import MOST_TOGETHER, unit_sections


def write_container(
    layers: Sequence[CodedLayer],
    cameras: Sequence[Camera],
    origin: NDArray,
    profile: str,
    qp: float,
    extras: Sequence[NewSection] = (),
    *,
    layer_count: int | None = None,
    notes: Notes = NO_NOTES,
) -> bytes:
    """The file: metadata first, then planes such that the picture gets better from pass to pass.

    `origin` is (3,) float64. `extras` are the sections of a mode, between the two; `layer_count` is how many layers
    they hold where `layers` are none. `notes` stand behind the cameras, in every prefix that shows anything.
    """
    scene = L.SCENE_FIXED.pack(len(cameras), layer_count or len(layers), qp, *origin, profile.encode("ascii"))
    sections = [
        NewSection(L.SCENE, 0, scene),
        *([NewSection(L.CAMERAS, 0, b"".join(_camera(camera) for camera in cameras))] if cameras else []),
        *note_sections(notes),
    ]
    # Photos make a scene together: files with them are read as a whole.
    as_units = len(cameras) > MOST_TOGETHER and not extras and bool(layers)
    pictures = unit_sections(layers) if as_units else plane_sections(layers)
    return _assemble([*sections, *layer_sections(layers, as_units=as_units), *extras, *pictures])


def _assemble(sections: Sequence[NewSection]) -> bytes:
    table = b"".join(
        L.TABLE_ROW.pack(s.kind, L.REQUIRED * s.is_required, s.index, len(s.data), crc32(s.data)) for s in sections
    )
    minor = max(section.minor for section in sections)
    head = L.HEADER.pack(L.MAGIC, L.MAJOR, minor, len(sections), 0, 0)[:-4]
    head += crc32(head + table).to_bytes(4, "little")
    return b"".join((head, table, *(section.data for section in sections)))


def _camera(camera: Camera) -> bytes:
    return L.CAMERA.pack(*intrinsics(camera.K), *camera.c2w[:3].ravel())
