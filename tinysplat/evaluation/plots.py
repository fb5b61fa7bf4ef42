"""The plots of the paper's figures, drawn with matplotlib without a display."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tinysplat_runtime.files import atomic_path

_BINS = 100
_SHOWN = (0.5, 99.5)  # percentiles; a few far points would squeeze all others into one bin


@dataclass(frozen=True)
class Curve:
    """A named line through (KB, dB)."""

    name: str
    points: Sequence[tuple[float, float]]


def save_curves(path: Path, title: str, panels: Mapping[str, Sequence[Curve]]) -> None:
    """One panel per axis label, sizes on a logarithmic axis; panels without points are left out."""
    drawn = {label: [c for c in curves if c.points] for label, curves in panels.items()}
    drawn = {label: curves for label, curves in drawn.items() if curves}
    figure = Figure(figsize=(5.2 * max(len(drawn), 1), 4), layout="constrained")
    figure.suptitle(title, fontsize=10)
    for n, (label, curves) in enumerate(drawn.items()):
        axis = figure.add_subplot(1, len(drawn), n + 1)
        for curve in curves:
            x, y = zip(*sorted(curve.points), strict=True)
            axis.plot(x, y, marker="o", markersize=3, label=curve.name)
        axis.set_xscale("log")
        axis.set_xlabel("KB")
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    _save(path, figure)


def save_histograms(path: Path, title: str, groups: Mapping[str, Mapping[str, NDArray]]) -> None:
    """A panel per group, its channels over each other."""
    figure = Figure(figsize=(9, 6), layout="constrained")
    figure.suptitle(title, fontsize=10)
    axes = figure.subplots(-(-len(groups) // 2), 2, squeeze=False).ravel()
    for axis, (name, channels) in zip(axes, groups.items(), strict=False):
        for label, values in channels.items():
            low, high = np.percentile(values, _SHOWN)
            axis.hist(values.ravel(), bins=_BINS, range=(low, max(high, low + 1e-9)), histtype="step", label=label)
        axis.set_title(name, fontsize=9)
        axis.legend(fontsize=7)
    _save(path, figure)


def save_bars(path: Path, title: str, quality: tuple[Sequence[int], Sequence[float]], bits: Sequence[float]) -> None:
    """Quality against k, and the bits of each component."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    figure.suptitle(title, fontsize=10)
    left, right = figure.subplots(1, 2)
    left.plot(*quality, marker="o", markersize=3)
    left.set_xscale("log")
    left.set_xlabel("k")
    left.set_ylabel("dB to the raw render")
    left.grid(alpha=0.3)
    right.bar(range(1, len(bits) + 1), bits)
    right.set_xlabel("component")
    right.set_ylabel("bits per Gaussian")
    _save(path, figure)


def _save(path: Path, figure: Figure) -> None:
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)
