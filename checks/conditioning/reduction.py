"""VABR where it is stiff: λ → 0, repeated and missing eigenvalues, fewer Gaussians than coefficients. What ships works
in float64 on all of size d, and takes the left inverse of the stored W."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tinysplat.measure.rows import Row
from tinysplat_runtime.codec.basis import (
    LAMBDA_FLOOR,
    mean_magnitude_weighting,
    reduce_basis,
    second_moment_weighting,
    view_directions,
    weighted_spectrum,
)
from tinysplat_runtime.gaussian.planes import Reduction
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices
from tinysplat_runtime.gaussian.sh import sh_basis
from tinysplat_runtime.scene.cameras import Camera

from .exact import EPS32, numeric_row

DEGREE = 4
FUNCTIONS = (DEGREE + 1) ** 2
D = 3 * FUNCTIONS


def camera_of(field_of_view: float, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Camera:
    """A square camera of 64 pixels; field of view in degrees, `turn` the vector part of its rotation."""
    focal = 32 / np.tan(np.radians(field_of_view) / 2)
    c2w = np.eye(4)
    c2w[:3, :3] = quats_to_matrices(normalize_quats(np.array([1.0, *turn])))
    return Camera(np.array([[focal, 0, 32], [0, focal, 32], [0, 0, 1]]), c2w, 64, 64)


# ---- the floor of λ -------------------------------------------------------------------------------------------------


def floor_rows() -> Iterator[Row]:
    """Narrow and ordinary fields of view, with and without floors, a row per set of cameras and weighting.

    `least` is the smallest λ, or eigenvalue of the second moment relative to its largest, before any floor;
    `condition` that of Δ; `amplification` how much larger noise on the planes comes back in the coefficients (root mean
    square), `seen` the same in colour along the input rays (1 or less is what VABR is for), `beside` 10 degrees off the
    input views' axes; `round_trip` the largest error of coefficients through float32 planes at k = d, relative.
    """
    sets = {
        "60°, on an axis": [camera_of(60)],
        "60°, turned": [camera_of(60, (0.21, -0.13, 0.08))],
        "5°, on an axis": [camera_of(5)],
        "0.1°, on an axis": [camera_of(0.1)],
        "two of 60°, 20° apart": [camera_of(60, (0, -0.088, 0)), camera_of(60, (0, 0.088, 0))],
    }
    for name, cameras in sets.items():
        rays = view_directions(cameras)
        magnitudes = np.abs(sh_basis(rays, DEGREE)).mean(axis=0)
        moment = sh_basis(rays, DEGREE)
        spectrum = np.linalg.eigvalsh(moment.T @ moment / len(rays))
        relative = float(max(spectrum[0], 0) / spectrum[-1])
        least = float(magnitudes.min())
        tiny = np.maximum(magnitudes, np.finfo(np.float64).eps)
        yield _floor_row(name, "λ, no floor", least, np.diag(tiny), cameras)
        yield _floor_row(
            name, f"λ ≥ {LAMBDA_FLOOR:g} (`paper`)", least, mean_magnitude_weighting(rays, DEGREE), cameras
        )
        yield _floor_row(name, "E[YYᵀ]^½, floor 1e-3 (ours)", relative, second_moment_weighting(rays, DEGREE), cameras)


def _floor_row(name: str, weighting: str, least: float, delta: NDArray, cameras: list[Camera]) -> Row:
    inverse = np.linalg.inv(delta)
    beside = [Camera(c.K, c.c2w @ _turned(10), c.width, c.height) for c in cameras]
    colour = [_rms(sh_basis(view_directions(views), DEGREE) @ inverse) for views in (cameras, beside)]
    coefficients = np.random.default_rng(0).normal(size=(FUNCTIONS, 500)).astype(np.float32)
    planes = (delta @ coefficients).astype(np.float32)
    back = inverse.astype(np.float32) @ planes
    error = float(np.abs(back - coefficients).max() / np.abs(coefficients).max())
    condition = float(np.linalg.cond(delta))
    figures = {
        "least": least,
        "condition": condition,
        "amplification": _rms(inverse),
        "seen": colour[0],
        "beside": colour[1],
        "round_trip": error,
    }
    return Row("floor", name, weighting, figures=figures)


def _turned(degrees: float) -> NDArray:
    angle, out = np.radians(degrees), np.eye(4)
    out[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    return out


def _rms(matrix: NDArray) -> float:
    """Root mean square of matrix·δ over its rows for δ of unit variance."""
    return float(np.sqrt((matrix**2).sum(axis=1).mean()))


# ---- degenerate spectra ---------------------------------------------------------------------------------------------


def coefficients_of(case: str) -> NDArray:
    """(M, 75) float32 SH coefficients of one degenerate kind."""
    rng = np.random.default_rng(3)
    full = rng.normal(size=(400, D)) * np.repeat(1 / (1 + np.arange(FUNCTIONS)), 3)
    match case:
        case "full rank":
            x = full
        case "rank 2, k = 6":
            x = rng.normal(size=(400, 2)) @ rng.normal(size=(2, D))
        case "all coefficients equal":
            x = np.full((400, D), 0.37)
        case "one Gaussian (M < d)":
            x = full[:1]
        case "12 Gaussians (M < d)":
            x = full[:12]
        case "repeated eigenvalues":
            x = np.concatenate([np.eye(D), -np.eye(D)])
        case "all zero":
            x = np.zeros((400, D))
        case "coefficients of 1e4":
            x = full * 1e4
        case "coefficients of 1e-15":
            x = full * 1e-15
        case _:
            raise ValueError(case)
    return x.astype(np.float32)


SPECTRUM_CASES = (
    "full rank",
    "rank 2, k = 6",
    "all coefficients equal",
    "one Gaussian (M < d)",
    "12 Gaussians (M < d)",
    "repeated eigenvalues",
    "all zero",
    "coefficients of 1e4",
    "coefficients of 1e-15",
)


def reduced(x: NDArray, delta: NDArray, k: int) -> Reduction:
    """The shipped reduction of x (M, d) float32: moment in float32 as in the graph, all of size d in float64."""
    moment = (x.T @ x / np.float32(len(x))).astype(np.float64)
    return reduce_basis(weighted_spectrum(moment, delta), delta, k)


def spectrum_rows() -> Iterator[Row]:
    """What k planes lose beyond the best rank-k approximation, in the weighted norm; exact from float64 SVD."""
    delta = second_moment_weighting(view_directions([camera_of(60, (0.21, -0.13, 0.08))]), DEGREE)
    weights = np.kron(delta, np.eye(3))
    for case in SPECTRUM_CASES:
        x = coefficients_of(case)
        wide = x.astype(np.float64)
        for k in (1, 6, D):
            if k == 6 or case in ("full rank", "repeated eigenvalues", "one Gaussian (M < d)"):
                yield _spectrum_row(case, x, wide, delta, weights, k)


def _spectrum_row(case: str, x: NDArray, wide: NDArray, delta: NDArray, weights: NDArray, k: int) -> Row:
    weighted = wide @ weights.T
    singular = np.linalg.svd(weighted, compute_uv=False)
    total = float(np.sqrt((singular**2).sum())) or 1.0
    best = float(np.sqrt((singular[k:] ** 2).sum())) / total

    def excess(planes: NDArray, inverse: NDArray) -> float:
        rest = (wide - planes.astype(np.float64) @ inverse.astype(np.float64).T) @ weights.T
        lost = float(np.linalg.norm(rest)) / total
        return float(np.sqrt(max(lost**2 - best**2, 0.0)))

    ours = reduced(x, delta, k)
    exact = reduce_basis(weighted_spectrum(wide.T @ wide / len(wide), delta), delta, k)
    with np.errstate(all="ignore"):
        plain_weights = weights.astype(np.float32)
        moment = plain_weights @ (x.T @ x / np.float32(len(x))) @ plain_weights.T
        vectors = np.linalg.eigh(moment)[1][:, ::-1][:, :k]
        inverse = np.linalg.inv(plain_weights) @ vectors
        plain = excess(x @ (plain_weights.T @ vectors), inverse.astype(np.float16))
    mixed = excess(x @ ours.projection.astype(np.float32), ours.inverse)
    double = excess(wide @ exact.projection, exact.inverse)
    condition = float(np.linalg.cond(delta))
    # Second moments in float32 see directions down to a root of its roundoff; W rounded to float16 turns the subspace.
    bound = 2.0**-11 * 4 + np.sqrt(EPS32) if k < D else 40 * EPS32 * condition
    return numeric_row(
        "VABR",
        f"{case}, k = {k}" if "k =" not in case else case,
        "weighted coefficients, relative",
        condition,
        plain=plain,
        ours=mixed,
        double=double,
        bound=bound,
    )
