"""`.splat` and `.ksplat`: records made by hand and by gaussforge, another implementation."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from formats.foreign import foreign_bytes, on_order_of
from scenes import make_gaussians, refused, refusing, tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats


def some(degree: int) -> Gaussians:
    made = make_gaussians(height=20, width=20, degree=degree).flat()
    return Gaussians(made.means, made.quats, made.scales, made.opacities.clip(0.02, 0.98), 0.3 * made.sh)


def test_records_of_a_splat_by_hand(tmp_path: Path) -> None:
    record = struct.pack("<6f8B", 1, 2, 3, 0.1, 0.2, 0.3, 255, 128, 0, 51, 128, 192, 128, 128)
    (tmp_path / "a.splat").write_bytes(record * 2)
    read = load_gaussians(tmp_path / "a.splat")
    np.testing.assert_allclose(read.means, [[1, 2, 3]] * 2)
    np.testing.assert_allclose(read.scales, [[0.1, 0.2, 0.3]] * 2, rtol=1e-6)
    np.testing.assert_allclose(read.opacities, [0.2, 0.2], rtol=1e-6)
    np.testing.assert_allclose(normalize_quats(read.quats), [[0, 1, 0, 0]] * 2)
    np.testing.assert_allclose(0.5 + 0.28209479177387814 * read.sh[:, 0], [[1, 128 / 255, 0]] * 2, atol=1e-6)


@pytest.mark.parametrize(("kind", "degree"), [("splat", 0), ("ksplat", 0), ("ksplat", 2)])
def test_we_read_what_another_implementation_writes(tmp_path: Path, kind: str, degree: int) -> None:
    made = some(degree)
    (tmp_path / f"a.{kind}").write_bytes(foreign_bytes(made, kind))
    read = load_gaussians(tmp_path / f"a.{kind}")
    assert read.degree == degree  # its layout of higher coefficients is another than the format's: see below
    made = on_order_of(made, read)
    np.testing.assert_allclose(read.means, made.means, atol=2e-4)
    np.testing.assert_allclose(read.scales, made.scales, rtol=1e-3)
    np.testing.assert_allclose(read.opacities, made.opacities, atol=1.01 / 255)
    np.testing.assert_allclose(read.sh[:, 0], made.sh[:, 0], atol=1.01 / 255 / 0.28)
    dots = np.abs((normalize_quats(read.quats) * normalize_quats(made.quats)).sum(axis=-1))
    assert np.arccos(dots.clip(0, 1)).max() < 0.02


def ksplat(sections: int = 1, count: int = 1, room: int = 1, mode: int = 0, version: int = 1, degree: int = 0) -> bytes:
    header = bytearray(4096)
    struct.pack_into("<2B2xI", header, 0, 0, version, sections)
    struct.pack_into("<IH", header, 16, count, mode)
    section = bytearray(1024)
    struct.pack_into("<4I", section, 0, count, room, 256, 0)
    struct.pack_into("<H", section, 40, degree)
    record = struct.pack("<10f4B", 1, 2, 3, 0.1, 0.2, 0.3, 1, 0, 0, 0, 255, 0, 0, 255)
    record += struct.pack("<24f", *range(24))[: {1: 36, 2: 96}.get(degree, 0)]
    return bytes(header + section) + record


def test_a_ksplat_by_hand_whose_higher_coefficients_lie_band_by_band_and_channel_by_channel(tmp_path: Path) -> None:
    (tmp_path / "a.ksplat").write_bytes(ksplat(degree=2))
    read = load_gaussians(tmp_path / "a.ksplat")
    np.testing.assert_allclose(read.means, [[1, 2, 3]])
    np.testing.assert_allclose(read.scales, [[0.1, 0.2, 0.3]], rtol=1e-6)
    sh = read.sh[0]
    np.testing.assert_array_equal(sh[1:4], np.arange(9).reshape(3, 3).T)
    np.testing.assert_array_equal(sh[4:9], np.arange(9, 24).reshape(3, 5).T)


def bucketed(mode: int, capacity: int = 2, sh_range: tuple[float, float] = (0.0, 0.0)) -> bytes:
    """Two sections of mode 1 or 2: three Gaussians in a full bucket and one of a single Gaussian, then one in one."""
    header = bytearray(4096)
    struct.pack_into("<2B2xI", header, 0, 0, 1, 2)
    struct.pack_into("<IH", header, 16, 4, mode)
    struct.pack_into("<2f", header, 36, *sh_range)
    sections, bodies = b"", b""
    for count, room, full, steps, degree in ((3, 4, 1, 100, 1), (1, 1, 0, 0, 0)):
        section = bytearray(1024)
        struct.pack_into("<4IfHxxI", section, 0, count, room, capacity, full + 1, 0.5, 16, steps)
        struct.pack_into("<2IH", section, 32, full, 1, degree)
        sections += section
        bodies += struct.pack("<I", 1)  # Gaussians of the one bucket that is not full
        bodies += b"".join(struct.pack("<3f4x", 10 * n, 20 + n, -30) for n in range(full + 1))
        for n in range(room):
            bodies += struct.pack("<3H", (steps or 32767) + 10 * n, 0, 2 * (steps or 32767))
            bodies += struct.pack("<7e4B", 0.125, 0.25, 0.5, 0, 1, 0, 0, 255, 128, 0, 51)
            bodies += struct.pack("<9e", *range(9)) if degree and mode == 1 else bytes(range(0, 252, 28)) * degree
    return bytes(header) + sections + bodies


@pytest.mark.parametrize("mode", [1, 2])
def test_buckets_of_a_ksplat_by_hand(tmp_path: Path, mode: int) -> None:
    """A position is its bucket's centre, and of half a bucket's side as many parts as the section states or 32767."""
    (tmp_path / "a.ksplat").write_bytes(bucketed(mode, sh_range=(-2.0, 3.0)))
    read = load_gaussians(tmp_path / "a.ksplat")
    of_100, least, most = 0.25 * 10 / 100, -0.25, 0.25
    wanted = [
        [0, 20 + least, -30 + most],
        [of_100, 20 + least, -30 + most],
        [10 + 2 * of_100, 21 + least, -30 + most],
        [0, 20 + least, -30 + most],
    ]
    np.testing.assert_allclose(read.means, wanted, rtol=1e-6)
    np.testing.assert_allclose(read.scales, [[0.125, 0.25, 0.5]] * 4)
    np.testing.assert_allclose(read.quats, [[0, 1, 0, 0]] * 4)
    np.testing.assert_allclose(read.opacities, [0.2] * 4, rtol=1e-6)
    np.testing.assert_allclose(0.5 + 0.28209479177387814 * read.sh[:, 0], [[1, 128 / 255, 0]] * 4, atol=1e-6)
    higher = np.arange(9) if mode == 1 else np.arange(9) * 28 / 255 * 5 - 2
    np.testing.assert_allclose(read.sh[:3, 1:], [higher.reshape(3, 3).T] * 3, atol=1e-6)
    assert not read.sh[3, 1:].any()


def test_a_ksplat_of_mode_2_that_states_no_range_has_that_of_its_maker(tmp_path: Path) -> None:
    (tmp_path / "a.ksplat").write_bytes(bucketed(2))
    higher = load_gaussians(tmp_path / "a.ksplat").sh[0, 1:].T.ravel()
    np.testing.assert_allclose(higher, np.arange(9) * 28 / 255 * 3 - 1.5, atol=1e-6)


@pytest.mark.parametrize(("field", "name"), [(3, "scales"), (10 + 1, "sh")])
def test_a_signalling_nan_is_refused_without_a_warning(tmp_path: Path, field: int, name: str) -> None:
    """numpy warns where such a number turns into a longer one."""
    data = bytearray(ksplat(degree=1))
    struct.pack_into("<I", data, 4096 + 1024 + 4 * field, 0x7FA00000)
    (tmp_path / "a.ksplat").write_bytes(data)
    with refusing(InputError, name):
        load_gaussians(tmp_path / "a.ksplat")


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.splat", bytes(33), "multiple of 32"),
        ("a.splat", b"", ""),
        ("a.ksplat", bytes(10), ""),
        ("a.ksplat", ksplat(version=0), "0"),
        ("a.ksplat", ksplat(mode=3), "3"),
        ("a.ksplat", ksplat(sections=4000), ""),
        ("a.ksplat", ksplat(count=2), ""),
        ("a.ksplat", ksplat(room=1 << 31), ""),
        ("a.ksplat", ksplat(degree=9), "degree 9"),
        ("a.ksplat", ksplat(mode=1), ""),
        ("a.ksplat", bucketed(1, capacity=1), ""),
        ("a.ksplat", bucketed(1)[:-1], ""),
        ("a.ksplat", ksplat(sections=0), ""),
    ],
)
def test_what_a_file_may_not_say_is_refused_by_name(tmp_path: Path, name: str, data: bytes, words: str) -> None:
    (tmp_path / name).write_bytes(data)
    assert tells(refused(load_gaussians, tmp_path / name), words)
