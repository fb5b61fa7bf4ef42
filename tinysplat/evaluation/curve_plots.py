"""Plots of rate–distortion curves: a picture per network, a column per number of views."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from .curve_rows import Row, grouped
from .plots import Curve, Panel, save_grid
from .rate_distortion import Point


def save_rate_plots(folder: Path, rows: Iterable[Row]) -> list[Path]:
    """Write curves-NETWORK.png: decoded against raw above, against photos below where there are any; the paths."""
    paths = []
    for (network,), of_network in grouped(rows, "network").items():
        by_views = grouped(of_network, "views")
        to_raw = [_panel(views, found, "to_raw", lambda p: p.psnr) for (views,), found in by_views.items()]
        to_photo = [_panel(views, found, "to_photo", lambda p: p.to_photo) for (views,), found in by_views.items()]
        grid = [to_raw, to_photo] if any(panel.curves for panel in to_photo) else [to_raw]
        paths.append(folder / f"curves-{safe_name(network)}.png")
        save_grid(paths[-1], f"{network}: means over windows; dashed: the raw Gaussians", grid)
    return paths


def safe_name(text: str) -> str:
    """For file names."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in text)


def _panel(views: str, rows: Sequence[Row], axis: str, db_of: Callable[[Point], float | None]) -> Panel:
    """Means over windows, for each way and setting."""
    curves = []
    for (way,), members in grouped(rows, "way").items():
        points = []
        for setting in dict.fromkeys(row.point.setting for row in members):
            chosen = [row.point for row in members if row.point.setting == setting]
            decibels = [db for db in map(db_of, chosen) if db is not None]
            if decibels:
                points.append((float(np.mean([p.bytes for p in chosen])) / 1000, float(np.mean(decibels))))
        if points:
            curves.append(Curve(way, points))
    raw = [row.raw_to_photo for row in rows if row.raw_to_photo is not None]
    level = float(np.mean(raw)) if raw and axis == "to_photo" else None
    label = {"to_raw": "dB, decoded to raw", "to_photo": "dB, decoded to photo"}[axis]
    return Panel(f"{views} views", "KB", label, curves, level)
