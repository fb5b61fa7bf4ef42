"""The bodies that there are: one for each mode."""

from collections.abc import Collection

from ..errors import FormatError
from .body import Body
from .exact import Exact
from .list import List
from .photos import Photos
from .planes import Planes

BODIES: list[type[Body]] = [Planes, Photos, Exact, List]
"""A file's body is of the kind whose sign is among its sections; by its name `modes/` has what codes it."""


def body_kind(kinds: Collection[bytes]) -> type[Body]:
    """Which body a file with such sections has; FormatError where none tells, or several."""
    found = [body for body in BODIES if body.sign in kinds]
    if len(found) != 1:
        signs = ", ".join(body.sign.decode() for body in BODIES)
        raise FormatError(f"has sections of {len(found)} modes, expected one of {signs}", where="file")
    return found[0]


def known_kinds() -> frozenset[bytes]:
    """The types of sections of all bodies."""
    return frozenset().union(*(body.kinds for body in BODIES))
