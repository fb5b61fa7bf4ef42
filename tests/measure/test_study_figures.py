"""Figures of studies on a small scene stay what they are: whoever changes how a study counts measures anew."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fingerprints import print_of
from scenes import make_smooth_gaussians
from tiny_runs import rows_of, tiny_run

from tinysplat.measure.studies.figures import _paper_channel
from tinysplat_runtime.codec.profiles import PAPER
from tinysplat_runtime.formats.table import save_gaussians
from tinysplat_runtime.gaussian.planes import PlaneClass


def numbers(value: Any) -> Iterator[float]:
    """All numbers of figures, as logarithms, so that small ones count as much as large ones."""
    if isinstance(value, Mapping):
        for part in value.values():
            yield from numbers(part)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from numbers(part)
    elif isinstance(value, int | float) and math.isfinite(value):
        yield math.log10(abs(value) + 1e-6)


def figures_of(study: str, folder: Path, **options: Any) -> dict[str, tuple[int, tuple[float, float]]]:
    """By the names of a study's rows: how many there are, and a print of all their figures."""
    path = folder / "made.npz"
    save_gaussians(path, make_smooth_gaussians(height=24, width=32, degree=2))
    found: dict[str, list[float]] = {}
    counts: dict[str, int] = {}
    for row in rows_of(study, tiny_run(folder, path, rounds=1, **options)):
        found.setdefault(row.study, []).extend(numbers(row.figures))
        counts[row.study] = counts.get(row.study, 0) + 1
    return {name: (counts[name], print_of(values or [0])) for name, values in found.items()}


FIGURES = {
    "reduction": {
        "k": (3, (1.97818, 0.149198)), "component bits": (12, (1.60718, 0.953173)),
        "SH degree": (3, (1.79716, 0.355153)),
    },
    "figures": {
        "channels": (12, (1.40994, 0.416544)), "channel bytes": (2, (3.38138, 3.1544)),
        "ablation": (4, (2.90997, 3.22367)),
    },
    "prefixes": {"prefixes": (6, (2.56253, 2.43015))},
}  # fmt: skip


@pytest.mark.parametrize("study", FIGURES)
def test_figures_of_a_small_scene_are_what_they_were(study: str, tmp_path: Path) -> None:
    options = {"qps": (0.0,)} if study == "figures" else {}
    found = figures_of(study, tmp_path, **options)
    assert found.keys() == FIGURES[study].keys()
    for name, (count, wanted) in FIGURES[study].items():
        assert found[name][0] == count
        assert found[name][1] == pytest.approx(wanted, rel=0.01, abs=0.01), name


def test_the_papers_window_is_all_of_14_bits() -> None:
    plane = np.array([[[1.0, 1e9]]])
    channel = _paper_channel(PlaneClass.DEPTH, 0, plane, 0.0, sigma=10.0)
    assert channel.window == pytest.approx((1.0, 1.0 + (2**14 - 1) * 10.0 / PAPER.alpha[PlaneClass.DEPTH]))
