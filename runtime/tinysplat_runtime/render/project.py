"""3-D Gaussians to 2-D splats: EWA projection, colours, and the part of the image that each splat reaches.

The definition, with p the mean in the camera frame and (u, v) its pixel: Σ₂ = J W Σ Wᵀ Jᵀ + 0.3·1 (pixels²), J the
projection's Jacobian at the mean (Zwicker et al. 2001; Kerbl et al. 2023). Far outside the image J explodes, so its
point is clamped to the image widened by 15 % of its size on each side. That is 3DGS's 1.3·tan(fov/2), with limits
per side as in gsplat where the principal point is off centre; a skewed K is clamped in pixels all the same.

Nothing below forms a covariance and inverts it. With m₁, m₂ the rows of J·W·R(q)·diag(s), Σ₂ has the entries
a = |m₁|² + 0.3, b = m₁·m₂, c = |m₂|² + 0.3, and its determinant is |m₁ × m₂|² + 0.3 (a + c) − 0.09, without the
cancellation of a·c − b² that ruins needles in float32. The exponent at (x, y) is then

    ½ dᵀ Σ₂⁻¹ d = (αx·dx + βx·dy)² + (γ·dy)²,   γ² = 1/(2c),  αx² = c/(2 det),  βx = −αx·b/c.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.cameras import Camera
from tinysplat_runtime.sh import C0, sh_degree, sh_terms
from .prepare import ALPHA_MIN, Block, principal_axes

DILATION = 0.3
"""Variance in pixels² added to both axes of every splat, so that none falls between the pixels."""

JACOBIAN_MARGIN = 0.15
"""Share of the image's size by which the Jacobian's point may lie outside: 1.3·tan(fov/2) without its centring."""

WIDE_PX = 256.0
"""Standard deviation above which a splat is projected in float64: the edge of a needle this long, seen at three
deviations, moves by about 1e-4 px in float32."""

LIMIT = 1e30
"""Finite stand-in for what float32 cannot hold: products with it may reach infinity, but never 0·∞."""

SPAN_MARGIN_PX = 1 / 64
"""Footprints are widened by this much against rounding; whether a pixel is covered is decided by its alpha."""

# Rows of `Splats.planes`
X, Y, ALPHA_X, BETA_X, GAMMA, LOG_OPACITY, RED, GREEN, BLUE, DEPTH = range(10)
# Rows of `Splats.spans`
Y_RIGHTMOST, SLOPE, REACH = range(3)


@dataclass(frozen=True, eq=False)
class View:
    """The camera as projection needs it.

    Attributes:
        camera: where the picture is taken.
        offset: (3,) float64, what `means` need to be relative to the camera centre. Taken in float64, so that scenes
            far from the world's origin keep their precision.
        projection: (3, 3) float64, K·R without the principal point.
        near_plane: smallest depth z that is drawn, scene units.
    """

    camera: Camera
    offset: NDArray
    projection: NDArray
    near_plane: float

    @classmethod
    def of(cls, camera: Camera, origin: NDArray, near_plane: float) -> View:
        """The view of a camera on Gaussians whose means are relative to `origin`."""
        K = camera.K.copy()
        K[:2, 2] = 0
        return cls(camera, origin - camera.centre, K @ camera.rotation, near_plane)


class Splats:
    """Buffers for the splats of one frame: a column for every Gaussian of the blocks, seen or not.

    Attributes:
        planes: (10, N + 1) float32: pixel of the mean, the exponent's factors, log opacity, colour, depth. The last
            column is a splat without opacity, for lists to be padded with.
        spans: (3, N) float32: dy of the rightmost point of the footprint, slope of its chords' middles, and 1/αx.
        bounds: (4, N) int32: first and last column, first and last row of the pixels in the footprint's bounding box.
    """

    def __init__(self, capacity: int) -> None:
        self.planes = np.zeros((10, capacity + 1), np.float32)
        self.planes[LOG_OPACITY, -1] = -np.inf
        self.spans = np.zeros((3, capacity), np.float32)
        self.bounds = np.zeros((4, capacity), np.int32)


def project(block: Block, view: View, splats: Splats) -> NDArray:
    """Project a block into its columns of `splats`.

    Args:
        block: the Gaussians.
        view: the camera.
        splats: where to write. Columns of splats that are not visible are left with any content, since leaving gaps
            costs less than closing them.

    Returns:
        (m,) int64, the columns of visible splats, rising. A splat is visible if its mean lies beyond the near plane
        and its footprint holds a pixel centre.
    """
    columns = slice(block.first, block.first + block.size)
    planes = splats.planes[:, columns]
    with np.errstate(all="ignore"):  # overflow is met by float64 and by LIMIT, NaN fails every comparison below
        ray = block.means + view.offset[:, None]  # (3, n) float64, from the camera centre
        point = np.einsum("ij,jn->in", view.projection, ray)
        in_front = point[2] > view.near_plane
        if not in_front.any():
            return np.zeros(0, np.int64)
        inverse_z = 1 / point[2]
        centred = point[:2] * inverse_z  # pixels from the principal point
        np.add(centred, view.camera.K[:2, 2:], out=planes[X : Y + 1], casting="same_kind")
        planes[LOG_OPACITY] = block.log_opacities
        planes[DEPTH] = np.minimum(point[2], LIMIT)
        half = _shapes(block, view, centred, inverse_z, in_front, planes, splats.spans[:, columns])
        visible = np.flatnonzero(_bounds(view, planes, half, splats.bounds[:, columns]) & in_front)
        if visible.size:
            _colours(block, ray, visible, planes[RED : BLUE + 1])
    return visible + block.first


def _shapes(
    block: Block, view: View, centred: NDArray, inverse_z: NDArray, in_front: NDArray, planes: NDArray, spans: NDArray
) -> NDArray:
    """Write the exponent's factors and the spans; returns (2, n) half extents of the footprints per √τ, pixels."""
    size = np.array([[view.camera.width], [view.camera.height]])
    principal = view.camera.K[:2, 2:]
    low, high = -JACOBIAN_MARGIN * size - principal, (1 + JACOBIAN_MARGIN) * size - principal
    clamped = np.clip(centred, low, high)
    # J·W row by row: (K R)_i − u_i·R_2, over z
    jacobian = (view.projection[:2, :, None] - clamped[:, None] * view.projection[2][:, None]) * inverse_z
    half = np.empty((2, block.size), np.float32)
    outs = [*planes[ALPHA_X : GAMMA + 1], *spans, *half]
    for out, values in zip(outs, _factors(jacobian.astype(np.float32), block.axes), strict=True):
        out[:] = values
    wide = np.flatnonzero(~(half[0] + half[1] < WIDE_PX) & in_front)
    if wide.size:
        axes = principal_axes(block.quats[wide].astype(np.float64), block.scales[wide].astype(np.float64))
        for out, values in zip(outs, _factors(jacobian.take(wide, axis=-1), axes), strict=True):
            out[wide] = np.clip(values, -LIMIT, LIMIT)
        spans[REACH, wide] = LIMIT  # the chords of a needle this long are beyond float32: take whole rows
        planes[X : Y + 1, wide] = np.clip(planes[X : Y + 1, wide], -LIMIT, LIMIT)
    return half


def _factors(jacobian: NDArray, axes: NDArray) -> tuple[NDArray, ...]:
    """Of J·W (2, 3, n) and the principal axes (3, 3, n): αx, βx, γ, the three spans, and the half extents per √τ."""
    m1, m2 = (np.einsum("jn,jkn->kn", row, axes) for row in jacobian)
    a = np.einsum("kn,kn->n", m1, m1) + DILATION
    b = np.einsum("kn,kn->n", m1, m2)
    c = np.einsum("kn,kn->n", m2, m2) + DILATION
    det = DILATION * (a + c) - DILATION**2
    for i, j in ((0, 1), (1, 2), (2, 0)):
        det += np.square(m1[i] * m2[j] - m1[j] * m2[i])
    slope = b / c
    alpha_x = np.sqrt(0.5 * c / det)
    half_width = np.sqrt(2 * a)
    return (alpha_x, -alpha_x * slope, np.sqrt(0.5 / c), 2 * b / half_width, slope, 1 / alpha_x,
            half_width, np.sqrt(2 * c))  # fmt: skip


def _bounds(view: View, planes: NDArray, half: NDArray, bounds: NDArray) -> NDArray:
    """Write the pixel bounds of footprints; returns (n,) bool, which of them hold a pixel centre."""
    # The footprint ends where opacity·exp(−e) = 1/255, at the exponent e = τ.
    radius = np.sqrt(planes[LOG_OPACITY] - np.float32(math.log(ALPHA_MIN)))
    holds: NDArray | bool = True
    for axis, size in enumerate((view.camera.width, view.camera.height)):
        centre = planes[X + axis] - np.float32(0.5)
        extent = half[axis] * radius + np.float32(SPAN_MARGIN_PX)
        # cut at the image, so that the integers hold it
        low, high = np.clip(np.ceil(centre - extent), 0, size), np.clip(np.floor(centre + extent), -1, size - 1)
        bounds[2 * axis], bounds[2 * axis + 1] = low, high
        holds = holds & (low <= high)  # False for NaN
    return holds


def _colours(block: Block, ray: NDArray, visible: NDArray, out: NDArray) -> None:
    """Write clamp(0.5 + Σ_b Y_b(d)·sh_b, 0) of the visible rows into `out` (3, n)."""
    rows: slice | NDArray = slice(None)
    sh = block.sh
    if 2 * visible.size < block.size:  # otherwise picking the coefficients would cost more than using them all
        rows = visible
        ray, sh = ray.take(rows, axis=-1), sh.take(rows, axis=-1)
    x, y, z = (ray / np.sqrt(np.einsum("jn,jn->n", ray, ray))).astype(np.float32)
    basis = np.stack([np.full_like(x, C0), *sh_terms(x, y, z, sh_degree(sh.shape[0]))])  # (S, m)
    colours = np.einsum("bn,bcn->cn", basis, sh)
    colours += np.float32(0.5)
    # fmax and fmin prefer numbers to NaN, which coefficients near float32's end can sum to
    out[:, rows] = np.fmin(np.fmax(colours, 0), np.float32(LIMIT))
