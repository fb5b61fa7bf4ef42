"""libx265 and libavcodec as a plane codec."""

import subprocess
import sys

import numpy as np
import pytest

from tinysplat_runtime.codec.hevc import PlaneDecoder, encode_plane
from tinysplat_runtime.codec.profiles import EncoderSettings
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.planes import hevc_step

MEDIUM = EncoderSettings("medium")
BY_BLOCK = EncoderSettings("superfast", block_qps=True)


def smooth_codes(height: int, width: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[:height, :width]
    values = 2000 + 900 * np.sin(u / 9) * np.cos(v / 7) + 40 * rng.standard_normal((height, width))
    return np.clip(np.rint(values), 0, 4095).astype(np.uint16)


@pytest.mark.parametrize("size", [(1, 1), (3, 5), (8, 16), (17, 9), (40, 33), (64, 64), (1, 200), (130, 2)])
def test_planes_of_any_size_come_back_within_the_step(size):
    codes = smooth_codes(*size)
    coded = encode_plane(codes, 10, MEDIUM)
    error = np.abs(coded.decoded(*size).astype(int) - codes)
    assert np.sqrt((error**2).mean()) <= 0.5 * hevc_step(10)


@pytest.mark.parametrize(
    "payload",
    [b"", b"\x28", b"\x42\x01\x00", b"\x28\x01\x00\x00\x01\x28\x01", b"\x28\x01" + b"\xff" * 20],
    ids=["empty", "one byte", "a parameter set", "two units", "noise"],
)
def test_payloads_that_are_no_single_slice_are_refused(payload):
    good = encode_plane(smooth_codes(32, 32), 20, MEDIUM)
    with pytest.raises(FormatError):
        PlaneDecoder(good.parameter_sets, 32, 32).decode_into(payload, np.zeros((32, 32), np.uint16))


@pytest.mark.parametrize("offset", [-8, -3, 0, 5, 8])
def test_blocks_are_coded_as_finely_as_their_offsets_say(offset):
    """As a whole picture of that QP is, whatever the others have."""
    codes = smooth_codes(70, 90, 3)  # no whole number of blocks
    offsets = np.zeros((5, 6), np.int8)
    offsets[1:, 2:4] = offsets[:2, 5] = offset
    plain, whole, mixed = (
        encode_plane(codes, qp, BY_BLOCK, o) for qp, o in ((20, None), (20 + offset, None), (20, offsets))
    )
    assert mixed.parameter_sets == plain.parameter_sets
    before, wanted, found = (each.decoded(70, 90).astype(np.float64) - codes for each in (plain, whole, mixed))
    for rows, columns in ((slice(16, 70), slice(32, 64)), (slice(0, 32), slice(80, 90))):
        assert found[rows, columns].std() == pytest.approx(wanted[rows, columns].std(), rel=0.15)
    assert found[:, :32].std() == pytest.approx(before[:, :32].std(), rel=0.1)


@pytest.mark.parametrize("free_mb", [4, 40, 90])
def test_memory_that_libx265_would_end_the_process_without_is_an_error(free_mb: int) -> None:
    """In a process that may take hardly more addresses than it has."""
    code = f"""
import resource
import numpy as np
from tinysplat_runtime.codec.hevc import encode_plane
from tinysplat_runtime.codec.profiles import EncoderSettings
codes = np.zeros((64, 64), np.uint16)
held = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (held + {free_mb}_000_000, resource.RLIM_INFINITY))
try:
    encode_plane(codes, 20, EncoderSettings("fast"))
except MemoryError:
    print("not enough")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stdout) == (0, "not enough\n"), done.stderr
