"""The stand-in for the video codec: what it rounds away, and how near it comes to what libx265 does."""

from __future__ import annotations

import numpy as np
import pytest

from tinysplat_runtime.codec.depth_step.blocks import BlockSpectrum
from tinysplat_runtime.codec.hevc import PlaneDecoder, encode_plane
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.codec.quantise import choose_code_map


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
