"""Read a container: bytes in, validated metadata and views of the coded pictures out.

Trust boundary: every length is checked against the bytes left and against `Limits` before anything is allocated, every
number against its range. Code past this point may index freely. Layout: docs/FORMAT.md.
"""

import math
from collections.abc import Sequence
from operator import index

import numpy as np

from ..errors import FormatError, InputError
from ..scene.cameras import MAX_POSITION
from . import layout as L
from .bodies import body_kind, known_kinds
from .body import Container, Opened
from .limits import Limits
from .notes import NOTES, read_notes
from .sections import Cursor, Section, only, read_table, require
from .table import read_pictures

_SHARED = frozenset({L.SCENE, NOTES, L.PICTURES, L.DATA})
"""Sections that a file of any mode may have."""


def read_container(
    data: bytes | memoryview,
    limits: Limits | None = None,
    *,
    is_prefix: bool = False,
    is_damaged: bool = False,
    views: Sequence[int] | None = None,
) -> Container:
    """Parse and check a file.

    Args:
        data: the whole file, or its first bytes.
        limits: what to accept.
        is_prefix: accept `data` that ends before the file does, as long as it holds the metadata.
        is_damaged: take what is intact of a damaged or cut file, which is refused else.
        views: read these views alone, in this order; what is decoded is what it is in the whole file. None for all.

    Raises:
        FormatError: damaged, cut short, foreign, of an unknown version, or beyond the limits.
        InputError: `views` are not different views of the file.
    """
    view = memoryview(data).cast("B") if not isinstance(data, bytes) else memoryview(data)
    version, total, sections = read_table(view, _SHARED | known_kinds(), is_prefix=is_prefix or is_damaged)
    scene = only(sections, L.SCENE)
    cursor = Cursor(scene)
    view_count, layer_count, qp, *origin, profile = cursor.unpack(L.SCENE_FIXED)
    cursor.finish()
    require(math.isfinite(qp), scene, "Q_g is not finite")
    require(all(abs(x) <= MAX_POSITION for x in origin), scene, f"origin {origin}, at most {MAX_POSITION:g} accepted")
    kind = body_kind({section.kind for section in sections})
    found = {(section.kind, section.index) for section in sections}
    require(len(found) == len(sections), scene, "a section stands twice in the file")
    for section in sections:
        require(section.kind in _SHARED | kind.kinds, section, f"does not belong in a file of mode {kind.mode}")
        most = layer_count if section.kind in L.BY_LAYER else L.MAX_SETS if section.kind == L.PARAMETER_SETS else 1
        require(section.index < most, section, f"index {section.index}, accepted are {most} from 0")
    wanted = check_views(views, view_count) if views is not None and kind.is_divisible else None
    table = read_pictures(only(sections, L.PICTURES), only(sections, L.DATA), wanted, is_damaged=is_damaged)
    opened = Opened(scene, sections, view_count, layer_count, table, np.array(origin), limits or Limits())
    body = kind.read(opened)
    notes, name = read_notes(sections), _ascii(profile, scene)
    sets, chosen = opened.parameter_sets, None if kind.is_divisible else views
    return Container(version, name, qp, opened.origin, body, table, sets, notes, total, chosen)


def check_views(views: Sequence[int], count: int) -> tuple[int, ...]:
    """Which views are asked for of so many; InputError unless they are different ones that there are."""
    try:
        chosen = tuple(index(view) for view in views)
    except TypeError:
        raise InputError(f"{views!r:.60}, expected indices of views", where="views") from None
    if not chosen or len(set(chosen)) < len(chosen) or not all(0 <= view < count for view in chosen):
        raise InputError(f"{list(chosen)}, expected different views of 0 to {count - 1}", where="views")
    return chosen


def _ascii(raw: bytes, section: Section) -> str:
    try:
        return raw.rstrip(b"\0").decode("ascii")
    except UnicodeDecodeError:
        raise FormatError("profile name is not ASCII", where=section.label) from None
