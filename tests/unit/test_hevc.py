"""libx265 and libavcodec as a plane codec."""

from __future__ import annotations

import numpy as np
import pytest

from tinysplat_runtime.codec.hevc import EncoderSettings, PlaneDecoder, encode_plane
from tinysplat_runtime.codec.planes import pad_plane, padded_size
from tinysplat_runtime.codec.quantize import hevc_step
from tinysplat_runtime.errors import FormatError

MEDIUM = EncoderSettings("medium")


def smooth_codes(height: int, width: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[:height, :width]
    values = 2000 + 900 * np.sin(u / 9) * np.cos(v / 7) + 40 * rng.standard_normal((height, width))
    return np.clip(np.rint(values), 0, 4095).astype(np.uint16)


@pytest.mark.parametrize("size", [(1, 1), (3, 5), (8, 16), (17, 9), (40, 33), (64, 64), (1, 200), (130, 2)])
def test_planes_of_any_size_come_back_within_the_step(size):
    codes = smooth_codes(*size)
    coded = encode_plane(codes, 10, MEDIUM)
    out = np.zeros(size, np.uint16)
    PlaneDecoder(coded.parameter_sets, *size).decode_into(coded.payload, out)
    error = np.abs(out.astype(int) - codes)
    assert np.sqrt((error**2).mean()) <= 0.5 * hevc_step(10)


def test_padding_repeats_the_last_row_and_column():
    codes = smooth_codes(5, 18)
    padded = pad_plane(codes)
    assert padded.shape == padded_size(5, 18) == (16, 24)
    assert (padded[:5, :18] == codes).all()
    assert (padded[5:, :18] == codes[-1]).all() and (padded[:5, 18:] == codes[:, -1:]).all()


def test_parameter_sets_depend_on_the_size_and_settings_alone():
    planes = [encode_plane(smooth_codes(32, 48, seed), qp, MEDIUM) for seed, qp in ((0, 0), (1, 24), (2, 51))]
    sets = {plane.parameter_sets for plane in planes}
    assert len(sets) == 1


def test_streams_carry_no_banner():
    coded = encode_plane(smooth_codes(32, 32), 20, MEDIUM)
    assert b"x265" not in coded.payload + coded.parameter_sets


def test_the_same_plane_gives_the_same_bytes():
    codes = smooth_codes(48, 48)
    assert encode_plane(codes, 12, MEDIUM) == encode_plane(codes, 12, MEDIUM)


def test_one_decoder_serves_planes_of_all_qps():
    planes = [smooth_codes(32, 32, seed) for seed in range(4)]
    coded = [encode_plane(codes, qp, MEDIUM) for codes, qp in zip(planes, (0, 8, 16, 24), strict=True)]
    shared = PlaneDecoder(coded[0].parameter_sets, 32, 32)
    for plane in coded:
        alone, together = np.zeros((2, 32, 32), np.uint16)
        shared.decode_into(plane.payload, together)
        PlaneDecoder(plane.parameter_sets, 32, 32).decode_into(plane.payload, alone)
        assert (alone == together).all()


def test_a_stream_of_another_size_is_refused_before_it_is_decoded():
    big = encode_plane(smooth_codes(256, 256), 20, MEDIUM)
    decoder = PlaneDecoder(big.parameter_sets, 32, 32)
    with pytest.raises(FormatError):
        decoder.decode_into(big.payload, np.zeros((32, 32), np.uint16))


@pytest.mark.parametrize(
    "payload",
    [b"", b"\x28", b"\x42\x01\x00", b"\x28\x01\x00\x00\x01\x28\x01", b"\x28\x01" + b"\xff" * 20],
    ids=["empty", "one byte", "a parameter set", "two units", "noise"],
)
def test_payloads_that_are_no_single_slice_are_refused(payload):
    good = encode_plane(smooth_codes(32, 32), 20, MEDIUM)
    with pytest.raises(FormatError):
        PlaneDecoder(good.parameter_sets, 32, 32).decode_into(payload, np.zeros((32, 32), np.uint16))
