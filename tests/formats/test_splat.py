"""`.splat`: records made by hand and by gaussforge, another implementation."""

import struct
from pathlib import Path

import numpy as np
import pytest
from formats.foreign import foreign_bytes, on_order_of
from scenes import make_gaussians, refused, tells

from tinysplat_runtime.formats.table import load_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats


def test_records_of_a_splat_by_hand(tmp_path: Path) -> None:
    record = struct.pack("<6f8B", 1, 2, 3, 0.1, 0.2, 0.3, 255, 128, 0, 51, 128, 192, 128, 128)
    (tmp_path / "a.splat").write_bytes(record * 2)
    read = load_gaussians(tmp_path / "a.splat")
    np.testing.assert_allclose(read.means, [[1, 2, 3]] * 2)
    np.testing.assert_allclose(read.scales, [[0.1, 0.2, 0.3]] * 2, rtol=1e-6)
    np.testing.assert_allclose(read.opacities, [0.2, 0.2], rtol=1e-6)
    np.testing.assert_allclose(normalize_quats(read.quats), [[0, 1, 0, 0]] * 2)
    np.testing.assert_allclose(0.5 + 0.28209479177387814 * read.sh[:, 0], [[1, 128 / 255, 0]] * 2, atol=1e-6)


def test_we_read_what_another_implementation_writes(tmp_path: Path) -> None:
    made = make_gaussians(height=20, width=20, degree=0).flat()
    made = Gaussians(made.means, made.quats, made.scales, made.opacities.clip(0.02, 0.98), 0.3 * made.sh)
    (tmp_path / "a.splat").write_bytes(foreign_bytes(made, "splat"))
    read = load_gaussians(tmp_path / "a.splat")
    made = on_order_of(made, read)
    np.testing.assert_allclose(read.means, made.means, atol=2e-4)
    np.testing.assert_allclose(read.scales, made.scales, rtol=1e-3)
    np.testing.assert_allclose(read.opacities, made.opacities, atol=1.01 / 255)
    np.testing.assert_allclose(read.sh[:, 0], made.sh[:, 0], atol=1.01 / 255 / 0.28)
    dots = np.abs((normalize_quats(read.quats) * normalize_quats(made.quats)).sum(axis=-1))
    assert np.arccos(dots.clip(0, 1)).max() < 0.02


@pytest.mark.parametrize(("size", "words"), [(0, ""), (33, "33 32")])
def test_a_file_of_no_whole_records_is_refused(tmp_path: Path, size: int, words: str) -> None:
    (tmp_path / "a.splat").write_bytes(bytes(size))
    assert tells(refused(load_gaussians, tmp_path / "a.splat"), words)
