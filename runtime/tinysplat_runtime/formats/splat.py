"""`.splat` in (antimatter15's 32 bytes a Gaussian) and `.ksplat` in (GaussianSplats3D's buckets); both lie behind us.

.splat: means and scales as three float32 each, RGBA as bytes, the quaternion wxyz as bytes (v − 128) / 128.
.ksplat 0.1: a header of 4,096 bytes, one of 1,024 for each section, then the sections: the sizes of partly filled
buckets, the buckets' centres, and the Gaussians, whose positions are 16-bit offsets from their bucket's centre in modes
1 and 2. Source: github.com/mkkellogg/GaussianSplats3D.

Trust boundary: every count is held against the file's length before memory is taken.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.sh import C0
from ..system.files import read_limited
from .assembly import joined

_RECORD = 32

_MAIN_HEADER, _SECTION_HEADER = 4096, 1024
_MAX_SECTIONS = 4096
_FLOATS = {0: "<f4", 1: "<f2", 2: "<f2"}  # of scales and rotations in a mode
_HIGHER = {0: "<f4", 1: "<f2", 2: "<u1"}  # of SH
_HIGHER_COUNTS = {0: 0, 1: 9, 2: 24}
_QUANTISATION = 32767


def read_splat(path: Path, max_bytes: int) -> dict[str, NDArray]:
    """Read means (N, 3), quats (N, 4), scales (N, 3), opacities (N,) and sh (N, 1, 3), linear, float.

    Raises:
        InputError: damaged, or larger than `max_bytes`.
    """
    data = read_limited(path, max_bytes)
    if not data or len(data) % _RECORD:
        raise InputError(f"{len(data)} bytes, expected a multiple of {_RECORD}")
    kind = np.dtype([("means", "<f4", 3), ("scales", "<f4", 3), ("rgba", "u1", 4), ("quats", "u1", 4)])
    rows = np.frombuffer(data, kind)
    quats = (rows["quats"].astype(np.float64) - 128) / 128
    quats[~quats.any(axis=1), 0] = 1  # all 128: no rotation
    return {
        "means": rows["means"],
        "quats": quats,
        "scales": rows["scales"],
        "opacities": rows["rgba"][:, 3] / 255.0,
        "sh": _constant(rows["rgba"][:, :3]),
    }


def read_ksplat(path: Path, max_bytes: int) -> dict[str, NDArray]:
    """Read means (N, 3), quats (N, 4), scales (N, 3), opacities (N,) and sh (N, B, 3), linear, float.

    Raises:
        InputError: damaged, of another version, or larger than `max_bytes`.
    """
    data = read_limited(path, max_bytes)
    if len(data) < _MAIN_HEADER:
        raise InputError(f"{len(data)} bytes, expected a header of {_MAIN_HEADER}")
    major, minor = data[0], data[1]
    sections, mode = struct.unpack_from("<I", data, 4)[0], struct.unpack_from("<H", data, 20)[0]
    low, high = struct.unpack_from("<2f", data, 36)
    if (major, minor >= 1) != (0, True) or mode not in _FLOATS:
        raise InputError(f"version {major}.{minor}, mode {mode}; expected version 0.1 and mode 0, 1 or 2")
    at = _MAIN_HEADER + sections * _SECTION_HEADER
    if sections > _MAX_SECTIONS or at > len(data):
        raise InputError(f"{sections} sections, which the file is too short for")
    parts = []
    for n in range(sections):
        section = _Section.read(data, _MAIN_HEADER + n * _SECTION_HEADER, mode)
        if at + section.size > len(data):
            raise InputError(f"section {n} of {section.size} bytes, which the file is too short for")
        if section.count:
            with np.errstate(over="ignore", invalid="ignore"):  # Gaussians will name what is not finite
                parts.append(section.arrays(data, at, (low or -1.5, high or 1.5)))
        at += section.size
    if not parts:
        raise InputError("no Gaussians")
    return joined(parts)


@dataclass(frozen=True)
class _Section:
    """A section's header.

    Attributes:
        mode: of compression, the file's.
        count, room: Gaussians in it, and as many as there is room for.
        capacity, buckets, full, partial: of buckets; `partial` are filled as a table in front of them says.
        block: side of a bucket, scene units.
        steps: of a position from the middle of a bucket to its side.
        storage: bytes of a bucket's centre.
        degree: of SH.
    """

    mode: int
    count: int
    room: int
    capacity: int
    buckets: int
    full: int
    partial: int
    block: float
    steps: int
    storage: int
    degree: int

    @classmethod
    def read(cls, data: bytes, at: int, mode: int) -> _Section:
        count, room, capacity, buckets = struct.unpack_from("<4I", data, at)
        block, storage = struct.unpack_from("<fH", data, at + 16)
        steps = struct.unpack_from("<I", data, at + 24)[0] or _QUANTISATION
        full, partial = struct.unpack_from("<2I", data, at + 32)
        degree = struct.unpack_from("<H", data, at + 40)[0]
        section = cls(mode, count, room, capacity, buckets, full, partial, block, steps, storage, degree)
        if degree not in _HIGHER_COUNTS or count > room or full + partial > buckets or not np.isfinite(block):
            raise InputError(f"damaged header of a section ({count} of {room} Gaussians, SH degree {degree})")
        if mode and buckets and storage < 12:
            raise InputError(f"{storage} bytes a bucket, expected its centre's 12")
        return section

    @property
    def kind(self) -> np.dtype:
        """A Gaussian's record."""
        floats, higher = _FLOATS[self.mode], _HIGHER[self.mode]
        positions = "<u2" if self.mode else "<f4"
        fields = [("means", positions, 3), ("scales", floats, 3), ("quats", floats, 4), ("rgba", "u1", 4)]
        return np.dtype([*fields, ("sh", higher, _HIGHER_COUNTS[self.degree])])

    @property
    def size(self) -> int:
        """Bytes of the section's data."""
        return 4 * self.partial + self.storage * self.buckets + self.kind.itemsize * self.room

    def arrays(self, data: bytes, at: int, sh_range: tuple[float, float]) -> dict[str, NDArray]:
        rows = np.frombuffer(data, self.kind, self.count, at + 4 * self.partial + self.storage * self.buckets)
        means = rows["means"].astype(np.float64)
        if self.mode:
            means = (means - self.steps) * (self.block / 2 / self.steps) + self._centres(data, at)
        higher = rows["sh"].astype(np.float64)
        if self.mode == 2:
            higher = sh_range[0] + higher / 255 * (sh_range[1] - sh_range[0])
        bands = [
            higher[:, n * n * 3 - 3 : (n + 1) ** 2 * 3 - 3].reshape(self.count, 3, 2 * n + 1).swapaxes(1, 2)
            for n in range(1, self.degree + 1)
        ]
        return {
            "means": means,
            "quats": rows["quats"].astype(np.float64),
            "scales": rows["scales"].astype(np.float64),
            "opacities": rows["rgba"][:, 3] / 255.0,
            "sh": np.concatenate([_constant(rows["rgba"][:, :3]), *bands], axis=1),
        }

    def _centres(self, data: bytes, at: int) -> NDArray:
        """(count, 3): of each Gaussian's bucket."""
        partly = np.frombuffer(data, "<u4", self.partial, at)
        filled = np.minimum(np.concatenate([np.full(self.full, self.capacity, np.int64), partly]), self.count)
        ends = np.cumsum(filled)
        if not len(ends) or ends[-1] < self.count:
            raise InputError(f"buckets of fewer Gaussians than the section's {self.count}")
        bucket = np.searchsorted(ends, np.arange(self.count), side="right")
        octets = np.frombuffer(data, np.uint8, self.storage * self.buckets, at + 4 * self.partial)
        centres = np.ascontiguousarray(octets.reshape(self.buckets, self.storage)[:, :12]).view("<f4")
        return centres[bucket].astype(np.float64)


def _constant(rgb: NDArray) -> NDArray:
    """(N, 1, 3) coefficients of degree 0 of bytes (N, 3)."""
    return ((rgb / 255.0 - 0.5) / C0)[:, None]
