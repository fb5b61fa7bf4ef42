"""Numbers that codes, steps and pictures of photos come to, by hand or by an independent computation."""

from __future__ import annotations

import zlib

import numpy as np
import pytest

from tinysplat_runtime.codec import exact
from tinysplat_runtime.codec.base import as_codes
from tinysplat_runtime.errors import FormatError

# ---- codes ----------------------------------------------------------------------------------------------------------


def test_planes_are_two_codes_of_16_bits_and_their_worth() -> None:
    numbers = np.random.default_rng(0).normal(size=(2, 3, 4, 5)) * np.array([1, 100, 0])[:, None, None]
    planes = numbers.astype(np.float32)
    codes, mix = as_codes(planes)
    assert codes.shape == (2, 6, 4, 5) and codes.dtype == np.uint16 and mix.shape == (3, 7)
    back = np.einsum("pc,vchw->vphw", mix[:, :-1], codes.astype(np.float64)) + mix[:, -1][:, None, None]
    span = np.ptp(planes, axis=(0, 2, 3))
    assert (np.abs(back - planes).max(axis=(0, 2, 3)) <= span * 2.0**-32 + 1e-30).all()
    assert codes[:, :2].max() == 65535 and (np.count_nonzero(mix[:, :-1], axis=1) == 2).all()


# ---- lossless planes ------------------------------------------------------------------------------------------------


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


def test_a_plane_s_bytes_are_those_of_the_format() -> None:
    plane = np.random.default_rng(0).normal(size=(6, 7)).astype(np.float16)
    plane[0, 0], plane[2, 3], plane[3, 3] = -0.0, 65504, -65504
    bits = plane.view(np.uint16).astype(int)
    ordered = np.where(bits & 0x8000, 0xFFFF - bits, bits + 0x8000)
    rest = (ordered - naive_prediction(ordered) + 0x8000) % 0x10000 - 0x8000
    folded = np.where(rest < 0, -2 * rest - 1, 2 * rest).ravel()
    octets = bytes((folded & 255).astype(np.uint8)) + bytes((folded >> 8).astype(np.uint8))
    found = exact.pack(plane)
    assert zlib.decompress(found) == octets and found == zlib.compress(octets, 9)
    assert exact.unpack(found, (6, 7), "").tobytes() == plane.tobytes()
    for wrong in (zlib.compress(octets[:-1]), zlib.compress(octets + b"\0"), found + b"\0", found[:-1], b"x"):
        with pytest.raises(FormatError, match=r"^plane 3: (does not come to 84 bytes|zlib: )"):
            exact.unpack(wrong, (6, 7), "plane 3")


@pytest.mark.parametrize(("shape", "value"), [((1, 1), 3.0), ((1, 5), -2.0), ((5, 1), 0.5)])
def test_lines_and_points_are_planes(shape: tuple[int, int], value: float) -> None:
    plane = np.full(shape, value, np.float16)
    assert (exact.unpack(exact.pack(plane), shape, "") == plane).all()
