"""Errors of drawing are those of committed rows, and ways are what their names say."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tinysplat.measure.clock import Effort
from tinysplat.measure.rows import RowFile, read_rows
from tinysplat.measure.studies import drawing
from tinysplat.measure.study import Run
from tinysplat.measure.subjects.made import made_gaussians
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.render import Renderer

REPORTS = Path(__file__).parents[2] / "benchmarks" / "reports"


@pytest.mark.parametrize(
    ("count", "side"), [(8192, 64), (131_072, 256), (524_288, 512), (1_048_576, 724), (2, 8), (100, 8)]
)
def test_two_square_views_hold_the_gaussians(count: int, side: int) -> None:
    assert drawing.count_side(count) == side


def test_errors_of_the_smallest_scene_are_those_of_committed_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """gsplat's definition and ours against float64; where a threshold is met by a rounding, a pixel more or less."""
    monkeypatch.setattr(Run, "effort", Effort(0, least=0))
    monkeypatch.setattr(drawing, "measure", lambda study, subject, variants, effort: [
        drawing.Row(study, subject, v.name, figures=v.figures(v.run())) for v in variants
    ])  # fmt: skip
    run = Run(True, Runtime(threads=1), RowFile(tmp_path / "rows.jsonl"), tmp_path)
    found = drawing.gsplat_rows(made_gaussians(2, 64, 64, 3), 64, run)
    newest = max(path for path in REPORTS.glob("**/rows.jsonl") if '"torch rasteriser"' in path.read_text("utf-8"))
    before = {row.way: row for row in read_rows(newest) if row.study == "torch rasteriser"}
    assert {row.subject for row in found} == {"8,192 Gaussians at 64×64"}
    for row in found:
        if row.note:
            assert row.note.startswith("no gsplat")
            continue
        for name, value in row.figures.items():
            wanted = before[row.way].figures[name]
            assert value <= 4 * wanted + 1e-4 and (wanted <= 4 * value + 1e-4), (row.way, name)
        assert row.figures["median_error"] < 1e-6


def test_less_work_loses_more_the_less_it_is() -> None:
    variants = drawing.approximations(made_gaussians(1, 24, 24, 2), 32, 1)
    found = {v.name: v.figures(v.run()) for v in variants}
    names = ["exact", "own pixels", "near views first", "both, the default", "half size, scaled up", "SH degree 0",
             "SH degree 1"]  # fmt: skip
    assert [v.name for v in variants][:7] == names
    assert [v.baseline.name if v.baseline else None for v in variants][:7] == [None] * 3 + ["exact"] + [None] * 3
    assert found["exact"]["psnr_exact"] == 150 and found["exact"]["max_error"] < 1e-3
    assert found["SH degree 0"]["psnr_exact"] < found["SH degree 1"]["psnr_exact"] < 149
    assert 15 < found["half size, scaled up"]["psnr_exact"] < 149


def test_pixels_are_a_hundredth_and_500_at_least() -> None:
    gaussians = made_gaussians(1, 16, 16, 0)
    camera = gaussians.cameras[0].resized(24, 24)
    figures = drawing._against_float64(gaussians, camera)
    image = Renderer(gaussians, 1, compiled=False).render(camera)
    assert set(figures(image)) == {"median_error", "error_999", "max_error", "share_above_1e-4"}
    assert figures(image + np.float32(0.25))["median_error"] == pytest.approx(0.25, abs=1e-3)
    assert math.isclose(drawing.PIXEL_SHARE * 512 * 512, 2621.44) and drawing.LEAST_PIXELS == 500


def test_exact_variants_are_ways_by_threads() -> None:
    variants = drawing.exact_variants(made_gaussians(1, 16, 16, 1), 20, [1, 2])
    assert [(v.name, v.threads) for v in variants][:2] == [("numpy, 1 thread", 1), ("numpy, 2 threads", 2)]
    assert variants[0].setting == {"size": 20, "gaussians": 256, "way": "numpy"}
    assert variants[1].run().shape == (20, 20, 3)


def test_dense_blending_is_front_to_back_with_the_thresholds_of_3dgs() -> None:
    """Pixel by pixel in numpy: alphas from 1/255 up to 0.99, and none behind a transmittance of 1e-4."""
    torch = pytest.importorskip("torch")
    rng = np.random.default_rng(0)
    n, height, width = 60, 24, 27
    centres = rng.uniform(0, 27, (n, 2))
    centres[:8] = 12.0  # opaque ones in front of each other
    a, c = rng.uniform(0.02, 0.5, (2, n))
    conics = np.stack([a, 0.4 * np.sqrt(a * c) * rng.uniform(-1, 1, n), c], axis=1)
    conics[9] = 0.3, 2.0, 0.3  # no covariance: its exponent can be negative, where nothing is drawn
    opacities, colours = rng.uniform(0.2, 1.0, n), rng.uniform(0, 1, (n, 3))
    opacities[:8] = 1.0
    camera = made_gaussians(1, 16, 16, 0).cameras[0].resized(height, width)
    given = (torch.from_numpy(array) for array in (centres, conics, opacities, colours))
    found = drawing._blend(*given, camera).numpy()
    wanted = np.zeros((height, width, 3))
    for row in range(height):
        for column in range(width):
            left = 1.0
            for i in range(n):
                x, y = column + 0.5 - centres[i, 0], row + 0.5 - centres[i, 1]
                power = 0.5 * (conics[i, 0] * x * x + conics[i, 2] * y * y) + conics[i, 1] * x * y
                alpha = min(opacities[i] * math.exp(-power), 0.99) if power >= 0 else 0.0
                if alpha < 1 / 255:
                    continue
                if left * (1 - alpha) < 1e-4:
                    break
                wanted[row, column] += alpha * left * colours[i]
                left *= 1 - alpha
    np.testing.assert_allclose(found, wanted, atol=1e-6)
