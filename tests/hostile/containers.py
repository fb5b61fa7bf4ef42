"""`.tsplat` files taken apart, damaged where it hurts and put together again with right checksums.

Without right checksums no reader gets past its first test, and libavcodec is never reached.
"""

from __future__ import annotations

import struct
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from random import Random
from zlib import crc32

import numpy as np
from sections import Pict, sections_of, with_picture

from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.exact import EXACT, EXACT_FIXED
from tinysplat_runtime.container.list import LIST, LIST_FIXED, TIER, TIER_FIXED
from tinysplat_runtime.container.photos import PHOTOS, PHOTOS_FIXED

from .damage import VALUES, damage


@dataclass(frozen=True)
class Part:
    """A section: type, flags, index and its bytes; `crc` where it is to be a wrong one."""

    kind: bytes
    flags: int
    index: int
    data: bytes
    crc: int | None = None


@dataclass(frozen=True)
class Seed:
    """A valid file, its sections, and its table of pictures."""

    data: bytes
    parts: tuple[Part, ...]
    pict: Pict

    @classmethod
    def of(cls, data: bytes) -> Seed:
        """Take a file apart."""
        return cls(data, tuple(split(data)), Pict.of(data))

    def place_in_file(self, start: int) -> int:
        """Where a byte of DATA lies in the file."""
        return len(self.data) - len(self.parts[-1].data) + start


def split(data: bytes) -> list[Part]:
    """Sections of a valid file."""
    return [Part(*fields) for fields in sections_of(data)]


def join(parts: Sequence[Part], *, major: int = L.MAJOR, minor: int = L.MINOR) -> bytes:
    """A file of these sections, all checksums right unless a part says otherwise."""
    rows = [
        L.TABLE_ROW.pack(p.kind, p.flags, p.index, len(p.data), crc32(p.data) if p.crc is None else p.crc)
        for p in parts
    ]
    return _with_header(len(parts), b"".join(rows), major, minor) + b"".join(p.data for p in parts)


def _with_header(count: int, table: bytes, major: int = L.MAJOR, minor: int = L.MINOR) -> bytes:
    head = L.HEADER.pack(L.MAGIC, major, minor, count, 0, 0)[:-4]
    return head + struct.pack("<I", crc32(table, crc32(head))) + table


def changed(seed: Seed, kind: bytes, change: Callable[[bytearray], None], index: int = 0) -> bytes:
    """The file with one section changed and every checksum right."""
    parts = list(seed.parts)
    at = next(i for i, p in enumerate(parts) if (p.kind, p.index) == (kind, index))
    data = bytearray(parts[at].data)
    change(data)
    parts[at] = replace(parts[at], data=bytes(data))
    return join(parts)


def field(at: int, code: str, value: float) -> Callable[[bytearray], None]:
    """Writes a number of numpy's type `code` at a byte."""
    packed = np.array(value, code).tobytes()

    def change(data: bytearray) -> None:
        data[at : at + len(packed)] = packed

    return change


_GROWTH = """
import resource, sys
import tinysplat_runtime as ts
runtime = ts.Runtime(threads=2)
runtime.decompress(open(sys.argv[1], "rb").read())
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
runtime.decompress(open(sys.argv[2], "rb").read())
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024)
"""


def memory_of_decoding(folder: Path, small: bytes, large: bytes) -> int:
    """Bytes by which decoding a large file adds to the largest memory of a process that has decoded a small one."""
    command = [sys.executable, "-c", _GROWTH]
    for name, data in (("small", small), ("large", large)):
        (folder / name).write_bytes(data)
        command.append(str(folder / name))
    return int(subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout)


# ---- ways to damage a file -----------------------------------------------------------------------------------------


def damage_bytes(seed: Seed, rng: Random) -> bytes:
    """Anything anywhere, checksums left as they are."""
    return damage(seed.data, rng)


def damage_section(seed: Seed, rng: Random) -> bytes:
    """One section damaged, its checksum and the header's made right again; mostly metadata."""
    parts = list(seed.parts)
    choices = [i for i, p in enumerate(parts) if p.kind != L.DATA or rng.random() < 0.1]
    for _ in range(rng.choice((1, 1, 2))):
        i = rng.choice(choices)
        parts[i] = replace(parts[i], data=damage(parts[i].data, rng, keep_length=rng.random() < 0.8))
    return join(parts)


def place_field(seed: Seed, rng: Random) -> bytes:
    """One field of the metadata at a value that readers break at, everything else right."""
    parts = list(seed.parts)
    i = rng.choice([i for i, p in enumerate(parts) if p.kind in _FIELDS and p.data])
    data = bytearray(parts[i].data)
    fields = _FIELDS.get(parts[i].kind)
    if fields and rng.random() < 0.7:
        at, width = rng.choice(fields)
    else:
        width = rng.choice((1, 2, 4, 8))
        at = rng.randrange(max(len(data) - width, 1))
    data[at : at + width] = rng.choice(VALUES[width])
    parts[i] = replace(parts[i], data=bytes(data))
    return join(parts)


def rearrange_sections(seed: Seed, rng: Random) -> bytes:
    """Sections missing, doubled, reordered, renamed, renumbered, unknown, empty, or with a wrong checksum."""
    parts = list(seed.parts)
    for _ in range(rng.choice((1, 1, 2, 3))):
        i, j = (rng.randrange(len(parts)) for _ in range(2))
        match rng.randrange(9):
            case 0 if len(parts) > 1:
                del parts[i]
            case 1:
                parts.insert(j, parts[i])
            case 2:
                parts[i], parts[j] = parts[j], parts[i]
            case 3:
                parts[i] = replace(parts[i], kind=rng.choice((parts[j].kind, b"NOTE", b"\0\0\0\0", b"\xff\xfe\n\r")))
            case 4:
                parts[i] = replace(parts[i], index=rng.choice((0, 1, 2, 255, 256, 512, 65535)))
            case 5:
                parts.insert(i, Part(b"NOTE", rng.choice((0, 1, 65535)), rng.choice((0, 65535)), rng.randbytes(9)))
            case 6:
                parts[i] = replace(parts[i], data=rng.choice((b"", parts[j].data, parts[i].data * 2)))
            case 7:
                parts[i] = replace(parts[i], crc=rng.getrandbits(32))
            case _:
                parts[i] = replace(parts[i], flags=rng.choice((0, 1, 2, 65535)))
    return join(parts)


def damage_table(seed: Seed, rng: Random) -> bytes:
    """The section table and the header's own fields, the header's checksum right: lengths that lie."""
    start, count = L.HEADER.size, len(seed.parts)
    end = start + count * L.TABLE_ROW.size
    table = bytearray(seed.data[start:end])
    row = rng.randrange(count) * L.TABLE_ROW.size
    if rng.random() < 0.7:
        table[row + 8 : row + 12] = rng.choice(VALUES[4])
    else:
        table = bytearray(damage(bytes(table), rng, keep_length=True))
    stated = rng.choice((count, count, count, count - 1, count + 1, 0, 4096, 65535))
    major = rng.choice((L.MAJOR, L.MAJOR, L.MAJOR, 0, 2, 65535))
    return _with_header(stated, bytes(table), major, rng.choice((0, 1, 65535))) + seed.data[end:]


CONTAINER_DAMAGE: tuple[tuple[Callable[[Seed, Random], bytes], float], ...] = (
    (damage_bytes, 0.2),
    (damage_section, 0.3),
    (place_field, 0.25),
    (rearrange_sections, 0.15),
    (damage_table, 0.1),
)
"""Ways and their shares; four files in five have right checksums."""


def damage_container(seed: Seed, rng: Random) -> bytes:
    """A damaged file, in one of the ways of `CONTAINER_DAMAGE`."""
    ways, shares = zip(*CONTAINER_DAMAGE, strict=True)
    return rng.choices(ways, shares)[0](seed, rng)


# ---- pictures ------------------------------------------------------------------------------------------------------


def damage_pictures(seed: Seed, rng: Random) -> bytes:
    """Pictures, positions or parameter sets damaged, every checksum on the way to their decoders right."""
    parts = list(seed.parts)
    sets = [i for i, p in enumerate(parts) if p.kind == L.PARAMETER_SETS]
    if sets and rng.random() < 0.25:
        i = rng.choice(sets)
        parts[i] = replace(parts[i], data=damage(parts[i].data, rng))
        return join(parts)
    data, places = seed.data, seed.pict.places
    for place in rng.sample(places, min(rng.choice((1, 1, 3)), len(places))):
        picture = seed.parts[-1].data[place.start : place.start + place.length]
        data = with_picture(data, place, damage(picture, rng, keep_length=True))
    return data


def damage_whole(seed: Seed, rng: Random) -> bytes:
    """For the whole decoder: pictures, or metadata fields that get past the reader."""
    return rng.choices((damage_pictures, place_field, damage_section), (0.5, 0.3, 0.2))[0](seed, rng)


def _field_offsets(fields: struct.Struct) -> list[tuple[int, int]]:
    """(offset, width) of every number of a packed struct."""
    offsets, at = [], 0
    for repeat, code in _codes(fields.format):
        for _ in range(1 if code == "s" else repeat):
            width = repeat if code == "s" else struct.calcsize(f"<{code}")
            if width in VALUES:
                offsets.append((at, width))
            at += width
    return offsets


def _codes(form: str) -> list[tuple[int, str]]:
    codes, digits = [], ""
    for char in form.lstrip("<"):
        if char.isdigit():
            digits += char
        else:
            codes.append((int(digits or 1), char))
            digits = ""
    return codes


_FIELDS = {
    L.SCENE: _field_offsets(L.SCENE_FIXED),
    L.CAMERAS: _field_offsets(L.COLUMN),
    L.LAYER: _field_offsets(L.LAYER_FIXED),
    L.PICTURES: _field_offsets(struct.Struct(L.PICTURES_FIXED.format + L.CHANNEL.format[1:])),
    EXACT: _field_offsets(EXACT_FIXED),
    PHOTOS: _field_offsets(PHOTOS_FIXED),
    LIST: _field_offsets(LIST_FIXED),
    TIER: _field_offsets(TIER_FIXED),
}
