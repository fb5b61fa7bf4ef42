"""Read a container: bytes in, validated metadata and views of the coded pictures out.

Trust boundary: every length is checked against the bytes left and against `Limits` before anything is allocated, every
number against its range. Code past this point may index freely. Layout: docs/FORMAT.md.
"""

from __future__ import annotations

import math

import numpy as np

from ..errors import FormatError
from ..scene.cameras import MAX_POSITION
from . import layout as L
from .bodies import body_kind, known_kinds
from .body import Container, Opened
from .notes import MINOR, read_notes
from .planes import PLANE_KINDS
from .records import Limits
from .sections import Cursor, Section, only, read_table, require

_SHARED = frozenset({L.SCENE, *MINOR})
"""Sections that a file of any mode may have."""


def read_container(data: bytes | memoryview, limits: Limits | None = None, *, is_prefix: bool = False) -> Container:
    """Parse and check a file.

    Args:
        data: the whole file, or its first bytes.
        limits: what to accept.
        is_prefix: accept `data` that ends before the file does, as long as it holds the metadata.

    Raises:
        FormatError: damaged, cut short, foreign, of an unknown version, or beyond the limits.
    """
    view = memoryview(data).cast("B") if not isinstance(data, bytes) else memoryview(data)
    version, total, sections = read_table(view, _SHARED | known_kinds(), PLANE_KINDS, is_prefix=is_prefix)
    scene = only(sections, L.SCENE)
    cursor = Cursor(scene)
    views, layer_count, qp, *origin, profile = cursor.unpack(L.SCENE_FIXED)
    cursor.finish()
    require(math.isfinite(qp), scene, "Q_g is not finite")
    require(all(abs(x) <= MAX_POSITION for x in origin), scene, f"origin {origin}, at most {MAX_POSITION:g} accepted")
    kind = body_kind({section.kind for section in sections}, layer_count)
    for section in sections:
        require(section.kind in _SHARED | kind.kinds, section, f"does not belong in a file of mode {kind.mode}")
    opened = Opened(scene, sections, views, layer_count, np.array(origin), limits or Limits())
    body, notes = kind.read(opened), read_notes(sections)
    return Container(version, _ascii(profile, scene), qp, opened.origin, body, opened.parameter_sets, notes, total)


def _ascii(raw: bytes, section: Section) -> str:
    try:
        return raw.rstrip(b"\0").decode("ascii")
    except UnicodeDecodeError:
        raise FormatError("profile name is not ASCII", where=section.label) from None
