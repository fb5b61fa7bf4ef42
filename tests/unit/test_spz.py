"""SPZ files: what gaussforge, built on the format's own library, reads and writes is what we mean."""

from __future__ import annotations

import gzip
import struct
from pathlib import Path

import numpy as np
import pytest
from foreign import foreign_bytes, foreign_model
from numpy.typing import NDArray
from scenes import make_gaussians

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats
from tinysplat_runtime.gaussian.sh import sh_basis

TURN = np.array([1.0, -1.0, -1.0])  # SPZ has y up and z backward


def some(degree: int = 3) -> Gaussians:
    made = make_gaussians(degree=degree).flat()
    return Gaussians(made.means, made.quats, made.scales, made.opacities.clip(0.02, 0.98), made.sh)


def same_rotations(a: NDArray, b: NDArray, tolerance: float) -> bool:
    dots = np.abs((normalize_quats(a) * normalize_quats(b)).sum(axis=-1))
    return bool((dots > np.cos(tolerance / 2)).all())


@pytest.mark.parametrize(("version", "degree"), [(2, 3), (3, 1), (3, 2), (3, 3), (4, 1), (4, 3)])
def test_the_format_s_own_library_reads_what_we_write(tmp_path: Path, version: int, degree: int) -> None:
    gaussians = some(degree)
    assert save_gaussians(tmp_path / "g.spz", gaussians, sh_bits=(8, 8), spz_version=version) == []
    found = foreign_model((tmp_path / "g.spz").read_bytes(), "spz")
    np.testing.assert_allclose(found["positions"] * TURN, gaussians.means, atol=1e-5)
    np.testing.assert_allclose(found["scales"], np.log(gaussians.scales), atol=1 / 32 + 1e-5)
    np.testing.assert_allclose(1 / (1 + np.exp(-found["alphas"][:, 0])), gaussians.opacities, atol=0.5 / 255 + 1e-5)
    assert same_rotations(found["rotations"] * np.array([1, *TURN]), gaussians.quats, 0.3 if version == 2 else 0.01)
    direction = np.array([[0.6, -0.48, 0.64]])
    seen = sh_basis(direction * TURN, degree) @ found["sh"]  # a colour, looked at in SPZ's axes
    np.testing.assert_allclose(seen, sh_basis(direction, degree) @ gaussians.sh, atol=0.03)


@pytest.mark.parametrize("version", [2, 3, 4])
def test_files_of_the_format_s_own_library_are_read(tmp_path: Path, version: int) -> None:
    gaussians = some(3)
    (tmp_path / "g.spz").write_bytes(foreign_bytes(gaussians, "spz", spz_version=version))
    loaded = load_gaussians(tmp_path / "g.spz")
    np.testing.assert_allclose(loaded.means * TURN, gaussians.means, atol=2.0**-12)
    np.testing.assert_allclose(np.log(loaded.scales), np.log(gaussians.scales), atol=1 / 32 + 1e-5)
    assert same_rotations(loaded.quats * np.array([1, *TURN]), gaussians.quats, 0.3 if version == 2 else 0.01)
    np.testing.assert_allclose(loaded.sh[:, 0], gaussians.sh[:, 0], atol=0.5 / 255 / 0.15 + 1e-5)


@pytest.mark.parametrize("version", [2, 3, 4])
@pytest.mark.parametrize("degree", [0, 3, 4])
def test_every_version_reads_back_as_the_others_do(tmp_path: Path, version: int, degree: int) -> None:
    gaussians = some(degree)
    save_gaussians(tmp_path / "3.spz", gaussians)
    save_gaussians(tmp_path / "g.spz", gaussians, spz_version=version)
    loaded, usual = load_gaussians(tmp_path / "g.spz"), load_gaussians(tmp_path / "3.spz")
    assert loaded.degree == (degree if version == 4 else min(degree, 3))
    for name in ("means", "scales", "opacities"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(usual, name))
    np.testing.assert_array_equal(loaded.sh[:, : usual.sh.shape[1]], usual.sh)
    assert same_rotations(loaded.quats, gaussians.quats, 0.3 if version == 2 else 0.01)


def test_version_1_has_positions_of_16_bits(tmp_path: Path) -> None:
    """Written by hand from the library's reader: float16 positions, the rest as in version 2."""
    positions = np.array([[0.5, -1.25, 3.0], [100.0, 0.125, -2.0]], "<f2")
    body = positions.tobytes() + bytes([255, 0]) + bytes([128] * 6) + bytes([96] * 6) + bytes([128] * 6)
    data = struct.pack("<IIIBBBB", 0x5053474E, 1, 2, 0, 12, 0, 0) + body
    (tmp_path / "g.spz").write_bytes(gzip.compress(data))
    loaded = load_gaussians(tmp_path / "g.spz")
    np.testing.assert_array_equal(loaded.means, positions.astype(np.float32) * TURN)
    np.testing.assert_array_equal(loaded.opacities, [1, 0])
    np.testing.assert_allclose(loaded.scales, np.exp(-4.0), rtol=1e-6)
    with pytest.raises(InputError, match="SPZ version: 1, expected 2, 3, 4"):
        save_gaussians(tmp_path / "h.spz", loaded, spz_version=1)


def test_axes_of_an_extension_are_refused_and_other_extensions_skipped(tmp_path: Path) -> None:
    save_gaussians(tmp_path / "g.spz", some(1), spz_version=4)
    data = (tmp_path / "g.spz").read_bytes()

    def extended(kind: int, payload: bytes) -> bytes:
        record = struct.pack("<II", kind, len(payload)) + payload
        head = data[:14] + bytes([2, data[15]]) + struct.pack("<I", 32 + len(record)) + bytes(12)
        return head + record + data[32:]

    for kind, value, is_fine in ((0xADBE0002, 6, True), (0xADBE0003, 4, True), (0xADBE0003, 6, False)):
        (tmp_path / "e.spz").write_bytes(extended(kind, struct.pack("<I", value)))
        if is_fine:
            assert load_gaussians(tmp_path / "e.spz").count == some(1).count
        else:
            with pytest.raises(InputError, match="coordinate system 6 of an extension"):
                load_gaussians(tmp_path / "e.spz")


def test_positions_use_all_24_bits_whatever_the_scene_s_size(tmp_path: Path) -> None:
    gaussians = some(0)
    for size in (1e-3, 1.0, 1e4):
        scaled = Gaussians(gaussians.means * size, gaussians.quats, gaussians.scales * size, gaussians.opacities,
                           gaussians.sh)  # fmt: skip
        save_gaussians(tmp_path / "g.spz", scaled)
        error = np.abs(load_gaussians(tmp_path / "g.spz").means - scaled.means).max()
        assert error < np.abs(scaled.means).max() * 2e-7


def test_what_spz_cannot_hold_is_said(tmp_path: Path) -> None:
    g = some(0)
    bright = Gaussians(g.means + 1e6, g.quats, g.scales * 1e-9, g.opacities, g.sh + 9)
    notes = save_gaussians(tmp_path / "g.spz", bright)
    assert [note.split(" ")[0] for note in notes] == ["positions", "scales", "colours"]
    assert save_gaussians(tmp_path / "d.spz", some(4)) == [
        "SH of degree 4 cut to 3, the highest that readers of .spz version 3 know"
    ]
    with pytest.raises(InputError, match="bring the scene nearer"):
        save_gaussians(tmp_path / "g.spz", Gaussians(g.means + 1e8, g.quats, g.scales, g.opacities, g.sh))
    with pytest.raises(InputError, match="SH bits"):
        save_gaussians(tmp_path / "g.spz", g, sh_bits=(9, 4))


@pytest.mark.parametrize("version", [2, 3, 4])
def test_the_same_gaussians_give_the_same_bytes(tmp_path: Path, version: int) -> None:
    for name in ("a.spz", "b.spz"):
        save_gaussians(tmp_path / name, some(), spz_version=version)
    assert (tmp_path / "a.spz").read_bytes() == (tmp_path / "b.spz").read_bytes()


def test_damaged_files_are_refused_in_one_line_and_without_memory(tmp_path: Path) -> None:
    path = tmp_path / "g.spz"
    save_gaussians(path, some(1))
    data = path.read_bytes()
    raw = gzip.decompress(data)
    header = struct.pack("<IIIBBBB", 0x5053474E, 3, 2**32 - 1, 3, 12, 0, 0)
    attacks = {
        "cut short": gzip.compress(raw[:-1]),
        "header": gzip.compress(raw[:8]),
        "gzip": data[: len(data) // 2],
        "announces": gzip.compress(header + bytes(1 << 20)),
        "version 9": gzip.compress(struct.pack("<II", 0x5053474E, 9) + raw[8:]),
        "SPZ header": gzip.compress(b"x" * 40),
        "SPZ version 9, accepted are 1 to 4": b"NGSP" + struct.pack("<IIIIII", 9, 1, 1, 0, 0, 0) + bytes(12),
        "version 4 in a gzip stream": gzip.compress(struct.pack("<II", 0x5053474E, 4) + raw[8:]),
        "outside a gzip stream": raw + bytes(40),
        "damaged": b"not gzip",
        "damaged header: 0 points": gzip.compress(struct.pack("<IIIBBBB", 0x5053474E, 3, 0, 3, 12, 0, 0)),
    }
    for words, attack in attacks.items():
        path.write_bytes(attack)
        with pytest.raises(InputError, match=words) as caught:
            load_gaussians(path)
        assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_damaged_files_of_version_4_are_refused_without_memory(tmp_path: Path) -> None:
    path = tmp_path / "g.spz"
    save_gaussians(path, some(1), spz_version=4)
    data = path.read_bytes()

    def changed(at: int, octets: bytes) -> bytes:
        return data[:at] + octets + data[at + len(octets) :]

    attacks = {
        "announces 4294967295 points": changed(8, b"\xff" * 4),
        "5 streams": changed(15, b"\x05"),
        "table at byte 4294967295": changed(16, b"\xff" * 4),
        "table at byte 8": changed(16, struct.pack("<I", 8)),
        "cut short": changed(32, b"\xff" * 8),  # a stream of 2^64 bytes
        "cut short.": changed(40, b"\xff" * 8),  # that inflates to as many
        "damaged zstd stream": changed(32 + 6 * 16, bytes(8)),
        "1 bytes behind": data + b"x",
        "header": data[:20],
    }
    for words, attack in attacks.items():
        path.write_bytes(attack)
        with pytest.raises(InputError, match=words):
            load_gaussians(path)
    for end in range(0, len(data), 7):
        path.write_bytes(data[:end])
        with pytest.raises(InputError):
            load_gaussians(path)
