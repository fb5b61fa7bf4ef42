"""Files of ours and of gaussforge, another implementation, mean the same to it and to us."""

from pathlib import Path

import numpy as np
import pytest
from formats.foreign import foreign_arrays, foreign_bytes
from scenes import make_gaussians

from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats


@pytest.mark.parametrize("is_ours", [True, False])
@pytest.mark.parametrize(("kind", "sh_step"), [("sog", 1e-5), ("compressed.ply", 8 / 256)])
def test_both_readers_find_the_same_gaussians(tmp_path: Path, kind: str, sh_step: float, is_ours: bool) -> None:
    """Of a byte of SH in a compressed .ply readers give back another place in its interval: at most a step apart."""
    made = make_gaussians(height=20, width=20, degree=3).flat()
    made = Gaussians(made.means, made.quats, made.scales, made.opacities.clip(0.02, 0.98), 0.3 * made.sh)
    path = tmp_path / f"a.{kind}"
    if is_ours:
        save_gaussians(path, made)
    else:
        path.write_bytes(foreign_bytes(made, kind))
    ours, theirs = load_gaussians(path), Gaussians(**foreign_arrays(path.read_bytes(), kind))
    for name in ("means", "scales", "opacities"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-4, atol=1e-5)
    dots = np.abs((normalize_quats(ours.quats) * normalize_quats(theirs.quats)).sum(axis=-1))
    assert dots.min() > 1 - 1e-5
    np.testing.assert_allclose(ours.sh, theirs.sh, rtol=1e-4, atol=sh_step)
