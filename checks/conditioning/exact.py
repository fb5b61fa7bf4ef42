"""The transforms in 50 decimal digits, on numpy arrays of mpmath numbers: slow, and right to the last digit of float64.

Written from the formulas (arXiv 2506.09479; Zwicker et al. 2001), independent of the runtime's arithmetic. Functions
take float arrays, whose values are taken as they are, and return arrays of mpmath numbers.
"""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
from numpy.typing import ArrayLike, NDArray

from tinysplat.measure.rows import Row

DIGITS = 50

mpmath.mp.dps = DIGITS

_convert = np.frompyfunc(lambda x: mpmath.mpf(x) if isinstance(x, mpmath.mpf) else mpmath.mpf(float(x)), 1, 1)
_sqrt = np.frompyfunc(mpmath.sqrt, 1, 1)
_exp = np.frompyfunc(mpmath.exp, 1, 1)
_abs = np.frompyfunc(abs, 1, 1)


def exact(values: ArrayLike) -> NDArray[Any]:
    """The same values as mpmath numbers: any shape, dtype object, as all arrays of this module."""
    return np.asarray(_convert(np.asarray(values)), dtype=object)


def sqrt(values: NDArray[Any]) -> NDArray[Any]:
    """Square roots of objects, any shape."""
    return np.asarray(_sqrt(values), dtype=object)


def exp(values: NDArray[Any]) -> NDArray[Any]:
    """Exponentials of objects, any shape."""
    return np.asarray(_exp(values), dtype=object)


def absolute(values: NDArray[Any]) -> NDArray[Any]:
    """Magnitudes of objects, any shape."""
    return np.asarray(_abs(values), dtype=object)


def largest(values: NDArray[Any]) -> float:
    """Largest magnitude of objects of any shape, as a float; 0 of none."""
    return float(max(absolute(values).ravel(), default=mpmath.mpf(0)))


def worst(values: ArrayLike, wanted: NDArray[Any], unit: ArrayLike | NDArray[Any] = 1.0) -> float:
    """Largest |found − wanted| / unit of objects of one shape; infinite where something found is not finite."""
    if not np.isfinite(np.asarray(values, np.float64)).all():
        return float("inf")
    return largest((exact(values) - wanted) / exact(unit))


def unit_quats(quats: ArrayLike) -> NDArray[Any]:
    """Quaternions (…, 4) at length 1, objects."""
    q = exact(quats)
    return q / sqrt((q * q).sum(axis=-1))[..., None]


def multiply_quats(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
    """Hamilton product of quaternions (…, 4), wxyz, objects."""
    aw, av, bw, bv = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    cross = np.roll(av, -1, -1) * np.roll(bv, 1, -1) - np.roll(av, 1, -1) * np.roll(bv, -1, -1)
    return np.concatenate([aw * bw - (av * bv).sum(-1, keepdims=True), aw * bv + bw * av + cross], axis=-1)


def rotation_matrices(quats: ArrayLike) -> NDArray[Any]:
    """Rotation matrices (…, 3, 3) of quaternions (…, 4) of any length, objects."""
    w, x, y, z = np.moveaxis(unit_quats(quats), -1, 0)
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def turn_of(axis: ArrayLike, angle: mpmath.mpf) -> NDArray[Any]:
    """Unit quaternion (4,), objects, of a rotation about an axis (3,)."""
    a = exact(axis)
    a = a / sqrt((a * a).sum())
    return np.concatenate([[mpmath.cos(angle / 2)], mpmath.sin(angle / 2) * a])


def project(
    means: NDArray[Any], scales: ArrayLike, K: ArrayLike, rotation: NDArray[Any], centre: ArrayLike, pixels: ArrayLike
) -> dict[str, NDArray[Any]]:
    """VPT of world means (N, 3): depth (N,), offset (N, 2) from pixel centres (N, 2), ŝ and ray (N, 3), objects."""
    K = exact(K)
    ray = means - exact(centre)
    x, y, z = (ray @ rotation.T).T
    uv = np.stack([K[0, 0] * x / z + K[0, 1] * y / z + K[0, 2], K[1, 1] * y / z + K[1, 2]], axis=-1)
    focal = sqrt(K[0, 0] * K[1, 1])
    return {"depth": z, "offset": uv - exact(pixels), "scale": exact(scales) * (focal / z)[:, None], "ray": ray}


def unproject(
    depth: ArrayLike, offset: ArrayLike, scale: ArrayLike, K: ArrayLike, rotation: NDArray[Any], pixels: ArrayLike
) -> dict[str, NDArray[Any]]:
    """VPT⁻¹: means (N, 3) relative to the camera centre in world axes, and scales (N, 3), objects."""
    K, z = exact(K), exact(depth)
    uv = exact(pixels) + exact(offset)
    y = (uv[:, 1] - K[1, 2]) / K[1, 1]
    x = (uv[:, 0] - K[0, 2] - K[0, 1] * y) / K[0, 0]
    focal = sqrt(K[0, 0] * K[1, 1])
    return {"means": np.stack([x * z, y * z, z], axis=-1) @ rotation, "scales": exact(scale) * (z / focal)[:, None]}


def sh_basis(directions: NDArray[Any], degree: int) -> NDArray[Any]:
    """Real spherical harmonics (N, B) of unit vectors (N, 3), objects, from mpmath's Legendre functions."""
    bands = [(band, m) for band in range(degree + 1) for m in range(-band, band + 1)]
    return np.array([[_harmonic(band, m, *direction) for band, m in bands] for direction in directions])


def _harmonic(band: int, m: int, x: Any, y: Any, z: Any) -> Any:
    """√2 times the real or imaginary part of Y_band^|m|, by the sign of m, with 3DGS's signs."""
    value = mpmath.spherharm(band, abs(m), mpmath.acos(z), mpmath.atan2(y, x))
    return value.real if m == 0 else mpmath.sqrt(2) * (value.imag if m < 0 else value.real)


def splat_exponent(axes: NDArray[Any], jacobian: NDArray[Any], d: NDArray[Any], dilation: float) -> NDArray[Any]:
    """½ dᵀ(J·axes·axesᵀ·Jᵀ + dilation·1)⁻¹d, objects (N,), of axes (N, 3, 3), Jacobians (N, 2, 3), offsets (N, 2)."""
    m = np.stack([j @ a for j, a in zip(jacobian, axes, strict=True)])  # (N, 2, 3)
    a, b, c = ((m[:, i] * m[:, j]).sum(-1) for i, j in ((0, 0), (0, 1), (1, 1)))
    a, c = a + exact(dilation), c + exact(dilation)
    x, y = d.T
    return (c * x * x - 2 * b * x * y + a * y * y) / (2 * (a * c - b * b))


# ---- rows --------------------------------------------------------------------------------------------------------

EPS32 = 2.0**-24
"""Unit roundoff of float32."""

EPS64 = 2.0**-53

STUDY = "numerics"


def numeric_row(
    transform: str, case: str, measure: str, condition: float, *, plain: float, ours: float, double: float, bound: float
) -> Row:
    """A row of the study.

    Args:
        transform: the table it belongs to.
        case: what is extreme about it.
        measure: what the errors are of, and in which unit.
        condition: how much the result moves per relative movement of its inputs.
        plain: error of float32 arithmetic straight from the formulas.
        ours: error of what ships.
        double: error of float64 arithmetic.
        bound: that `ours` must keep, from the condition number.
    """
    figures = {"condition": condition, "float32": plain, "ours": ours, "float64": double, "bound": bound}
    return Row(
        STUDY,
        transform,
        f"{case}; {measure}",
        {"case": case, "measure": measure},
        {name: float(value) for name, value in figures.items()},
    )


def holds(row: Row) -> bool:
    """Whether ours keeps the bound; NaN does not."""
    return bool(row.figures["ours"] <= row.figures["bound"])
