"""Damage that follows what code it reaches: atheris on the reader of .tsplat files, beside the structured campaign.

    pip install atheris
    PYTHONPATH=tests python -m hostile.guided [libFuzzer's options] [FOLDER of inputs, which grows]

Checksums of sections are made right before a file is read, else nothing would get past them.
"""

import struct
import sys
from zlib import crc32

import atheris  # type: ignore[import-not-found]

with atheris.instrument_imports(include=["tinysplat_runtime.container", "tinysplat_runtime.gaussian.notes"]):
    from tinysplat_runtime.container import layout as L
    from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.container.limits import Limits
from tinysplat_runtime.errors import FormatError


def repaired(data: bytes) -> bytes:
    """The file with the checksums of all sections that lie in it, and of its table, made right."""
    found, start = bytearray(data), L.HEADER.size
    count = min(L.HEADER.unpack_from(data)[3], (len(data) - start) // L.TABLE_ROW.size)
    at = end = start + count * L.TABLE_ROW.size
    for row in range(start, end, L.TABLE_ROW.size):
        *_, length, _ = L.TABLE_ROW.unpack_from(data, row)
        struct.pack_into("<I", found, row + L.TABLE_ROW.size - 4, crc32(data[at : at + length]))
        at += length
    struct.pack_into("<I", found, start - 4, crc32(found[start:end], crc32(found[: start - 4])))
    return bytes(found)


def attack(data: bytes) -> None:
    """Whatever is raised besides FormatError is a finding; libFuzzer keeps the file."""
    try:
        read_container(repaired(data) if len(data) >= L.HEADER.size else data, Limits(1 << 14, 16 << 20))
    except FormatError as error:
        assert "\n" not in str(error)


if __name__ == "__main__":
    atheris.Setup(sys.argv, attack)
    atheris.Fuzz()
