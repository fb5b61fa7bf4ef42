"""The bodies that there are: one for each mode."""

from __future__ import annotations

from collections.abc import Collection

from .body import Body
from .exact import Exact
from .photos import Photos
from .planes import Planes
from .points import Points

BODIES: list[type[Body]] = [Points, Exact, Photos, Planes]
"""A file's body is of the first kind that its sections tell; by its name `codec/modes/` has what codes it."""


def body_kind(kinds: Collection[bytes]) -> type[Body]:
    """Which body a file with such sections has."""
    return next(body for body in BODIES if body.is_told_by(kinds))


def known_kinds() -> frozenset[bytes]:
    """The types of sections of all bodies."""
    return frozenset().union(*(body.kinds for body in BODIES))
