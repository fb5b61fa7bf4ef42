"""Read a container: bytes in, validated metadata and views of the coded pictures out.

Trust boundary: every length is checked against the bytes left and against `Limits` before anything is allocated, every
number against its range. Code past this point may index freely. Layout: docs/FORMAT.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import index

import numpy as np

from ..errors import FormatError, InputError
from ..scene.cameras import MAX_POSITION, Camera
from . import layout as L
from .bodies import body_kind, known_kinds
from .body import Container, Opened
from .notes import MINOR, read_notes
from .records import Limits
from .sections import Cursor, Section, only, read_table, require
from .units import READ_LATER, check_units, readable_views

_SHARED = frozenset({L.SCENE, *MINOR})
"""Sections that a file of any mode may have."""


def read_container(
    data: bytes | memoryview,
    limits: Limits | None = None,
    *,
    is_prefix: bool = False,
    is_damaged: bool = False,
    views: Sequence[int] | None = None,
    units: Mapping[int, bytes | memoryview] | None = None,
) -> Container:
    """Parse and check a file.

    Args:
        data: the whole file, or its first bytes.
        limits: what to accept.
        is_prefix: accept `data` that ends before the file does, as long as it holds the metadata.
        is_damaged: leave out views whose own metadata are cut off or damaged.
        views: which views of the file to read, in this order, where it has views that can be read one without another
            (`Body.is_divisible`); None for all.
        units: sections VIEW by view, for `data` that holds the metadata alone.

    Raises:
        FormatError: damaged, cut short, foreign, of an unknown version, or beyond the limits.
        InputError: `views` are not different views of the file.
    """
    view = memoryview(data).cast("B") if not isinstance(data, bytes) else memoryview(data)
    known = _SHARED | known_kinds()
    version, total, sections = read_table(view, known, READ_LATER, is_prefix=is_prefix or units is not None)
    if units is not None:
        sections = [_with_unit(section, units) if section.kind == L.VIEW else section for section in sections]
    scene = only(sections, L.SCENE)
    cursor = Cursor(scene)
    view_count, layer_count, qp, *origin, profile = cursor.unpack(L.SCENE_FIXED)
    cursor.finish()
    require(math.isfinite(qp), scene, "Q_g is not finite")
    require(all(abs(x) <= MAX_POSITION for x in origin), scene, f"origin {origin}, at most {MAX_POSITION:g} accepted")
    kind = body_kind({section.kind for section in sections})
    for section in sections:
        require(section.kind in _SHARED | kind.kinds, section, f"does not belong in a file of mode {kind.mode}")
    all_views = tuple(range(view_count))
    wanted = all_views if views is None or not kind.is_divisible else check_views(views, view_count)
    opened = Opened(scene, sections, view_count, all_views, layer_count, np.array(origin), limits or Limits())
    absent: tuple[int, ...] = ()
    if opened.has(L.UNITS):
        opened.check_counts()
        if is_prefix or is_damaged:
            absent = tuple(sorted(set(wanted).difference(readable_views(opened, wanted, is_damaged=is_damaged))))
        opened = replace(opened, wanted=tuple(view for view in wanted if view not in absent))
        body = kind.read(opened)
    else:
        body = kind.read(opened)
        body = body if wanted == all_views else body.select(wanted)
    return Container(
        version,
        _ascii(profile, scene),
        qp,
        opened.origin,
        body,
        opened.parameter_sets,
        read_notes(sections),
        total,
        tuple(view for view in wanted if view not in absent),
        absent,
    )


@dataclass(frozen=True)
class Outline:
    """What a file whose views are units says of them all, before any is read.

    Attributes:
        cameras: one per view, of layer 0's size.
        depth_limits: least and largest z of layer 0.
        ranges: (first byte, length) of each view's section.
    """

    cameras: tuple[Camera, ...]
    depth_limits: tuple[float, float]
    ranges: tuple[tuple[int, int], ...]


def read_outline(metadata: bytes | memoryview, limits: Limits | None = None) -> Outline:
    """Parse and check the metadata of a file whose views are units; FormatError as `read_container`."""
    view = memoryview(metadata)
    _, _, sections = read_table(view, _SHARED | known_kinds(), READ_LATER, is_prefix=True)
    view_count, layer_count, _, *origin, _ = Cursor(only(sections, L.SCENE)).unpack(L.SCENE_FIXED)
    views = tuple(range(view_count))
    opened = Opened(
        only(sections, L.SCENE), sections, view_count, views, layer_count, np.array(origin), limits or Limits()
    )
    opened.check_counts()
    height, width, *_, z_min, z_max, _, _ = Cursor(opened.only(L.LAYER)).unpack(L.LAYER_FIXED)
    ranges = tuple((s.end - s.length, s.length) for s in check_units(opened))
    return Outline(opened.cameras(height, width), (z_min, z_max), ranges)


def check_views(views: Sequence[int], count: int) -> tuple[int, ...]:
    """Which views are asked for of so many; InputError unless they are different ones that there are."""
    try:
        chosen = tuple(index(view) for view in views)
    except TypeError:
        raise InputError(f"{views!r:.60}, expected indices of views", where="views") from None
    if not chosen or len(set(chosen)) < len(chosen) or not all(0 <= view < count for view in chosen):
        raise InputError(f"{list(chosen)}, expected different views of 0 to {count - 1}", where="views")
    return chosen


def _with_unit(section: Section, units: Mapping[int, bytes | memoryview]) -> Section:
    data = memoryview(units.get(section.index, b""))
    if section.index in units and len(data) != section.length:
        raise FormatError(f"needs {section.length} bytes, {len(data)} are given", where=section.label)
    return replace(section, data=data)


def _ascii(raw: bytes, section: Section) -> str:
    try:
        return raw.rstrip(b"\0").decode("ascii")
    except UnicodeDecodeError:
        raise FormatError("profile name is not ASCII", where=section.label) from None
