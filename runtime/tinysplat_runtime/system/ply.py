"""Elements of any .ply file, through the package plyfile; what they mean is known elsewhere.

A header's comments may be in any encoding: plyfile knows ASCII alone, and never sees other bytes.

Trust boundary: a header's counts are held against the file's length before memory is taken.
"""

import io
import re
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .files import parsing

_MAX_HEADER_BYTES = 1 << 16
_ASCII = bytes(range(128)) + b"?" * 128
_POINTER = b"version https://git-lfs"
_BYTES = {"char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2}
_BYTES |= {"double": 8, "float64": 8}

_TYPES = {"char": "i1", "uchar": "u1", "int8": "i1", "uint8": "u1", "short": "i2", "ushort": "u2", "int16": "i2"}
_TYPES |= {"uint16": "u2", "int": "i4", "uint": "u4", "int32": "i4", "uint32": "u4"}
_TYPES |= {"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"}


def ply_elements(path: Path, max_bytes: int) -> dict[str, NDArray]:
    """The structured array (N,) of each element of a .ply file, by its name; lists are objects in it.

    Raises:
        InputError: damaged, no .ply file, or larger than `max_bytes`.
        ImportError: plyfile is not installed.
    """
    import plyfile

    header, is_text = _checked_header(path, max_bytes)
    columns = _columns_of_text(path, header) if is_text else None
    if columns is not None:
        with parsing(".ply file"), path.open("rb") as file:
            file.seek(header)
            file.readline()
            name, count, types = columns
            rows = np.loadtxt(file, types, comments=None, ndmin=1, max_rows=count) if count else np.zeros(0, types)
            if len(rows) < count:
                raise InputError(f"{len(rows)} rows, announced are {count}")
            return {name: rows}
    with parsing(".ply file"), _open(path, header, is_text) as file:
        return {element.name: element.data for element in plyfile.PlyData.read(file)}


def _columns_of_text(path: Path, header: int) -> tuple[str, int, np.dtype] | None:
    """Name, count and row of the one element of numbers that a file of text has, which numpy reads far sooner; None of
    any other file.
    """
    with path.open("rb") as file:
        lines = [line.split() for line in file.read(header).translate(_ASCII).decode("ascii").splitlines()]
    elements = [line for line in lines if line[:1] == ["element"]]
    properties = [line for line in lines if line[:1] == ["property"]]
    is_plain = len(elements) == 1 and len(elements[0]) == 3 and properties
    if not is_plain or any(len(line) != 3 or line[1] not in _TYPES for line in properties):
        return None
    names = [line[2] for line in properties]
    if len({*names}) < len(names):
        return None
    return elements[0][1], int(elements[0][2]), np.dtype([(line[2], _TYPES[line[1]]) for line in properties])


def _open(path: Path, header: int, is_text: bool) -> IO[Any]:
    return path.open(encoding="ascii", errors="ignore", newline="") if is_text else _Tolerant(path, header)


class _Tolerant(io.BufferedReader):
    """A file whose header of so many bytes reads as ASCII."""

    def __init__(self, path: Path, header: int) -> None:
        super().__init__(io.FileIO(path))
        self._header = header

    def read(self, size: int | None = -1) -> bytes:
        is_header = self.tell() < self._header
        data = super().read(size)
        return data.translate(_ASCII) if is_header else data


def _checked_header(path: Path, max_bytes: int) -> tuple[int, bool]:
    """How long a header is, and whether text follows it.

    Counts that the file is too short for are refused: a value takes at least a byte in each of PLY's encodings.
    """
    with path.open("rb") as file:
        head, end, _ = file.read(_MAX_HEADER_BYTES).partition(b"end_header")
    if head.startswith(_POINTER):
        raise InputError("Git LFS's pointer to a file, expected the file: `git lfs pull` fetches it")
    if not head.startswith(b"ply") or not end:
        raise InputError("does not start with a PLY header")
    values, length = 0, len(head) + len(b"end_header\n")
    for element in re.split(rb"[\r\n]\s*element\s", head)[1:]:
        count = re.match(rb"\s*\S+\s+(\d{1,18})\s", element)
        if count is None:
            raise InputError("damaged PLY header")
        kinds = re.findall(rb"[\r\n]\s*property\s+(\S+)", element)
        values += int(count[1]) * max(len(kinds), 1)
        length += int(count[1]) * sum(_BYTES.get(kind.decode("ascii", "replace"), 4) for kind in kinds)
    size = path.stat().st_size
    if b"format binary" in head and b"property list" not in head and length > size:
        raise InputError(f"cut short: {size} bytes of the {length} that its header announces")
    if values > min(size, max_bytes // 8):
        raise InputError(f"announces {values} values, which neither the file nor {max_bytes} bytes can hold")
    return len(head) + len(b"end_header"), b"format ascii" in head
