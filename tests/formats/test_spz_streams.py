"""The framing of SPZ files, by hand: widths of blocks, headers on either side of their bounds, extensions, flags."""

from __future__ import annotations

import gzip
import io
import struct
from pathlib import Path

import numpy as np
import pytest

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.spz_streams import SpzHeader, is_antialiased, pack_blocks, read_blocks

LARGE = 1 << 30


def header(version: int = 3, count: int = 2, degree: int = 0, bits: int = 12, flags: int = 0) -> bytes:
    return struct.pack("<IIIBBBB", 0x5053474E, version, count, degree, bits, flags, 0)


def file(body: bytes = b"", **fields: int) -> bytes:
    return gzip.compress(header(**fields) + body)


@pytest.mark.parametrize(
    ("version", "degree", "widths"),
    [
        (1, 0, (6, 1, 3, 3, 3, 0)), (2, 1, (9, 1, 3, 3, 3, 9)), (3, 2, (9, 1, 3, 3, 4, 24)),
        (3, 3, (9, 1, 3, 3, 4, 45)),
        (4, 4, (9, 1, 3, 3, 4, 72)),
    ],
)  # fmt: skip
def test_blocks_are_as_wide_as_their_version_has_them(version: int, degree: int, widths: tuple[int, ...]) -> None:
    assert SpzHeader(version, 5, degree, 12).widths == widths
    body = bytes(n % 251 for n in range(2 * sum(widths)))
    if version < 4:
        found, blocks = read_blocks(io.BytesIO(file(body, version=version, degree=degree)), LARGE)
        assert found == SpzHeader(version, 2, degree, 12, False)
        assert b"".join(block.tobytes() for block in blocks) == body
        assert tuple(block.shape for block in blocks) == tuple((2, width) for width in widths)
        with pytest.raises(InputError, match="cut short: announces 2 points"):
            read_blocks(io.BytesIO(file(body[:-1], version=version, degree=degree)), LARGE)


@pytest.mark.parametrize(
    ("accepted", "refused", "words"),
    [
        ({"version": 1}, {"version": 0}, "SPZ version 0, accepted are 1 to 4"),
        ({"version": 3}, {"version": 5}, "SPZ version 5, accepted are 1 to 4"),
        ({"count": 1}, {"count": 0}, "damaged header: 0 points of SH degree 0, 12 fractional bits"),
        ({"degree": 4}, {"degree": 5}, "damaged header: 2 points of SH degree 5, 12 fractional bits"),
        ({"bits": 30}, {"bits": 31}, "damaged header: 2 points of SH degree 0, 31 fractional bits"),
        ({"bits": 0}, {"version": 4}, "SPZ version 4 in a gzip stream, which ends with version 3"),
    ],
)
def test_headers_are_accepted_to_their_bounds_and_no_further(accepted, refused, words: str) -> None:
    found, _ = read_blocks(io.BytesIO(file(bytes(1000), **accepted)), LARGE)
    assert {name: getattr(found, {"bits": "fractional_bits"}.get(name, name)) for name in accepted} == accepted
    with pytest.raises(InputError, match=words):
        read_blocks(io.BytesIO(file(bytes(1000), **refused)), LARGE)


def blocks_of(degree: int, version: int) -> list[np.ndarray]:
    rng = np.random.default_rng(degree)
    return [rng.integers(0, 256, (3, width)).astype(np.uint8) for width in SpzHeader(version, 3, degree, 7).widths]


@pytest.mark.parametrize("version", [2, 3, 4])
@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("degree", [0, 2])
def test_blocks_and_flags_come_back_of_every_version(
    tmp_path: Path, version: int, antialiased: bool, degree: int
) -> None:
    wanted, blocks = SpzHeader(version, 3, degree, 7, antialiased), blocks_of(degree, version)
    data = pack_blocks(wanted, blocks)
    assert data == pack_blocks(wanted, blocks)
    plain = data if version == 4 else gzip.decompress(data)
    assert plain[:16] == struct.pack(
        "<IIIBBBB", 0x5053474E, version, 3, degree, 7, int(antialiased), (6 if degree else 5) * (version == 4)
    )
    found, read = read_blocks(io.BytesIO(data), LARGE)
    assert found == wanted
    for one, other in zip(read, blocks, strict=True):
        np.testing.assert_array_equal(one, other)
    (tmp_path / "a.spz").write_bytes(data)
    assert is_antialiased(tmp_path / "a.spz") is antialiased


def extended(*records: tuple[int, bytes], flags: int = 2) -> bytes:
    """A file of version 4 with extension records behind its header."""
    data = pack_blocks(SpzHeader(4, 3, 0, 7), blocks_of(0, 4))
    more = b"".join(struct.pack("<II", kind, len(payload)) + payload for kind, payload in records)
    return data[:14] + bytes([flags, 5]) + struct.pack("<I", 32 + len(more)) + bytes(12) + more + data[32:]


AXES = 0xADBE0003


@pytest.mark.parametrize("axes", [1, 2, 3, 5, 8])
def test_other_axes_are_refused_wherever_they_stand(axes: int) -> None:
    for records in (
        [(AXES, bytes([axes]))],
        [(7, b"12345"), (AXES, bytes([axes, 0]))],
        [(AXES, b"\4"), (AXES, bytes([axes]))],
    ):
        with pytest.raises(
            InputError, match=rf"coordinate system {axes} of an extension, accepted is 4 \(right, up, back\)"
        ):
            read_blocks(io.BytesIO(extended(*records)), LARGE)
        assert read_blocks(io.BytesIO(extended(*records, flags=1)), LARGE)[0].antialiased


def test_a_table_lies_behind_the_header_and_says_what_streams_come_to() -> None:
    data = bytearray(pack_blocks(SpzHeader(4, 3, 0, 7), blocks_of(0, 4)))
    first = struct.unpack_from("<QQ", data, 32)
    assert first[1] == 27 and len(data) == 32 + 5 * 16 + sum(
        struct.unpack_from("<QQ", data, 32 + 16 * n)[0] for n in range(5)
    )
    for at, value, words in (
        (40, 28, f"stream 0 of {first[0]} bytes for 28, expected 27: cut short"), (40, 26, "for 26, expected 27"),
        (15, 4, f"4 streams with a table at byte 32 of {len(data)}, expected 5"),
        (16, 31, "5 streams with a table at byte 31"),
        (16, len(data) - 79, f"with a table at byte {len(data) - 79} of {len(data)}"),
    ):  # fmt: skip
        changed = bytearray(data)
        changed[at] = value % 256
        with pytest.raises(InputError, match=words):
            read_blocks(io.BytesIO(bytes(changed)), LARGE)
    with pytest.raises(InputError, match="2 bytes behind its last stream"):
        read_blocks(io.BytesIO(bytes(data) + b"ab"), LARGE)
    with pytest.raises(InputError, match="cut short in its header"):
        read_blocks(io.BytesIO(bytes(data)[:31]), LARGE)
    with pytest.raises(InputError, match="SPZ version 3 outside a gzip stream, where version 4 begins"):
        read_blocks(io.BytesIO(bytes(data[:4]) + b"\3" + bytes(data[5:])), LARGE)
    with pytest.raises(InputError, match=r"stream 4 of .* cut short"):
        read_blocks(io.BytesIO(bytes(data)[:-1]), LARGE)
