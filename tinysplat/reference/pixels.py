"""The rasteriser's definition in float64, at chosen pixels of pictures of any size.

Explicit covariances, their inverses and every Gaussian that can reach a pixel: no tiles, no float32, no thresholds but
those of the definition (docs/CONVENTIONS.md; Kerbl et al. 2023). A picture with a million Gaussians takes seconds at
1 % of its pixels, where evaluating all pairs would take hours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices
from tinysplat_runtime.gaussian.sh import sh_basis
from tinysplat_runtime.scene.cameras import Camera

ALPHA_MIN, ALPHA_MAX, TRANSMITTANCE_MIN = 1 / 255, 0.99, 1e-4
DILATION_PX2 = 0.3
JACOBIAN_MARGIN = 0.15

_BLOCK = 65_536


def choose_pixels(height: int, width: int, share: float, least: int, seed: int = 0) -> NDArray:
    """Sorted indices (P,) int64 of random pixels in row-major order: `share` of all, `least` of them or all."""
    total = height * width
    count = min(total, max(least, round(share * total)))
    return np.sort(np.random.default_rng(seed).choice(total, count, replace=False))


def render_pixels(
    gaussians: Gaussians,
    camera: Camera,
    pixels: NDArray,
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    near_plane: float = 0.01,
) -> NDArray:
    """Colours (P, 3) float64, not clipped, of the pixels with the row-major indices `pixels` (P,), sorted."""
    flat = gaussians.flat()
    offset = flat.origin - camera.centre
    parts = [
        _Pairs.of(flat, slice(start, start + _BLOCK), camera, offset, pixels, near_plane)
        for start in range(0, flat.opacities.size, _BLOCK)
    ]
    pairs = _Pairs(*(np.concatenate([getattr(part, name) for part in parts]) for name in _Pairs.__annotations__))
    colours, transmittance = _blend(pairs, _colours(flat, offset, pairs.index), len(pixels))
    return colours + transmittance[:, None] * np.asarray(background)


@dataclass(frozen=True)
class _Pairs:
    """Gaussians and the chosen pixels that they reach, (M,) each: pixel's place in the list, Gaussian, depth, alpha."""

    pixel: NDArray
    index: NDArray
    depth: NDArray
    alpha: NDArray

    @classmethod
    def of(
        cls, flat: Gaussians, rows: slice, camera: Camera, offset: NDArray, pixels: NDArray, near_plane: float
    ) -> _Pairs:
        """The pairs of some rows of the Gaussians."""
        opacities = flat.opacities[rows].astype(np.float64)
        points = (flat.means[rows].astype(np.float64) + offset) @ camera.rotation.T
        keep = np.flatnonzero((points[:, 2] > near_plane) & (opacities >= ALPHA_MIN))
        points, opacities = points[keep], opacities[keep]
        centres = (points @ camera.K.T)[:, :2] / points[:, 2:]
        covariances = _covariances(flat, keep + (rows.start or 0), camera, points)

        # Alpha is at least 1/255 within dᵀ Σ⁻¹ d ≤ 2 ln(255 o), an ellipse with these half widths.
        reach = np.sqrt(2 * np.log(opacities / ALPHA_MIN))
        half = reach[:, None] * np.sqrt(covariances[:, (0, 1), (0, 1)]) * (1 + 1e-9) + 1e-6
        which, place = _within(centres - half, centres + half, camera, pixels)

        at = np.stack([pixels[place] % camera.width, pixels[place] // camera.width], axis=-1) + 0.5
        d = at - centres[which]
        inverses = np.linalg.inv(covariances)[which]
        power = -0.5 * np.einsum("mi,mij,mj->m", d, inverses, d)
        alpha = np.minimum(ALPHA_MAX, opacities[which] * np.exp(power))
        seen = alpha >= ALPHA_MIN
        which, place = which[seen], place[seen]
        return cls(place, keep[which] + (rows.start or 0), points[which, 2], alpha[seen])


def _covariances(flat: Gaussians, rows: NDArray, camera: Camera, points: NDArray) -> NDArray:
    """(n, 2, 2) pixels²: J W Σ Wᵀ Jᵀ + 0.3, J at the point clamped to the widened image."""
    K, size = camera.K, np.array([camera.width, camera.height])
    z = points[:, 2]
    pixel = np.clip((points @ K.T)[:, :2] / z[:, None], -JACOBIAN_MARGIN * size, (1 + JACOBIAN_MARGIN) * size)
    x, y = np.linalg.solve(K, np.column_stack([pixel, np.ones_like(z)]).T)[:2]
    J = np.zeros((len(rows), 2, 3))
    J[:, 0, 0], J[:, 0, 1], J[:, 0, 2] = K[0, 0] / z, K[0, 1] / z, -(K[0, 0] * x + K[0, 1] * y) / z
    J[:, 1, 1], J[:, 1, 2] = K[1, 1] / z, -K[1, 1] * y / z
    axes = quats_to_matrices(normalize_quats(flat.quats[rows].astype(np.float64)))
    axes = axes * flat.scales[rows].astype(np.float64)[:, None, :]
    spread = J @ camera.rotation @ axes
    return spread @ spread.swapaxes(1, 2) + DILATION_PX2 * np.eye(2)


def _within(low: NDArray, high: NDArray, camera: Camera, pixels: NDArray) -> tuple[NDArray, NDArray]:
    """(Gaussian, place in `pixels`) of every chosen pixel whose centre lies in the box `low`…`high` (n, 2)."""
    first = np.clip(np.ceil(low - 0.5), 0, [camera.width, camera.height]).astype(np.int64)
    last = np.clip(np.floor(high - 0.5), -1, [camera.width - 1, camera.height - 1]).astype(np.int64)
    rows = np.where((last[:, 0] >= first[:, 0]), np.maximum(last[:, 1] - first[:, 1] + 1, 0), 0)
    which, row = _expand(rows)
    row += first[which, 1]
    start = np.searchsorted(pixels, row * camera.width + first[which, 0])
    stop = np.searchsorted(pixels, row * camera.width + last[which, 0], side="right")
    span, place = _expand(stop - start)
    return which[span], start[span] + place


def _expand(counts: NDArray) -> tuple[NDArray, NDArray]:
    """Index i repeated counts[i] times, and 0 … counts[i] − 1 beside it."""
    index = np.repeat(np.arange(len(counts)), counts)
    return index, np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts)


def _colours(flat: Gaussians, offset: NDArray, index: NDArray) -> NDArray:
    """(M, 3) colours of the Gaussians of all pairs as seen from the camera centre."""
    wanted, inverse = np.unique(index, return_inverse=True)
    directions = flat.means[wanted].astype(np.float64) + offset
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    basis = sh_basis(directions, flat.degree)
    colours = np.maximum(0.5 + np.einsum("nb,nbc->nc", basis, flat.sh[wanted].astype(np.float64)), 0)
    return colours[inverse]


def _blend(pairs: _Pairs, colours: NDArray, count: int) -> tuple[NDArray, NDArray]:
    """Front to back: colours (P, 3) and what light is left (P,)."""
    order = np.lexsort((pairs.index, pairs.depth, pairs.pixel))
    pixel, alpha, colours = pairs.pixel[order], pairs.alpha[order], colours[order]
    starts = np.searchsorted(pixel, np.arange(count))
    lengths = np.searchsorted(pixel, np.arange(count), side="right") - starts
    out, left, stopped = np.zeros((count, 3)), np.ones(count), np.zeros(count, bool)
    for rank in range(int(lengths.max(initial=0))):
        live = np.flatnonzero((lengths > rank) & ~stopped)
        row = starts[live] + rank
        rest = left[live] * (1 - alpha[row])
        blended = rest >= TRANSMITTANCE_MIN
        stopped[live[~blended]] = True
        live, row, rest = live[blended], row[blended], rest[blended]
        out[live] += (alpha[row] * left[live])[:, None] * colours[row]
        left[live] = rest
    return out, left
