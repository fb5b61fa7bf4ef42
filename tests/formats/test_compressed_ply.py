"""Compressed .ply: values that gaussforge, another implementation, reads and writes are what we mean."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import plyfile
import pytest
from foreign import foreign_arrays, foreign_bytes, on_order_of
from scenes import make_gaussians

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats

SH_STEP = 8 / 256


def some(degree: int = 3, count: int = 600) -> Gaussians:
    made = make_gaussians(height=20, width=20, degree=degree).flat()
    take = slice(0, count)
    return Gaussians(
        made.means[take], made.quats[take], made.scales[take], made.opacities[take].clip(0.02, 0.98), made.sh[take]
    )


def assert_close(read: Gaussians, made: Gaussians) -> None:
    made = on_order_of(made, read)
    reach = np.ptp(made.means, axis=0)
    assert (np.abs(read.means - made.means) <= reach / 1023).all()
    assert np.abs(np.log(read.scales / made.scales)).max() <= np.ptp(np.log(made.scales)) / 1023
    assert np.abs(read.opacities - made.opacities).max() <= 0.5 / 255 + 1e-6
    dots = np.abs((normalize_quats(read.quats) * normalize_quats(made.quats)).sum(axis=-1))
    assert np.arccos(dots.clip(0, 1)).max() < 0.003
    assert np.abs(read.sh[:, 0] - made.sh[:, 0]).max() <= np.ptp(made.sh[:, 0]) / 255
    if made.sh.shape[1] > 1:
        assert np.abs(read.sh[:, 1:] - made.sh[:, 1:]).max() <= 0.51 * SH_STEP


def test_another_implementation_reads_our_file(tmp_path: Path) -> None:
    made = some()
    save_gaussians(tmp_path / "a.compressed.ply", made)
    read = Gaussians(**foreign_arrays((tmp_path / "a.compressed.ply").read_bytes(), "compressed.ply"))
    lowered = Gaussians(
        read.means, read.quats, read.scales, read.opacities, load_gaussians(tmp_path / "a.compressed.ply").sh
    )
    assert_close(lowered, made)
    assert np.abs(read.sh[:, 1:] - lowered.sh[:, 1:]).max() <= SH_STEP  # writers differ by half a step at most


def test_we_read_another_implementations_file(tmp_path: Path) -> None:
    made = some()
    (tmp_path / "b.ply").write_bytes(foreign_bytes(made, "compressed.ply"))
    read = load_gaussians(tmp_path / "b.ply")
    own = Gaussians(**foreign_arrays((tmp_path / "b.ply").read_bytes(), "compressed.ply"))
    np.testing.assert_allclose(read.means, own.means, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(read.scales, own.scales, rtol=1e-4)
    np.testing.assert_allclose(read.opacities, own.opacities, atol=1e-5)
    dots = np.abs((normalize_quats(read.quats) * normalize_quats(own.quats)).sum(axis=-1))
    assert dots.min() > 1 - 1e-5
    assert np.abs(read.sh - own.sh).max() <= SH_STEP


def test_counts_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    save_gaussians(tmp_path / "a.compressed.ply", some(0))
    data = (tmp_path / "a.compressed.ply").read_bytes()
    for old, new in ((b"element vertex 600", b"element vertex 100"), (b"element chunk 3", b"element chunk 2")):
        assert old in data
        (tmp_path / "bad.compressed.ply").write_bytes(data.replace(old, new))
        with pytest.raises(InputError, match="chunks for"):
            load_gaussians(tmp_path / "bad.compressed.ply")


def _joined(*fields: tuple[int, int]) -> int:
    """A word of (value, bits), the first in its highest bits."""
    word = 0
    for value, bits in fields:
        assert 0 <= value < 1 << bits
        word = word << bits | value
    return word


def _by_hand(path: Path, with_colours: bool) -> list[tuple[float, ...]]:
    """257 Gaussians in two chunks, the second of one; their rotations wxyz."""
    ends = [-1, 0, 2, 3, 8, 4, -6, -4, -2, -2, -3, -2]
    chunks = np.array([[*ends, 0, 0.25, 0.5, 1, 0.75, 1], [*(10 * e for e in ends), *[0] * 3, *[1] * 3]], np.float32)
    axes = [f"{end}_{name}" for end in ("min", "max") for name in "xyz"]
    names = [*axes, *(name.replace("_", "_scale_") for name in axes)]
    names += [f"{end}_{name}" for end in ("min", "max") for name in "rgb"] if with_colours else []
    rows, quats = [], []
    for n in range(257):
        three = (n % 3 * 200 + 300, 511, 700)
        a, b, c = ((code / 1023 - 0.5) * np.sqrt(2) for code in three)
        rest = np.sqrt(1 - a * a - b * b - c * c)
        largest = n % 4
        quats.append([(rest, a, b, c), (a, rest, b, c), (a, b, rest, c), (a, b, c, rest)][largest])
        position = _joined((n * 7, 11), (n * 3, 10), (2047 - n, 11))
        scale = _joined((2047, 11), (0, 10), (n, 11))
        colour = _joined((n % 256, 8), (255, 8), (51, 8), (102, 8))
        rows.append((position, _joined((largest, 2), *((code, 10) for code in three)), scale, colour))
    words = np.array(rows, [(f"packed_{name}", "u4") for name in ("position", "rotation", "scale", "color")])
    sh = np.array(
        [tuple((n + i) % 256 for i in range(9)) for n in range(257)], [(f"f_rest_{i}", "u1") for i in range(9)]
    )
    packed = np.array([tuple(row[: len(names)]) for row in chunks], [(name, "f4") for name in names])
    elements = [plyfile.PlyElement.describe(*pair) for pair in ((packed, "chunk"), (words, "vertex"), (sh, "sh"))]
    plyfile.PlyData(elements).write(str(path))
    return quats


@pytest.mark.parametrize("with_colours", [True, False])
def test_a_file_by_hand(tmp_path: Path, with_colours: bool) -> None:
    quats = _by_hand(tmp_path / "a.compressed.ply", with_colours)
    read = load_gaussians(tmp_path / "a.compressed.ply")
    n = np.arange(257)
    tens = np.where(n < 256, 1, 10)
    x, y, z = n * 7 / 2047, n * 3 / 1023, (2047 - n) / 2047
    wanted = np.stack([-1 + 4 * x, 8 * y, 2 + 2 * z], axis=1) * tens[:, None]
    np.testing.assert_allclose(read.means, wanted, rtol=1e-6, atol=1e-6)
    logs = np.stack([-2.0 + 0 * n, -4.0 + 0 * n, -2.0 + 0 * n], axis=1) * tens[:, None]
    np.testing.assert_allclose(np.log(read.scales), logs, rtol=1e-5)
    np.testing.assert_allclose(read.opacities, 0.4, rtol=1e-6)
    shares = np.stack([n % 256 / 255, 1 + 0 * n, 0.2 + 0 * n], axis=1)
    low, high = (np.array(end) for end in ((0, 0.25, 0.5), (1, 0.75, 1)))
    scaled = np.where(n[:, None] < 256, low + (high - low) * shares, shares) if with_colours else shares
    np.testing.assert_allclose(0.5 + 0.28209479177387814 * read.sh[:, 0], scaled, atol=1e-6)
    dots = np.abs((normalize_quats(read.quats) * np.array(quats)).sum(axis=1))
    np.testing.assert_allclose(dots, 1, atol=1e-6)
    codes = (n[:, None] + np.arange(9)) % 256
    middles = np.where(codes == 0, -4, np.where(codes == 255, 4, (codes + 0.5) / 32 - 4))
    np.testing.assert_allclose(read.sh[:, 1:], middles.reshape(257, 3, 3).swapaxes(1, 2), atol=1e-6)
