"""What a Gaussian file holds that is no .tsplat file: `info`'s other half."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..formats.table import find_format, load_gaussians


def describe_gaussians(file: str) -> dict[str, Any]:
    """Format, size, number, degree, extent and notes of a Gaussian file, ready for JSON.

    Raises:
        InputError: missing, damaged, or of an unknown ending.
    """
    gaussians = load_gaussians(file)
    flat = gaussians.flat()
    means = flat.means.astype(np.float64) + flat.origin
    return {
        "file": file,
        "format": find_format(file, written=False).name,
        "bytes": Path(file).stat().st_size,
        "gaussians": gaussians.count,
        "sh_degree": gaussians.degree,
        "views": [[camera.width, camera.height] for camera in gaussians.cameras],
        "layers": len(gaussians.layers),
        "box": [means.min(axis=0).tolist(), means.max(axis=0).tolist()],
        "median_scale": float(np.median(flat.scales)),
        "median_opacity": float(np.median(flat.opacities)),
        "notes": gaussians.notes.given(),
    }


def gaussians_text(about: dict[str, Any]) -> str:
    """The same as text."""
    low, high = (", ".join(f"{value:.4g}" for value in corner) for corner in about["box"])
    views = (
        f"{len(about['views'])} views of {about['views'][0][0]}x{about['views'][0][1]}"
        if about["views"]
        else "no views"
    )
    return "\n".join(
        [
            f"{about['file']}: {about['format']}, {about['bytes']} bytes",
            f"{about['gaussians']} Gaussians of SH degree {about['sh_degree']}, {views}",
            f"({low}) to ({high}); medians: scale {about['median_scale']:.4g}, opacity {about['median_opacity']:.3g}",
            *(f"{name}: {text}" for name, text in about["notes"].items()),
        ]
    )
