"""`--lossless`: planes come back bit for bit, as the bytes that docs/FORMAT.md has, and nothing else is accepted."""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scenes import agree, make_smooth_gaussians, refusing
from sections import repacked

import tinysplat_runtime as ts
from tinysplat_runtime.codec.exact import decode_exact, exact_planes, pack, unpack
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError, NumericError
from tinysplat_runtime.graphs.inference import GraphStore
from tinysplat_runtime.system.threads import Crew


@pytest.fixture(scope="module")
def gaussians():
    return make_smooth_gaussians(2, 19, 26, degree=2, layers=2)


@pytest.fixture(scope="module")
def data(gaussians):
    return ts.compress(gaussians, lossless=True)


def test_planes_come_back_bit_for_bit(gaussians, data):
    container = read_container(data)
    for layer, exact in zip(gaussians.layers, container.body.layers, strict=True):
        planes, _ = exact_planes(GraphStore(), layer, drop_invalid=False, where="")
        geometry, sh = decode_exact(exact, Crew(2))
        assert (geometry[:, 1:] == planes[:, 2:12].astype(np.float64)).all()
        assert (geometry[:, 0] == planes[:, 0].astype(np.float64) + planes[:, 1]).all()
        assert (sh == np.moveaxis(planes[:, 12:], 1, -1).reshape(sh.shape)).all()


def test_gaussians_differ_by_no_more_than_float16_rounds(gaussians, data):
    for a, b in zip(gaussians.layers, ts.decompress(data).layers, strict=True):
        np.testing.assert_allclose(b.means, a.means, atol=2e-3)
        np.testing.assert_allclose(b.scales, a.scales, rtol=2e-3)
        np.testing.assert_allclose(b.opacities, a.opacities, atol=5e-4)
        assert (b.sh == a.sh.astype(np.float16)).all()
        depth = [np.linalg.norm(layer.means[0] - layer.cameras[0].centre, axis=-1) for layer in (a, b)]
        np.testing.assert_allclose(depth[1], depth[0], rtol=2e-4)


@pytest.mark.parametrize("fault", [{"means": 2.0**25}, {"sh": 1e6}], ids=["depths that round to nothing", "colours"])
def test_values_beyond_float16_are_refused(fault):
    g = make_smooth_gaussians(1, 4, 4)
    with pytest.raises(NumericError):
        ts.compress(replace(g, **{name: factor * getattr(g, name) for name, factor in fault.items()}), lossless=True)


@pytest.mark.parametrize(
    "change",
    [
        lambda payload: zlib.compress(b"\0" * 10),
        lambda payload: zlib.compress(b"\0" * 100_000),
        lambda payload: payload + b"\0",
        lambda payload: payload[:-1],
        lambda payload: b"",
        lambda payload: zlib.compress(zlib.decompress(payload)[::-1]),
    ],
    ids=["too short", "a bomb", "bytes behind", "cut", "empty", "other planes"],
)
def test_planes_that_are_not_those_written_are_format_errors(data, change):
    with pytest.raises(FormatError):
        ts.decompress(repacked(data, change=change))


def test_the_depth_limits_of_a_lossless_file_are_its_gaussians(gaussians, data):
    for layer, exact in zip(gaussians.layers, read_container(data).body.layers, strict=True):
        pairs = zip(layer.means.astype(np.float64), layer.cameras or gaussians.cameras, strict=True)
        z = np.stack([(means - c.centre + layer.origin) @ c.c2w[:3, 2] for means, c in pairs])
        np.testing.assert_allclose(exact.depth_limits, (z.min(), z.max()), rtol=1e-5)


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

    agree(lambda plane: list(zlib.decompress(pack(plane))), plain, PLANES)
    agree(lambda plane: unpack(pack(plane), plane.shape, "").view("u2"), lambda p: p.view("u2"), PLANES)
    plane = np.random.default_rng(0).normal(size=(6, 7)).astype(np.float16)
    octets = octets_of(plane)
    found = pack(plane)
    for wrong in (zlib.compress(octets[:-1]), zlib.compress(octets + b"\0"), found + b"\0", found[:-1], b"x"):
        with refusing(FormatError, "plane 3"):
            unpack(wrong, (6, 7), "plane 3")
