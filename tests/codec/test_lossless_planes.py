"""Lossless planes are the bytes that docs/FORMAT.md has, sample by sample."""

from __future__ import annotations

import zlib

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scenes import agree, refusing

from tinysplat_runtime.codec import exact
from tinysplat_runtime.errors import FormatError


def naive_prediction(ordered: np.ndarray) -> np.ndarray:
    """Sample by sample as FORMAT has it: the median of left, above and left + above − corner."""
    height, width = ordered.shape
    plane = ordered.astype(int)
    out = np.zeros_like(plane)
    for r in range(height):
        for c in range(width):
            if r == 0:
                out[r, c] = plane[r, c - 1] if c else 0
            elif c == 0:
                out[r, c] = plane[r - 1, c]
            else:
                left, above, corner = plane[r, c - 1], plane[r - 1, c], plane[r - 1, c - 1]
                out[r, c] = sorted((left, above, left + above - corner))[1]
    return out


PLANES = arrays(
    np.float16,
    array_shapes(min_dims=2, max_dims=2, max_side=9),
    elements=st.sampled_from([0.0, -0.0, 1, -1, 65504, -65504, 6e-8, 0.1]),
)


def octets_of(plane: np.ndarray) -> bytes:
    """What FORMAT deflates of a plane."""
    bits = plane.view(np.uint16).astype(int)
    ordered = np.where(bits & 0x8000, 0xFFFF - bits, bits + 0x8000)
    rest = (ordered - naive_prediction(ordered) + 0x8000) % 0x10000 - 0x8000
    folded = np.where(rest < 0, -2 * rest - 1, 2 * rest).ravel()
    return bytes((folded & 255).astype(np.uint8)) + bytes((folded >> 8).astype(np.uint8))


def test_a_plane_s_bytes_are_those_of_the_format() -> None:
    def plain(plane: np.ndarray) -> list[int]:
        return list(octets_of(plane))

    agree(lambda plane: list(zlib.decompress(exact.pack(plane))), plain, PLANES)
    agree(lambda plane: exact.unpack(exact.pack(plane), plane.shape, "").view("u2"), lambda p: p.view("u2"), PLANES)
    plane = np.random.default_rng(0).normal(size=(6, 7)).astype(np.float16)
    octets = octets_of(plane)
    found = exact.pack(plane)
    for wrong in (zlib.compress(octets[:-1]), zlib.compress(octets + b"\0"), found + b"\0", found[:-1], b"x"):
        with refusing(FormatError, "plane 3"):
            exact.unpack(wrong, (6, 7), "plane 3")
