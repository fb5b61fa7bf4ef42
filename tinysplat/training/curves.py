"""Learning curves as a PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tinysplat_runtime.errors import InputError


def draw_curves(history: Sequence[dict[str, float]], path: Path) -> None:
    """One small panel per figure over training steps.

    Args:
        history: points with `step` and figures by name.
        path: the PNG.

    Raises:
        InputError: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise InputError(
            'needs the package matplotlib; pip install "tinysplat[eval]" brings it', where="curves"
        ) from None
    names = sorted({name for point in history for name in point} - {"step"})
    columns = 4
    rows = max(-(-len(names) // columns), 1)
    figure = Figure(figsize=(4 * columns, 2.6 * rows), layout="constrained")
    for position, name in enumerate(names, start=1):
        axes = figure.add_subplot(rows, columns, position)
        points = [(point["step"], point[name]) for point in history if name in point]
        axes.plot(*zip(*points, strict=True), linewidth=1, marker=".", markersize=3)
        axes.set_title(name, fontsize=9)
        axes.tick_params(labelsize=7)
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=90)
