"""Gaussians as whole numbers in columns, small under gzip: `pack`. unpack.js takes them apart again.

A column holds differences between neighbours, zigzag, as byte planes: pixels next to each other have much in common.
Steps are chosen so that the picture loses about 55 dB to none of them.
"""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import Gaussians
from ..gaussian.quaternions import normalize_quats
from ..render.prepare import ALPHA_MIN

MEAN_STEP = 2.0**-15
"""Of asinh(x / knee): relative to the distance from the page's origin, so 0.01 px at a focal length of 600 px."""

PIXEL_STEPS = 64
"""Steps to a pixel of where a mean is seen by its own view, from which it is rebuilt where views are known."""

DEPTH_STEPS = 4096
"""Steps of a depth's logarithm to base 2: another view at a fifth of the depth is off by 0.01 px."""

QUAT_STEPS = 512
"""Steps of a quaternion's three smaller parts to 1: 0.1° of rotation."""

LOG_STEPS, LOG_LOWEST = 32, 512
"""Steps of a length's logarithm to base 2, and what is added to it: 1 % of length, with 0 for nothing."""

COLOUR_ERROR = 0.0015
"""Root mean square error of a colour by rounding its SH, and again by leaving components out."""


OTHER_LAYERS = 64
"""Added to the view of a Gaussian that is no surface of a photo: files have at most as many views."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """Gaussians in page units.

    Attributes:
        gaussians: (N,).
        means: (N, 3) float64, relative to the page's origin.
        scale: page units to a scene unit.
        knee: distance from the page's origin within which a mean's step is constant.
        views: (N,) index of the view that a Gaussian is a pixel of, OTHER_LAYERS more in layers behind the first; None
            where there are no views.
        local: (N, 3) float64, pixel x and y and depth of the mean in that view; None where there are none.
    """

    gaussians: Gaussians
    means: NDArray
    scale: float
    knee: float
    views: NDArray | None = None
    local: NDArray | None = None


def pack(cloud: Cloud) -> tuple[dict[str, Any], bytes]:
    """Columns of the Gaussians that can show.

    Returns:
        What the page's JSON says of them, and the columns as one gzip stream.
    """
    gaussians = cloud.gaussians
    shows = gaussians.opacities >= ALPHA_MIN
    quats, largest = _smallest_three(normalize_quats(gaussians.quats[shows]))
    parts, described = _components(gaussians.sh[shows])
    columns = {
        **_places(cloud, shows),
        "opacity": (np.rint(gaussians.opacities[shows] * 255), 1),
        **_numbered("scale", lengths(gaussians.scales[shows].astype(np.float64) * cloud.scale), 2),
        **_numbered("quat", np.rint(quats * QUAT_STEPS), 2),
        "quat_largest": (largest, 1),
        **_numbered("sh", parts, 3),
    }
    data = b"".join(_coded(column, width) for column, width in columns.values())
    return {
        "count": int(shows.sum()),
        "columns": [[name, width + (width == 1)] for name, (_, width) in columns.items()],
        "meanStep": MEAN_STEP,
        "meanKnee": cloud.knee,
        "pixelSteps": PIXEL_STEPS,
        "depthSteps": DEPTH_STEPS,
        "quatSteps": QUAT_STEPS,
        "logSteps": [LOG_STEPS, LOG_LOWEST],
        "sh": described,
    }, gzip.compress(data, 6, mtime=0)


def _places(cloud: Cloud, shows: NDArray) -> dict[str, tuple[NDArray, int]]:
    """Where Gaussians lie: by pixel and depth of their view, whose neighbours say most of it, or by coordinates."""
    if cloud.views is None or cloud.local is None or cloud.local[:, 2].min() <= 0:
        return _numbered("mean", np.rint(np.arcsinh(cloud.means[shows] / cloud.knee) / MEAN_STEP), 4)
    x, y, depth = cloud.local[shows].T
    return {
        "view": (cloud.views[shows], 1),
        "pixel_0": (np.rint(x * PIXEL_STEPS), 4),
        "pixel_1": (np.rint(y * PIXEL_STEPS), 4),
        "depth": (np.rint(np.log2(depth) * DEPTH_STEPS), 4),
    }


def lengths(values: NDArray) -> NDArray:
    """Codes 0 to 65535 of lengths; 0 stands for 0."""
    with np.errstate(divide="ignore"):
        return np.rint((np.log2(values) + LOG_LOWEST) * LOG_STEPS).clip(0, 65535)


def _numbered(name: str, values: NDArray, width: int) -> dict[str, tuple[NDArray, int]]:
    return {f"{name}_{i}": (column, width) for i, column in enumerate(values.T)}


def _smallest_three(quats: NDArray) -> tuple[NDArray, NDArray]:
    """The three smaller parts (N, 3) of unit quaternions whose largest is made positive, and its index (N,)."""
    largest = np.abs(quats).argmax(axis=1)
    turned = quats * np.sign(np.take_along_axis(quats, largest[:, None], axis=1))
    rest = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])[largest]
    return np.take_along_axis(turned, rest, axis=1), largest


def _components(sh: NDArray) -> tuple[NDArray, dict[str, Any]]:
    """SH (N, B, 3) as whole multiples (N, R) of a step along principal axes, or along all where most are needed."""
    flat = sh.reshape(len(sh), -1)
    width = flat.shape[1]
    mean = flat.mean(axis=0, dtype=np.float64)
    centred = flat - mean.astype(np.float32)
    variances, axes = np.linalg.eigh((centred.T @ centred).astype(np.float64) / len(flat))
    # A colour is Σ Y_b·sh_b, whose square is a fourth of π-th of the coefficients' in the mean over directions.
    allowed = 3 * 4 * np.pi * COLOUR_ERROR**2
    kept = width - int(np.searchsorted(np.cumsum(variances.clip(0)), allowed))
    basis = axes[:, ::-1][:, : max(kept, 1)].T if kept <= width // 2 else None
    step = float(np.sqrt(12 * allowed / (width if basis is None else len(basis))))
    parts = centred if basis is None else centred @ basis.T.astype(np.float32)
    described = {"mean": mean.tolist(), "basis": None if basis is None else basis.round(6).tolist(), "step": step}
    return np.rint(parts / step), described


def _coded(column: NDArray, width: int) -> bytes:
    """Zigzag differences of whole numbers as byte planes; a column of one byte has differences of two."""
    differences: NDArray = np.diff(column.astype(np.int32), prepend=np.int32(0))
    zigzag = ((differences << 1) ^ (differences >> 31)).astype("<u4")
    planes = zigzag.view(np.uint8).reshape(-1, 4)[:, : width + (width == 1)]
    return np.ascontiguousarray(planes.T).tobytes()
