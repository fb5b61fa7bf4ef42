"""The stand-in for the video codec: what it rounds away, and how near it comes to what libx265 does."""

from __future__ import annotations

import numpy as np
import pytest

from tinysplat_runtime.codec.depth_step.blocks import SIDE, BlockSpectrum
from tinysplat_runtime.codec.hevc import PlaneDecoder, encode_plane
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.codec.quantise import choose_code_map


def _waves(amplitude: float) -> np.ndarray:
    """(1, 16, 24) of one basis function of the DCT in every block: coefficients of that amplitude."""
    along = np.cos(np.pi * (2 * np.arange(SIDE) + 1) * 3 / (2 * SIDE)) / 2  # frequency 3, of length 1
    flat = np.full(SIDE, 1 / np.sqrt(SIDE))
    return np.tile(amplitude * np.outer(flat, along), (2, 3))[None].astype(np.float32)


@pytest.mark.parametrize(("levels", "kept"), [(0.6, 0), (0.7, 1), (1.6, 1), (1.7, 2), (-0.6, 0), (-1.7, -2)])
def test_coefficients_are_rounded_up_from_two_thirds_of_a_step(levels, kept):
    step = 0.05
    error = BlockSpectrum.of(_waves(levels * step)).coding_error(step)
    np.testing.assert_allclose(error, _waves((kept - levels) * step), atol=1e-7)


@pytest.mark.parametrize("profile", ["fast", "balanced"])
@pytest.mark.parametrize("level", [0.3, 1.0, 3.0])
def test_errors_are_about_as_large_as_those_of_the_video_codec(profile, level):
    """A plane of natural spectrum, at steps of a third, one and three times what it is at most of its frequencies."""
    rng = np.random.default_rng(0)
    frequency = np.hypot(np.fft.fftfreq(96)[:, None], np.fft.rfftfreq(128))
    spectrum = np.fft.rfft2(rng.standard_normal((96, 128))) / np.maximum(frequency, 1 / 128) ** 1.2
    values = np.fft.irfft2(spectrum).astype(np.float32)
    values /= values.std()
    code_map = choose_code_map(float(values.min()), float(values.max()), float(values.mean()), 0.1 * level)
    coded = encode_plane(code_map.quantise(values)[0], code_map.qp, PROFILES[profile].encoder)
    decoded = np.empty(values.shape, np.uint16)
    PlaneDecoder(coded.parameter_sets, *values.shape).decode_into(coded.payload, decoded)
    found = BlockSpectrum.of(values[None]).coding_error(code_map.step)
    ratio = np.sqrt(np.square(found).mean() / np.square(code_map.dequantise(decoded) - values).mean())
    assert 1.0 < ratio < 1.3  # an intra coder predicts, and chooses what it rounds away
