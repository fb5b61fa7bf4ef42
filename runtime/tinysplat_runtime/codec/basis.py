"""Visibility-aware basis reduction (VABR): which few combinations of SH coefficients carry the colours that are seen.

arXiv 2506.09479. All of it is d × d, in float64 on the host; the products over pixels
are graphs (`analysis_moment`, `analysis_project`, `synthesis`).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.planes import Reduction
from ..gaussian.sh import sh_basis
from ..scene.cameras import Camera
from ..system.blas import product, single_thread, symmetric_eigen

GRID = 3
"""Directions are the rays through the centres of GRID × GRID cells of every input view's image plane."""

LAMBDA_FLOOR = 1e-4
"""Least λ. It is exactly 0 for (l, m) = (4, −4) with world-aligned square cameras; 1e-4 keeps Δ's condition number
under 10,000, so that Δ⁻¹ in float32 still returns coefficients to 1e-4 of the largest."""

WEIGHT_FLOOR = 1e-3
"""Least eigenvalue of the directions' second moment, relative to its largest, when its root is the weighting."""

_LEAST_ENERGY = 1e-12
"""Eigenvalues below this share of the largest are rounding errors of nothing."""


def view_directions(cameras: Sequence[Camera]) -> NDArray:
    """Unit rays (9·V, 3) float64 in the world through the centres of 3 × 3 cells covering every view's image plane.

    arXiv 2506.09479, basis reduction: its sample directions ω.
    """
    directions = []
    for camera in cameras:
        cells = (np.arange(GRID) + 0.5) / GRID
        u, v = np.meshgrid(cells * camera.width, cells * camera.height)
        pixels = np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3)
        directions.append(pixels @ np.linalg.inv(camera.K).T @ camera.rotation)
    rays = np.concatenate(directions)
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def mean_magnitude_weighting(directions: NDArray, degree: int) -> NDArray:
    """Δ = diag(max(λ, floor)) (B, B) float64 of directions (n, 3), λ_b = mean over them of |Y_b(ω)|.

    arXiv 2506.09479, basis reduction; the floor is ours.
    """
    magnitudes = np.abs(sh_basis(directions, degree)).mean(axis=0)
    return np.diag(np.maximum(_rounded(magnitudes), LAMBDA_FLOOR))


def second_moment_weighting(directions: NDArray, degree: int) -> NDArray:
    """Symmetric root of E[Y Yᵀ], (B, B) float64: ‖Δ·x‖² is then the mean squared colour of coefficients x, no bound."""
    basis = sh_basis(directions, degree)
    values, vectors = symmetric_eigen(product(basis.T, basis) / len(basis))
    roots = np.sqrt(np.maximum(values, WEIGHT_FLOOR**2 * values[-1]))
    return _rounded(product(vectors * roots, vectors.T))


def needed_degree(moment: NDArray, directions: NDArray, degree: int, budget: float) -> int:
    """Least SH degree behind which there is at most `budget` of mean squared colour, summed over the three colours.

    Args:
        moment: (d, d) float64 second moment of the coefficient vectors (coefficient-major, RGB last).
        directions: (n, 3) float64 unit vectors from which colours are seen.
        degree: of the coefficients.
        budget: squared colour that may be left out.
    """
    basis = sh_basis(directions, degree)
    seen = product(basis.T, basis) / len(basis)  # (B, B)
    functions = len(seen)
    by_function = np.einsum("bcec->be", np.asarray(moment, np.float64).reshape(functions, 3, functions, 3))
    for lower in range(degree):
        rest = slice((lower + 1) ** 2, None)
        if float((seen[rest, rest] * by_function[rest, rest]).sum()) <= budget:
            return lower
    return degree


def weighted_spectrum(moment: NDArray, weighting: NDArray) -> tuple[NDArray, NDArray]:
    """Eigenvalues (d,) and eigenvectors (d, d) float64 of Δ·E[x xᵀ]·Δᵀ, by falling eigenvalue.

    An eigenvalue is what its component would carry: mean squared weighted coefficients. In each column the entry of
    largest magnitude is positive. arXiv 2506.09479, basis reduction: the PCA of ΔX.

    Args:
        moment: (d, d) second moment of the coefficient vectors (coefficient-major, RGB last), d = 3B.
        weighting: (B, B) Δ; every entry serves the three colours.
    """
    delta = _all_colors(weighting)
    weighted = product(product(delta, np.asarray(moment, np.float64)), delta.T)
    values, vectors = symmetric_eigen((weighted + weighted.T) / 2)
    values, vectors = values[::-1], vectors[:, ::-1]
    return np.where(values > _LEAST_ENERGY * values[0], values, 0), vectors * leading_signs(vectors, ties=1e-6)


def reduce_basis(spectrum: tuple[NDArray, NDArray], weighting: NDArray, k: int) -> Reduction:
    """The maps of the k components of largest weighted energy: Z = WᵀΔX, X̂ = Δ⁻¹WZ (arXiv 2506.09479, basis reduction).

    The inverse map Δ⁻¹W is rounded to what the file stores first; the forward map is then its exact left inverse under
    the weighting, so that rounding costs nothing, not even at k = d.

    Args:
        spectrum: `weighted_spectrum` under the same weighting.
        weighting: (B, B) float64 Δ.
        k: 1 to d.

    Raises:
        InputError: another k.
    """
    energies, vectors = spectrum
    if not 1 <= k <= len(energies):
        raise InputError(f"{k} components, accepted are 1 to {len(energies)}", where="k")
    delta = _all_colors(weighting)
    with single_thread():
        inverse = np.linalg.solve(delta, vectors[:, :k]).astype(np.float16)
        condition = float(np.linalg.cond(weighting))
    projection = left_inverse(inverse, weighting)
    total = energies.sum()
    return Reduction(inverse, projection, float(energies[k:].sum() / total) if total > 0 else 0.0, condition)


def left_inverse(inverse: NDArray, weighting: NDArray) -> NDArray:
    """The forward map (d, k) float64 of an inverse map (d, k): planes = forwardᵀ · coefficients are those whose
    inverse comes nearest to the coefficients under the weighting Δ (B, B).
    """
    delta = _all_colors(weighting)
    with single_thread():
        return delta.T @ np.linalg.pinv(delta @ inverse.astype(np.float64)).T


def _rounded(weighting: NDArray) -> NDArray:
    """To float32's precision: in the last bits of float64, BLAS libraries differ, and Δ⁻¹ would make more of it."""
    return weighting.astype(np.float32).astype(np.float64)


def _all_colors(weighting: NDArray) -> NDArray:
    return np.kron(weighting, np.eye(3))


def leading_signs(vectors: NDArray, ties: float = 0.0) -> NDArray:
    """±1 per column of (d, k) that makes its entry of largest magnitude positive; `ties` is by what share others may
    be smaller and still count as the largest, of which the first leads.
    """
    magnitudes = np.abs(vectors)
    leading = np.argmax(magnitudes >= magnitudes.max(axis=0) * (1 - ties), axis=0)
    signs = np.sign(vectors[leading, np.arange(vectors.shape[1])])
    return np.where(signs == 0, 1.0, signs)
