"""Mode list by hand: octrees byte by byte, and lists as pictures."""

from __future__ import annotations

import lzma
from typing import Any

import numpy as np

from tinysplat_runtime.gaussian.curve import morton_keys
from tinysplat_runtime.list.coding.octree import encode_points
from tinysplat_runtime.list.coding.planes import plane_shape, to_plane

FILTERS: list[dict[str, Any]] = [{"id": lzma.FILTER_LZMA2, "lc": 0, "lp": 0, "pb": 0, "dict_size": 1 << 16}]


def unpacked(stream: bytes) -> bytes:
    return lzma.decompress(stream, lzma.FORMAT_RAW, filters=FILTERS)


CELLS = np.array([[0, 0, 0], [1, 0, 0], [0, 3, 0], [3, 3, 3], [2, 3, 3], [3, 2, 3], [3, 3, 2], [2, 2, 2]], float)
"""Of 4 × 4 × 4; in the first part of eight lie two, in the third one, in the last five."""


def test_an_octree_is_a_byte_a_cell_in_the_stream_of_its_parent_s_parts() -> None:
    """The first cell holds 3 points, the last 300."""
    keys = np.sort(morton_keys(np.concatenate([CELLS, CELLS[:1], CELLS[:1], np.repeat(CELLS[3:4], 299, axis=0)])))
    points = encode_points(keys, 2)
    assert (points.levels, points.leaves, points.escapes) == ((1, 3), 8, 1)
    first, second, last = 0b11, 0b100, 1 | 1 << 7 | 1 << 6 | 1 << 5 | 1 << 3
    streams = [b"", b"", bytes([first, second, last]), bytes([1 | 1 << 2 | 1 << 7])]
    streams += [bytes([2, 0, 0, 0, 0, 0, 0, 255]), (299).to_bytes(4, "little")]
    assert [unpacked(stream) for stream in points.streams] == streams


def test_lists_are_pictures_along_a_z() -> None:
    sizes = {1: (16, 16), 256: (16, 16), 257: (32, 32), 1025: (64, 64), 4096: (64, 64), 4097: (64, 128),
             8193: (128, 128), 16384: (128, 128), 16385: (128, 192), 24577: (192, 192)}  # fmt: skip
    assert {count: plane_shape(count) for count in sizes} == sizes
    plane = to_plane(np.arange(300))
    assert plane[:4, :4].tolist() == [[0, 1, 4, 5], [2, 3, 6, 7], [8, 9, 12, 13], [10, 11, 14, 15]]
    assert plane[0, 16] == 256 and plane[16, 0] == 299 and plane[31, 31] == 299
    wide = to_plane(np.arange(9000))
    assert wide.shape == (128, 128) and [wide[0, 64], wide[64, 0], wide[64, 64]] == [4096, 8192, 8999]
