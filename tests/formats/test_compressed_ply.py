"""Compressed .ply: values that gaussforge, another implementation, reads and writes are what we mean."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from formats.foreign import foreign_arrays, foreign_bytes, on_order_of
from scenes import make_gaussians, refusing

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
        with refusing(InputError, "bad.compressed.ply"):
            load_gaussians(tmp_path / "bad.compressed.ply")
