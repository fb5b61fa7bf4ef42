"""What a photo's Exif says: how it is turned, its lens, which way things fell, and Adobe RGB, stated nowhere else.

Trust boundary: a TIFF structure (TIFF 6.0, section 2) in which offsets lead anywhere; what is damaged says nothing.
"""

import struct

_ORIENTATION, _EXIF, _INTEROPERABILITY, _INDEX = 0x0112, 0x8769, 0xA005, 0x0001
_MAKE, _MODEL, _FOCAL, _ZOOM, _FOCAL_35, _LENS = 0x010F, 0x0110, 0x920A, 0xA404, 0xA405, 0xA434
_NOTE, _ACCELERATION = 0x927C, 0x0008
_APPLE = b"Apple iOS\0\0\1MM"  # followed by a directory, whose offsets count from the start of the note
_ASCII, _RATIONALS = 2, {5: "2I", 10: "2i"}  # types of values, and others by what `struct` calls them
_NUMBERS = {3: ("H", True), 4: ("I", True), 11: ("f", True), 12: ("d", False)}  # and whether the entry itself has it
_MOST_TEXT = 200
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


def taken_with(tiff: bytes) -> tuple[object, ...]:
    """What tells the lens and its zoom: make, model, lens, focal length in mm and in those of 35 mm film, digital zoom;
    None for what is not said or damaged.
    """
    said: list[object] = []
    for tags, pointers in (((_MAKE, _MODEL), ()), ((_LENS, _FOCAL, _FOCAL_35, _ZOOM), (_EXIF,))):
        for tag in tags:
            try:
                order, directory = _start(tiff)
                for pointer in pointers:
                    (directory,) = struct.unpack(f"{order}I", _entry(tiff, order, directory, pointer))
                said.append(_value(tiff, order, directory, tag))
            except struct.error:
                said.append(None)
    return tuple(said)


def gravity(tiff: bytes) -> tuple[float, float, float] | None:
    """Which way things fell, in g to the right and top of a phone's screen and out of it, as iPhones write in their
    maker note; None where it is not said or damaged.
    """
    try:
        order, directory = _start(tiff)
        (directory,) = struct.unpack(f"{order}I", _entry(tiff, order, directory, _EXIF))
        _, size, at = struct.unpack(f"{order}HII", _entry(tiff, order, directory, _NOTE, whole=True))
        note = tiff[at : at + size]
        if not note.startswith(_APPLE):
            return None
        _, _, at = struct.unpack(">HII", _entry(note, ">", len(_APPLE), _ACCELERATION, whole=True))
        x, of_x, y, of_y, z, of_z = struct.unpack_from(">6i", note, at)
    except struct.error:
        return None
    return (x / of_x, y / of_y, z / of_z) if of_x and of_y and of_z else None


def _value(tiff: bytes, order: str, directory: int, tag: int) -> object:
    """A tag's text or number, rounded to as many digits as tell two focal lengths apart."""
    kind, count, at = struct.unpack(f"{order}HII", _entry(tiff, order, directory, tag, whole=True))
    if kind == _ASCII:
        text = tiff[at : at + min(count, _MOST_TEXT)] if count > 4 else _entry(tiff, order, directory, tag)[:count]
        return text.rstrip(b"\0 ")
    if kind in _RATIONALS:
        over, under = struct.unpack_from(order + _RATIONALS[kind], tiff, at)
        return round(over / under, 2) if under else None
    if kind in _NUMBERS:
        code, is_inside = _NUMBERS[kind]
        stated = _entry(tiff, order, directory, tag) if is_inside else tiff[at:]
        return round(struct.unpack_from(order + code, stated)[0], 2)
    return None


def _start(tiff: bytes) -> tuple[str, int]:
    """Byte order and where the first directory lies; struct.error where this is no TIFF structure."""
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(tiff[:4])
    if order is None:
        raise struct.error
    (directory,) = struct.unpack_from(f"{order}I", tiff, 4)
    return order, directory


def _entry(tiff: bytes, order: str, directory: int, tag: int, *, whole: bool = False) -> bytes:
    """The four bytes of a tag's value or offset, `whole` with its type and count before them; struct.error where the
    directory has none.
    """
    (entries,) = struct.unpack_from(f"{order}H", tiff, directory)
    for entry in range(entries):
        at = directory + 2 + 12 * entry
        if struct.unpack_from(f"{order}H10x", tiff, at)[0] == tag:
            return tiff[at + 2 if whole else at + 8 : at + 12]
    raise struct.error
