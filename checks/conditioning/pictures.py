"""SH evaluation, EWA projection and the quantiser at their ends. SH: the ray from the camera is normalised in float64;
EWA: no a·c − b² in the determinant, and float64 above 256 px."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat.measure.rows import Row
from tinysplat_runtime.codec.encoder import map_channel
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.planes import MAX_CODE, Channel, PlaneClass
from tinysplat_runtime.gaussian.quaternions import normalize_quats
from tinysplat_runtime.gaussian.sh import sh_basis
from tinysplat_runtime.render.prepare import prepare
from tinysplat_runtime.render.project import ALPHA_X, BETA_X, DILATION, GAMMA, View, X, Y, projected
from tinysplat_runtime.scene.cameras import Camera

from . import exact as E
from .exact import EPS32, numeric_row

# ---- SH -------------------------------------------------------------------------------------------------------------


def sh_rows() -> Iterator[Row]:
    """Colours before the clamp, in units of Σ|Y||c|, which is what rounding is relative to."""
    rng = np.random.default_rng(1)
    cases = {
        "degree 1": (1, 1.0, rng.normal(size=(60, 3))),
        "degree 4": (4, 1.0, rng.normal(size=(60, 3))),
        "degree 4, coefficients of 1e4": (4, 1e4, rng.normal(size=(60, 3))),
        "degree 4, directions near the poles": (4, 1.0, rng.normal(size=(60, 3)) * [1e-5, 1e-5, 1]),
        "degree 4, mean 1e7 camera heights away": (4, 1.0, rng.normal(size=(60, 3)) * [1, 1, 1e7]),
    }
    for case, (degree, size, rays) in cases.items():
        coefficients = (rng.normal(size=(60, (degree + 1) ** 2)) * size).astype(np.float32)
        unit = E.exact(rays) / E.sqrt((E.exact(rays) ** 2).sum(axis=-1))[:, None]
        terms = E.sh_basis(unit, degree)
        wanted, size_of = (
            (terms * E.exact(coefficients)).sum(-1),
            (E.absolute(terms) * E.absolute(E.exact(coefficients))).sum(-1),
        )
        double = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        narrow = rays.astype(np.float32)
        narrow = narrow / np.linalg.norm(narrow, axis=-1, keepdims=True)
        ways = {
            "plain": (sh_basis(narrow, degree) * coefficients).sum(-1),
            "ours": (sh_basis(double.astype(np.float32), degree) * coefficients).sum(-1),
            "double": (sh_basis(double, degree) * coefficients.astype(np.float64)).sum(-1),
        }
        errors = {way: E.worst(values, wanted, size_of) for way, values in ways.items()}
        condition = E.largest(size_of / E.absolute(wanted))
        yield numeric_row("SH", case, "colour, in Σ\\|Y\\|\\|c\\|", condition, **errors, bound=40 * EPS32)


# ---- EWA ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SplatCase:
    """Gaussians seen by a camera at the origin."""

    name: str
    means: NDArray
    quats: NDArray
    scales: NDArray
    focal: float = 64.0


def splat_cases() -> list[SplatCase]:
    """Sizes and shapes at the ends."""
    rng = np.random.default_rng(5)
    n = 40
    means = rng.uniform(-0.3, 0.3, (n, 3)) + np.array([0, 0, 2.0])
    quats = normalize_quats(rng.normal(size=(n, 4)))

    def shape(*scales: float) -> NDArray:
        return np.tile(scales, (n, 1))

    return [
        SplatCase("ordinary", means, quats, 0.02 * np.exp(rng.normal(size=(n, 3)))),
        SplatCase("scales of 1e-12", means, quats, shape(1e-12, 1e-12, 1e-12)),
        SplatCase("scales of 1e6", means, quats, shape(1e6, 1e6, 1e6)),
        SplatCase("anisotropy 1e4", means, quats, shape(1.0, 1e-4, 1e-4)),
        SplatCase("anisotropy 1e8, needles", means, quats, shape(1e2, 1e-6, 1e-6)),
        SplatCase("anisotropy 1e8, discs", means, quats, shape(1e2, 1e2, 1e-6)),
        SplatCase("needles along the ray", means, np.tile([1.0, 0, 0, 0], (n, 1)), shape(1e-6, 1e-6, 1e2)),
        SplatCase("focal length 1e6 px", means * [1e-5, 1e-5, 1], quats, shape(1e-6, 1e-6, 1e-6), 1e6),
        SplatCase("z of 1e6", means * 1e6, quats, shape(2e4, 3e4, 1e4)),
    ]


def splat_rows() -> Iterator[Row]:
    """Alpha (opacity 1) at up to three standard deviations across and along each splat."""
    for case in splat_cases():
        camera = Camera(np.array([[case.focal, 0, 32], [0, case.focal, 32], [0, 0, 1]]), np.eye(4), 64, 64)
        g = Gaussians(case.means, case.quats, case.scales, np.ones(len(case.means)), np.zeros((len(case.means), 1, 3)))
        axes = E.rotation_matrices(g.quats) * E.exact(g.scales)[:, None, :]
        jacobian, pixel = _exact_jacobian(E.exact(g.means), case.focal)
        records = _records(g, camera)
        offsets = _probes(axes, jacobian)
        errors = dict.fromkeys(("plain", "ours", "double"), 0.0)
        for step in offsets:
            at = pixel + step
            wanted = E.exp(-E.splat_exponent(axes, jacobian, step, DILATION))
            probe = at.astype(np.float64)
            d = (probe.astype(np.float32) - records[:, X : Y + 1]).astype(np.float64)
            moved = E.exp(-E.splat_exponent(axes, jacobian, E.exact(probe) - pixel, DILATION))
            ours = np.exp(
                -np.square(records[:, ALPHA_X] * d[:, 0] + records[:, BETA_X] * d[:, 1])
                - np.square(records[:, GAMMA] * d[:, 1])
            )
            errors["ours"] = max(errors["ours"], E.worst(np.nan_to_num(ours, nan=np.inf), moved))
            for way, dtype in (("plain", np.float32), ("double", np.float64)):
                values = _inverted(
                    axes.astype(np.float64), jacobian.astype(np.float64), (at - pixel).astype(np.float64), dtype
                )
                errors[way] = max(errors[way], E.worst(np.nan_to_num(values, nan=np.inf, posinf=np.inf), wanted))
        m = np.stack([j @ a for j, a in zip(jacobian, axes, strict=True)]).astype(np.float64)
        largest = np.linalg.norm(m, axis=(1, 2)).max()
        condition = float((largest**2 + DILATION) / DILATION)
        yield numeric_row("EWA", case.name, "alpha at 0 to 3 σ, absolute", condition, **errors, bound=_bound(largest))


def _bound(largest_px: float) -> float:
    """Where float32 rounds: pixel positions (an ulp of |x|, over the least σ of √0.3), and splats up to 256 px wide."""
    position = EPS32 * 64 / np.sqrt(DILATION)
    return float(4 * position + 40 * EPS32 * min(largest_px, 256.0) / np.sqrt(DILATION))


def _exact_jacobian(means: NDArray[Any], focal: float) -> tuple[NDArray[Any], NDArray[Any]]:
    x, y, z = means.T
    f, zero = E.exact(focal), x * 0
    rows = np.stack([np.stack([f / z, zero, -f * x / z**2], -1), np.stack([zero, f / z, -f * y / z**2], -1)], axis=-2)
    return rows, np.stack([f * x / z + 32, f * y / z + 32], axis=-1)


def _probes(axes: NDArray[Any], jacobian: NDArray[Any]) -> list[NDArray[Any]]:
    """(N, 2) offsets at 0, 1 and 3 deviations along and across, at most 40 px: what lies in a picture."""
    m = np.stack([j @ a for j, a in zip(jacobian, axes, strict=True)]).astype(np.float64)
    values, vectors = np.linalg.eigh(m @ np.swapaxes(m, 1, 2) + DILATION * np.eye(2))
    probes = [np.zeros((len(m), 2))]
    for axis in (0, 1):
        for deviations in (1.0, 3.0):
            length = np.minimum(deviations * np.sqrt(np.maximum(values[:, axis], DILATION)), 40.0)
            probes.append(vectors[:, :, axis] * length[:, None])
    return [E.exact(p) for p in probes]


def _records(g: Gaussians, camera: Camera) -> NDArray:
    """(N, 8) records of the rasteriser's own projection."""
    (block,) = prepare(g)
    seen = projected(block, View.of(camera, g.origin, 0.01))
    assert seen is not None, "all of it lies before the near plane"
    return seen.planes.T


def _inverted(axes: NDArray, jacobian: NDArray, d: NDArray, dtype: Any) -> NDArray:
    """Alpha from a covariance that is formed and inverted, in one precision."""
    with np.errstate(all="ignore"):
        m = jacobian.astype(dtype) @ axes.astype(dtype)
        a, b, c = ((m[:, i] * m[:, j]).sum(-1) for i, j in ((0, 0), (0, 1), (1, 1)))
        a, c = a + dtype(DILATION), c + dtype(DILATION)
        x, y = d.astype(dtype).T
        return np.exp(-(c * x * x - 2 * b * x * y + a * y * y) / (2 * (a * c - b * b)))


# ---- the quantiser --------------------------------------------------------------------------------------------------


def quantiser_rows() -> Iterator[Row]:
    """Planes that strain a 12-bit range, a row each.

    `wanted` and `reached` are quantiser steps in the values' units, 0 where the plane became a number; `error` is the
    largest of codes alone (without HEVC), in units of the reached step, of the value for constants; `clipped` counts
    samples that lay outside the window, which `--report` counts.
    """
    rng = np.random.default_rng(2)
    smooth = rng.normal(size=(1, 64, 64))
    outlier = smooth.copy()
    outlier[0, 5, 5] = 1e9
    cases = {
        "ordinary, step σ/8": (smooth, 1 / 8, None),
        "σ = 0": (np.full((1, 64, 64), 0.7), 1e-3, None),
        "σ of one float32 ulp": (0.7 + EPS32 * 2 * rng.integers(0, 2, (1, 64, 64)), 1e-3, None),
        "one outlier of 1e9 σ": (outlier, 1 / 8, None),
        "one outlier of 1e9 σ, 14-bit window (`paper`)": (outlier, 1 / 8, (-4.0, 12.0)),
        "two values 1 apart, step 1/2": (np.where(smooth > 0, 1.0, 0.0), 0.5, None),
        "two values 1e6 apart, step 1": (np.where(smooth > 0, 1e6, 0.0), 1.0, None),
        "values at 1e9 ± 200, step 8": (1e9 + 64 * np.round(smooth), 8.0, None),
        "range of 2¹⁶ steps": (smooth * 2.0**13, 1.0, None),
        "range of 1e-30": (smooth * 1e-30, 1e-31, None),
        "range of 1e14": (smooth * 1e14, 1e13, None),
    }
    for case, (values, step, window) in cases.items():
        yield _quantiser_row(case, values.astype(np.float32), step, window)


def _quantiser_row(case: str, values: NDArray, step: float, window: tuple[float, float] | None) -> Row:
    window = window or (float(values.min()), float(values.max()))
    mapped = map_channel(Channel(PlaneClass.COLOR, 0, values, step, window))
    code_map = mapped.code_map
    if code_map is None:
        error = float(np.abs(values.astype(np.float64) - mapped.value).max())
        return _plane_row(case, "a number", step, 0.0, error, 0)
    codes, clipped = zip(*map(mapped.codes, range(len(values))), strict=True)
    low, scale, back = code_map.offset, code_map.scale, code_map.dequantise(np.stack(codes))
    inside = (values >= low - scale) & (values <= low + (MAX_CODE + 1) * scale)
    error = float(np.abs(back.astype(np.float64) - values)[inside].max() / code_map.step)
    return _plane_row(case, f"QP {code_map.qp}", step, code_map.step, error, sum(clipped))


def _plane_row(case: str, what: str, wanted: float, reached: float, error: float, clipped: int) -> Row:
    figures = {"wanted": wanted, "reached": reached, "error": error, "clipped": clipped}
    return Row("quantiser", "planes", case, {"what": what}, figures)
