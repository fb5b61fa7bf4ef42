"""SPZ files: what gaussforge, built on the format's own library, reads and writes is what we mean."""

import gzip
import struct
from pathlib import Path

import numpy as np
import pytest
from formats.foreign import foreign_bytes, foreign_model
from numpy.typing import NDArray
from scenes import make_gaussians, refused, refusing, tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices
from tinysplat_runtime.gaussian.sh import sh_basis

TURN = np.array([1.0, -1.0, -1.0])  # SPZ has y up and z backward


def some(degree: int = 3) -> Gaussians:
    made = make_gaussians(degree=degree).flat()
    return Gaussians(made.means, made.quats, made.scales, made.opacities.clip(0.02, 0.98), made.sh)


def same_rotations(a: NDArray, b: NDArray, tolerance: float) -> bool:
    dots = np.abs((normalize_quats(a) * normalize_quats(b)).sum(axis=-1))
    return bool((dots > np.cos(tolerance / 2)).all())


@pytest.mark.parametrize(("version", "degree"), [(3, 1), (3, 2), (3, 3), (4, 1), (4, 3)])
def test_the_format_s_own_library_reads_what_we_write(tmp_path: Path, version: int, degree: int) -> None:
    gaussians = some(degree)
    assert save_gaussians(tmp_path / "g.spz", gaussians, sh_bits=(8, 8), spz_version=version) == []
    found = foreign_model((tmp_path / "g.spz").read_bytes(), "spz")
    np.testing.assert_allclose(found["positions"] * TURN, gaussians.means, atol=1e-5)
    np.testing.assert_allclose(found["scales"], np.log(gaussians.scales), atol=1 / 32 + 1e-5)
    np.testing.assert_allclose(1 / (1 + np.exp(-found["alphas"][:, 0])), gaussians.opacities, atol=0.5 / 255 + 1e-5)
    assert same_rotations(found["rotations"] * np.array([1, *TURN]), gaussians.quats, 0.01)
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


def words_by_hand() -> tuple[NDArray, bytes]:
    """Rotations wxyz, and as the format has them: the largest component's index in xyzw, a sign and 9 bits of each."""
    codes = [(3, (+77, -300, +200)), (0, (-500, +1, -2)), (1, (0, +400, -255)), (2, (+128, -64, +32))]
    quats, words = [], b""
    for largest, three in codes:
        word, xyzw = largest, list(np.array(three) / 511 / np.sqrt(2))
        for code in three:
            word = word << 10 | (code < 0) << 9 | abs(code)
        xyzw.insert(largest, np.sqrt(1 - np.square(xyzw).sum()))
        quats.append(np.roll(xyzw, 1))
        words += struct.pack("<I", word)
    return np.array(quats), words


def test_a_file_by_hand_is_read_and_written(tmp_path: Path) -> None:
    """All bytes of version 3 as the format's README has them, at 8 fractional bits."""
    quats, words = words_by_hand()
    quats = quats * np.array([1, *TURN])
    fixed = np.array([[25600, -25600, 1], [-1, 2, 3], [-8388607, 8388607, 0], [256, 512, -768]])
    positions = b"".join(int(v).to_bytes(3, "little", signed=True) for v in fixed.ravel())
    header = struct.pack("<IIIBBBB", 0x5053474E, 3, 4, 1, 8, 0, 0)
    rgb, sizes, higher = bytes(range(0, 240, 20)), bytes(range(100, 112)), bytes(range(0, 252, 7))
    body = positions + bytes([0, 51, 204, 255]) + rgb + sizes + words + higher
    (tmp_path / "g.spz").write_bytes(gzip.compress(header + body))
    read = load_gaussians(tmp_path / "g.spz")
    np.testing.assert_array_equal(read.means, (fixed * TURN / 256).astype(np.float32))
    np.testing.assert_allclose(read.opacities, [0, 0.2, 0.8, 1], rtol=1e-6)
    np.testing.assert_allclose(0.15 * read.sh[:, 0].ravel(), np.arange(0, 240, 20) / 255 - 0.5, atol=1e-7)
    np.testing.assert_allclose(16 * (np.log(read.scales.ravel()) + 10), np.arange(100, 112), atol=1e-4)
    assert same_rotations(read.quats, quats, 1e-3)
    np.testing.assert_allclose(np.abs(read.quats), np.abs(quats), atol=1e-6)
    signs = np.array([-1, -1, 1])[:, None]  # of y, z and x, whose axes turn or stay
    wanted = ((np.arange(0, 252, 7) - 128) / 128).reshape(4, 3, 3) * signs
    np.testing.assert_allclose(read.sh[:, 1:], wanted, atol=1e-7)
    save_gaussians(tmp_path / "w.spz", read, sh_bits=(8, 8))
    assert gzip.decompress((tmp_path / "w.spz").read_bytes()) == header + body


def test_coefficients_keep_as_many_bits_as_are_asked_for(tmp_path: Path) -> None:
    """By hand: 5 bits round a byte to multiples of 8, 4 bits to multiples of 16, halves upwards."""
    flat = some(2)
    sh = np.zeros_like(flat.sh)
    sh[:, 3], sh[:, 6] = 3 / 128, 7 / 128  # bytes 131 of degree 1 and 135 of degree 2
    sh[0, 3], sh[0, 6] = 4 / 128, 8 / 128
    save_gaussians(tmp_path / "g.spz", Gaussians(flat.means, flat.quats, flat.scales, flat.opacities, sh))
    found = np.abs(load_gaussians(tmp_path / "g.spz").sh * 128)
    np.testing.assert_array_equal(found[1:, [3, 6]], 0)
    np.testing.assert_array_equal(found[0, [3, 6]], [[8] * 3, [16] * 3])


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
    with refusing(InputError, "SPZ 2 3, 4"):
        save_gaussians(tmp_path / "h.spz", loaded, spz_version=2)


def extended(data: bytes, kind: int, value: int) -> bytes:
    """A file of version 4 with one extension record."""
    record = struct.pack("<3I", kind, 4, value)
    return data[:14] + bytes([2, data[15]]) + struct.pack("<I", 32 + len(record)) + bytes(12) + record + data[32:]


WAYS = {"R": [1, 0, 0], "L": [-1, 0, 0], "U": [0, 1, 0], "D": [0, -1, 0], "B": [0, 0, 1], "F": [0, 0, -1]}
"""Letters of a coordinate system: where its axes point, among right, up and back."""


@pytest.mark.parametrize(
    ("number", "name"),
    [(1, "LDB"), (3, "LUB"), (4, "RUB"), (6, "RDF"), (7, "LUF"), (8, "RUF"), (11, "LFU"), (12, "RFU"), (14, "RBD")],
)
def test_axes_of_an_extension_become_the_format_s_own(tmp_path: Path, number: int, name: str) -> None:
    save_gaussians(tmp_path / "g.spz", some(3), spz_version=4)
    (tmp_path / "e.spz").write_bytes(extended((tmp_path / "g.spz").read_bytes(), 0xADBE0003, number))
    plain, read = load_gaussians(tmp_path / "g.spz"), load_gaussians(tmp_path / "e.spz")
    turn = np.diag(TURN) @ np.array([WAYS[letter] for letter in name]).T @ np.diag(TURN)
    np.testing.assert_allclose(read.means, plain.means @ turn.T, atol=1e-5)

    def covariances(gaussians: Gaussians) -> NDArray:
        axes = quats_to_matrices(normalize_quats(gaussians.quats)) * gaussians.scales[:, None]
        return axes @ axes.swapaxes(1, 2)

    np.testing.assert_allclose(covariances(read), turn @ covariances(plain) @ turn.T, atol=1e-6)
    direction = np.array([[0.6, -0.48, 0.64]])
    np.testing.assert_allclose(sh_basis(direction @ turn.T, 3) @ read.sh, sh_basis(direction, 3) @ plain.sh, atol=1e-5)


def test_unknown_axes_of_an_extension_are_refused_and_other_extensions_skipped(tmp_path: Path) -> None:
    save_gaussians(tmp_path / "g.spz", some(1), spz_version=4)
    data = (tmp_path / "g.spz").read_bytes()
    for kind, value in ((0xADBE0002, 17), (0xADBE0003, 0)):
        (tmp_path / "e.spz").write_bytes(extended(data, kind, value))
        np.testing.assert_array_equal(
            load_gaussians(tmp_path / "e.spz").means, load_gaussians(tmp_path / "g.spz").means
        )
    (tmp_path / "e.spz").write_bytes(extended(data, 0xADBE0003, 17))
    with refusing(InputError, "17 16"):
        load_gaussians(tmp_path / "e.spz")


def test_what_spz_cannot_hold_is_said(tmp_path: Path) -> None:
    g = some(0)
    bright = Gaussians(g.means + 1e6, g.quats, g.scales * 1e-9, g.opacities, g.sh + 9)
    notes = save_gaussians(tmp_path / "g.spz", bright)
    assert all(word in " ".join(notes) for word in ("positions", "scales", "colours"))
    assert any(tells(note, "SH 4 3") for note in save_gaussians(tmp_path / "d.spz", some(4)))
    scales = g.scales * 1e-9
    scales[0] = 1e3  # one large Gaussian hides no rounding of the others
    mixed = save_gaussians(tmp_path / "g.spz", Gaussians(g.means, g.quats, scales, g.opacities, g.sh))
    assert "scales" in " ".join(mixed) and "colours" not in " ".join(mixed)
    with refusing(InputError, "g.spz"):
        save_gaussians(tmp_path / "g.spz", Gaussians(g.means + 1e8, g.quats, g.scales, g.opacities, g.sh))
    with refusing(InputError, "SH"):
        save_gaussians(tmp_path / "g.spz", g, sh_bits=(9, 4))


def test_damaged_files_are_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "g.spz"
    save_gaussians(path, some(1))
    data = path.read_bytes()
    raw = gzip.decompress(data)

    def headed(*fields: int) -> bytes:
        return gzip.compress(struct.pack("<IIIBBBB", 0x5053474E, *fields, 0, 0) + bytes(1 << 20))

    attacks = [
        (gzip.compress(raw[:-1]), ""),
        (data[: len(data) // 2], ""),
        (headed(3, 2**32 - 1, 3, 12), f"{2**32 - 1}"),
        (headed(4, 1, 0, 12), "4"),
        (headed(3, 1, 5, 12), "5"),
        (b"NGSP" + struct.pack("<IIIIII", 9, 1, 1, 0, 0, 0) + bytes(12), "9, 1 4"),
        (raw + bytes(40), ""),
    ]
    save_gaussians(path, some(1), spz_version=4)
    data = path.read_bytes()

    def changed(at: int, octets: bytes) -> bytes:
        return data[:at] + octets + data[at + len(octets) :]

    attacks += [
        (changed(8, b"\xff" * 4), f"{2**32 - 1}"),
        (changed(16, b"\xff" * 4), f"{2**32 - 1}"),
        (changed(32, b"\xff" * 8), ""),  # a stream of 2^64 bytes
        (changed(40, b"\xff" * 8), ""),  # that inflates to as many
        (data + b"x", "1"),
    ]
    for attack, words in attacks:
        path.write_bytes(attack)
        assert tells(refused(load_gaussians, path), words)
