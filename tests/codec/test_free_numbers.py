"""Mode free by hand: octrees byte by byte, channels number by number, classes of weight, grids and steps."""

from __future__ import annotations

import lzma
import math
from typing import Any

import numpy as np
import pytest

from tinysplat_runtime.codec.free.attributes import Columns, from_columns
from tinysplat_runtime.codec.free.octree import CodedPoints, encode_points, morton_keys
from tinysplat_runtime.codec.free.planes import plane_shape, to_plane

FILTERS: list[dict[str, Any]] = [
    {"id": lzma.FILTER_LZMA2, "preset": 6, "lc": 0, "lp": 0, "pb": 0, "nice_len": 32, "dict_size": 1 << 16}
]


def packed(data: bytes) -> bytes:
    return lzma.compress(data, lzma.FORMAT_RAW, filters=FILTERS)


def unpacked(stream: bytes) -> bytes:
    return lzma.decompress(stream, lzma.FORMAT_RAW, filters=FILTERS)


CELLS = np.array([[0, 0, 0], [1, 0, 0], [0, 3, 0], [3, 3, 3], [2, 3, 3], [3, 2, 3], [3, 3, 2], [2, 2, 2]], float)
"""Of 4 × 4 × 4; in the first part of eight lie two, in the third one, in the last five."""


def tree() -> tuple[CodedPoints, np.ndarray]:
    """The cells, of which the first holds 3 points, and the last 300."""
    keys = np.sort(morton_keys(np.concatenate([CELLS, CELLS[:1], CELLS[:1], np.repeat(CELLS[3:4], 299, axis=0)])))
    return encode_points(keys, 2), keys


def test_an_octree_is_a_byte_a_cell_in_the_stream_of_its_parent_s_parts() -> None:
    points, _ = tree()
    assert (points.levels, points.leaves, points.escapes) == ((1, 3), 8, 1)
    first, second, last = 0b11, 0b100, 1 | 1 << 7 | 1 << 6 | 1 << 5 | 1 << 3
    streams = [b"", b"", bytes([first, second, last]), bytes([1 | 1 << 2 | 1 << 7])]
    streams += [bytes([2, 0, 0, 0, 0, 0, 0, 255]), (299).to_bytes(4, "little")]
    assert [unpacked(stream) for stream in points.streams] == streams
    assert list(points.streams) == [packed(stream) for stream in streams]


def test_lists_are_pictures_along_a_z() -> None:
    sizes = {1: (16, 16), 256: (16, 16), 257: (32, 32), 1025: (64, 64), 4096: (64, 64), 4097: (64, 128),
             8193: (128, 128), 16384: (128, 128), 16385: (128, 192), 24577: (192, 192)}  # fmt: skip
    assert {count: plane_shape(count) for count in sizes} == sizes
    plane = to_plane(np.arange(300))
    assert plane[:4, :4].tolist() == [[0, 1, 4, 5], [2, 3, 6, 7], [8, 9, 12, 13], [10, 11, 14, 15]]
    assert plane[0, 16] == 256 and plane[16, 0] == 299 and plane[31, 31] == 299
    wide = to_plane(np.arange(9000))
    assert wide.shape == (128, 128) and [wide[0, 64], wide[64, 0], wide[64, 64]] == [4096, 8192, 8999]


# ---- channels -------------------------------------------------------------------------------------------------------


def columns(**fields: Any) -> Columns:
    plain = {"roots": 0.5, "sizes": 0.0, "lengths": 0.0, "thins": 0.0}
    arrays = {name: np.array([fields.get(name, value)], float) for name, value in plain.items()}
    return Columns(**arrays, turns=np.array([fields.get("turns", [0, 0, 0])], float), sh=np.zeros((1, 3)))


def test_gaussians_of_channels_by_hand() -> None:
    found = from_columns(columns(sizes=1.0, lengths=0.5, thins=0.25, turns=[0.1, 0.2, 0.3]))
    np.testing.assert_allclose(np.log(found["scales"]), [[1.25, 0.75, 0.5]], rtol=1e-6)
    np.testing.assert_allclose(found["quats"], [[math.sqrt(1 - 0.14), 0.1, 0.2, 0.3]], rtol=1e-6)
    assert found["opacities"].tolist() == [0.25] and found["sh"].shape == (1, 1, 3)
    np.testing.assert_allclose(np.log(from_columns(columns(sizes=1.0), 0.5)["scales"]), [[1.5] * 3], rtol=1e-6)
    assert from_columns(columns(roots=1.5))["opacities"] == 1 and from_columns(columns(roots=-1.0))["opacities"] == 0
    found = from_columns(columns(lengths=-3.0, thins=-1.0, turns=[0, 3, 4]))
    np.testing.assert_allclose(found["scales"], [[1, 1, 1]])
    np.testing.assert_allclose(found["quats"], [[0, 0, 0.6, 0.8]], rtol=1e-6)
    sphere = columns(sizes=1.0, lengths=0.6, thins=0.3, turns=[0.1, 0, 0]).as_spheres()
    assert (sphere.sizes[0], sphere.lengths[0], sphere.thins[0]) == pytest.approx((0.8, 0, 0))
    whole = np.log(from_columns(columns(sizes=1.0, lengths=0.6, thins=0.3))["scales"]).sum()
    assert 3 * sphere.sizes[0] == pytest.approx(whole, rel=1e-5)  # the same volume
