"""Laws of whole objects: captures and clouds of any shape, written, read, cut, damaged and described."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import assert_same, make_list, make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians

PROFILE = st.sampled_from(sorted(PROFILES))
DEGREE = st.integers(0, 4)
ORIGIN = st.one_of(st.just(np.zeros(3)), st.tuples(*[st.floats(-1e6, 1e6)] * 3).map(np.array))
NOTES = st.sampled_from([ts.Notes(), ts.Notes("metre", "Jo Döe", "CC0-1.0"), ts.Notes(antialiased="yes")])


@st.composite
def captures(draw: st.DrawFn, views: int = 8, side: int = 24) -> Gaussians:
    """Gaussians per pixel of one view to many, of one pixel to few, of any degree, layers, place and notes."""
    made = make_smooth_gaussians(
        draw(st.integers(1, views)),
        draw(st.integers(1, side)),
        draw(st.integers(1, side)),
        draw(DEGREE),
        seed=draw(st.integers(0, 99)),
        layers=draw(st.integers(1, 3)),
        origin=draw(ORIGIN),
    )
    opacity = draw(st.sampled_from([None, 0.0, 1.0]))
    if opacity is not None:
        made = replace(made, opacities=np.full_like(made.opacities, opacity))
    return made.with_notes(draw(NOTES))


@st.composite
def clouds(draw: st.DrawFn, most: int = 200) -> Gaussians:
    """Gaussians of no pixels, one to many, tiny to huge, some alike."""
    count, size = draw(st.integers(1, most)), 10.0 ** draw(st.integers(-3, 3))
    made = make_list(count, draw(DEGREE), np.random.default_rng(draw(st.integers(0, 99))), size)
    rows = np.arange(count) if draw(st.booleans()) else np.zeros(count, int)
    fields = {name: getattr(made, name)[rows] for name in FIELDS}
    fields["scales"] = size * fields["scales"]
    return Gaussians(**fields, origin=draw(ORIGIN)).with_notes(draw(NOTES))


@given(g=st.one_of(captures(), clouds()), suffix=st.sampled_from([".npz", ".safetensors"]))
def test_what_is_saved_is_what_is_loaded(g, suffix):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"g{suffix}"
        assert ts.save_gaussians(path, g) == []
        assert_same(ts.load_gaussians(path), g)


@given(g=captures(views=3, side=40), profile=PROFILE)
def test_a_capture_comes_back_with_its_shape_and_place_and_bounded_error(g, profile):
    decoded = ts.decompress(ts.compress(g, profile))
    assert decoded.notes == g.notes
    np.testing.assert_array_equal(decoded.origin, g.origin)
    for layer, wanted in zip(decoded.layers, g.layers, strict=True):
        assert layer.opacities.shape == wanted.opacities.shape
        for own, its in zip(layer.cameras, wanted.cameras, strict=True):
            np.testing.assert_array_equal(own.c2w, its.c2w)
            np.testing.assert_array_equal(own.K, its.K)
        assert all(np.isfinite(getattr(layer, name)).all() for name in FIELDS)
        np.testing.assert_allclose(np.linalg.norm(layer.quats, axis=-1), 1, atol=1e-5)
        assert layer.opacities.min() >= 0 and layer.opacities.max() <= 1 and layer.scales.min() >= 0
        # Depths between 2 and 4 move by far less than their spread; offsets by less than a pixel's footprint or two.
        error = np.linalg.norm(layer.means - wanted.means, axis=-1)
        footprint = 4 / min(camera.focal for camera in wanted.cameras)
        assert np.sqrt((error**2).mean()) <= 0.2 + footprint


@given(g=clouds(), qp=st.sampled_from([-12.0, 0.0, 12.0]))
def test_a_cloud_comes_back_whole_in_its_place(g, qp):
    g = replace(g, opacities=np.maximum(g.opacities, np.float32(0.02)))
    decoded = ts.decompress(ts.Runtime(threads=1).compress(g, qp=qp, keep_all=True))
    assert (decoded.count, decoded.degree, decoded.notes) == (g.count, g.degree, g.notes)
    np.testing.assert_array_equal(decoded.origin, g.origin)
    size = max(float(np.ptp(g.means, axis=0).max()), float(np.abs(g.means).max()))
    np.testing.assert_allclose(np.sort(decoded.means, axis=0), np.sort(g.means, axis=0), atol=0.3 * size)


@given(g=captures(), data=st.data())
@settings(max_examples=8)
def test_lossless_files_are_settled_and_some_views_are_those_of_the_whole(g, data):
    for options in ({"lossless": True}, {"profile": "fast"}):
        file = ts.compress(g, **options)
        whole = ts.decompress(file)
        count = len(g.cameras)
        views = data.draw(st.lists(st.integers(0, count - 1), min_size=1, max_size=count, unique=True))
        assert_same(ts.decompress(file, views=views), whole, views)
        if "lossless" in options:
            assert ts.compress(whole, lossless=True) == file


@given(g=st.one_of(captures(), clouds()), data=st.data())
@settings(max_examples=20)
def test_files_are_as_large_as_they_say_and_no_damage_passes(g, data):
    g = replace(g, opacities=np.maximum(g.opacities, np.float32(0.02)))
    file = ts.Runtime(threads=1).compress(g, "fast", keep_all=True)
    described = ts.inspect(file)
    assert described["bytes"] == len(file)
    assert described["metadata_bytes"] + sum(described["bytes_by_class"].values()) == len(file)
    cut = data.draw(st.integers(0, len(file) - 1))
    bit = data.draw(st.integers(8 * 16, 8 * len(file) - 1))
    flipped = bytearray(file)
    flipped[bit // 8] ^= 1 << bit % 8
    for damaged in (file[:cut], bytes(flipped), file + b"\0"):
        with pytest.raises(FormatError):
            ts.decompress(damaged)


@given(g=captures(views=3), profile=PROFILE)
@settings(max_examples=8)
def test_coding_is_a_function_of_its_input(g, profile):
    one, four = ts.Runtime(threads=1), ts.Runtime(threads=4)
    file = one.compress(g, profile)
    assert file == four.compress(g, profile) == one.compress(g, profile)
    assert_same(four.decompress(file), one.decompress(file))
