"""What a photo's Exif says about its pixels: how it is turned, and Adobe RGB, which cameras state nowhere else.

Trust boundary: a TIFF structure (TIFF 6.0, section 2) in which offsets lead anywhere; what is damaged says nothing.
"""

from __future__ import annotations

import struct

_ORIENTATION, _EXIF, _INTEROPERABILITY, _INDEX = 0x0112, 0x8769, 0xA005, 0x0001
_ADOBE_RGB = b"R03\0"  # DCF 2.0, "optional file"


def orientation(tiff: bytes) -> int:
    """The orientation 1 to 8 in a TIFF structure's first directory; 1 where there is none or it is damaged."""
    try:
        order, first = _start(tiff)
        value = _entry(tiff, order, first, _ORIENTATION)
    except struct.error:
        return 1
    (stated,) = struct.unpack(f"{order}H", value[:2])
    return stated if 1 <= stated <= 8 else 1


def is_adobe_rgb(tiff: bytes) -> bool:
    """Whether the interoperability index is that of photos in Adobe RGB."""
    try:
        order, directory = _start(tiff)
        for pointer in (_EXIF, _INTEROPERABILITY):
            (directory,) = struct.unpack(f"{order}I", _entry(tiff, order, directory, pointer))
        return _entry(tiff, order, directory, _INDEX) == _ADOBE_RGB
    except struct.error:
        return False


def _start(tiff: bytes) -> tuple[str, int]:
    """Byte order and where the first directory lies; struct.error where this is no TIFF structure."""
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(tiff[:4])
    if order is None:
        raise struct.error
    (directory,) = struct.unpack_from(f"{order}I", tiff, 4)
    return order, directory


def _entry(tiff: bytes, order: str, directory: int, tag: int) -> bytes:
    """The four bytes of a tag's value or offset; struct.error where the directory has none."""
    (entries,) = struct.unpack_from(f"{order}H", tiff, directory)
    for entry in range(entries):
        at = directory + 2 + 12 * entry
        if struct.unpack_from(f"{order}H10x", tiff, at)[0] == tag:
            return tiff[at + 8 : at + 12]
    raise struct.error
