"""3-D Gaussians to 2-D splats: EWA projection, colours, and the part of the image that each splat reaches.

The definition, with p the mean in the camera frame and (u, v) its pixel: Σ₂ = J W Σ Wᵀ Jᵀ + 0.3·1 (pixels²), J the
projection's Jacobian at the mean (Zwicker et al. 2001; Kerbl et al. 2023). Far outside the image J explodes, so its
point is clamped to the image widened by 15 % of its size on each side. That is 3DGS's 1.3·tan(fov/2), with limits
per side as in gsplat where the principal point is off centre; a skewed K is clamped in pixels all the same.

Dilation in own pixels is an option. A splat that stands for a photo's pixel, m pixels wide on the screen, is dilated by
e = max(0.3, 0.3·m² − λ) in place of 0.3, λ the lesser eigenvalue of Σ₂ before dilation: what closes a surface in its
photo closes it however near the camera comes, and what closes it by itself is left as sharp as it is. Where m < 1 the
screen needs 0.3 still, so the opacity falls by √(det(Σ + 0.3·m²·1) / det(Σ + 0.3·1)): the splat covers more, but hides
no more than it did in its photo (both ideas: Yu et al. 2024, Mip-Splatting, there with a footprint of its own in 3-D).

Nothing below forms a covariance and inverts it. With m₁, m₂ the rows of J·W·R(q)·diag(s), Σ₂ has the entries
a = |m₁|² + 0.3, b = m₁·m₂, c = |m₂|² + 0.3, and its determinant is |m₁ × m₂|² + 0.3 (a + c) − 0.09, without the
cancellation of a·c − b² that ruins needles in float32. The exponent at (x, y) is then

    ½ dᵀ Σ₂⁻¹ d = (αx·dx + βx·dy)² + (γ·dy)²,   γ² = 1/(2c),  αx² = c/(2 det),  βx = −αx·b/c.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..gaussian.sh import C0, sh_degree, sh_terms
from ..scene.cameras import Camera
from ..system.blas import product
from .prepare import ALPHA_MIN, Block, Part, principal_axes

DILATION = 0.3
"""Variance in pixels² added to both axes of every splat, so that none falls between the pixels."""

LEAST_VARIANCE = 1e-12
"""Pixels²: a splat narrower than this has no width of its own."""

LEAST_OWN_PIXEL = 1 / 8
"""Own pixels on the screen, in its pixels, below which a splat fades no further: it would fall under 1/255."""

JACOBIAN_MARGIN = 0.15
"""Share of the image's size by which the Jacobian's point may lie outside: 1.3·tan(fov/2) without its centring."""

WIDE_PX = 256.0
"""Standard deviation above which a splat is projected in float64: the edge of a needle this long, seen at three
deviations, moves by about 1e-4 px in float32."""

LIMIT = 1e30
"""Finite stand-in for what float32 cannot hold: products with it may reach infinity, but never 0·∞."""

MARGIN_PX = 1 / 64
"""Footprints are widened by this much against rounding; whether a pixel is covered is decided by its alpha."""

RECORD = 8
"""Floats in a row of `Splats.records`: numpy picks rows of 32 bytes two to three times as fast as rows of 36."""

_FARTHEST = 1.001 * math.sqrt(2 * math.log(1 / ALPHA_MIN))
"""Half extents of footprints are at most so many standard deviations, and a little against rounding."""

# Columns of `Splats.records`
X, Y, ALPHA_X, BETA_X, GAMMA, RED, GREEN, BLUE = range(RECORD)


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
        """The view of a camera on Gaussians whose means are relative to `origin`, (3,) float64."""
        K = camera.K.copy()
        K[:2, 2] = 0
        return cls(camera, origin - camera.centre, product(K, camera.rotation), near_plane)


class Splats:
    """The splats of one frame: rows for the Gaussians of all blocks, of which those that show nowhere are not touched.

    Memory that nothing touches is none. Later stages pick rows in no order that a cache could guess, so what they need
    together lies together.

    Attributes:
        count: N, the rows. One more, `blank`, is a splat without opacity, to fill lists up with.
        records: (N + 1, 8) float32: pixel of the mean, the exponent's factors, colour.
        log_opacities: (N + 1,) float32.
        fronts: (N + 1,) float32, the share of their alphas that is drawn before all others; where any is.
        depths: (N + 1,) float32.
        boxes: (3, N) int16: first and last row of the tiles of the footprint's bounding box, and how many columns.
    """

    def __init__(self, count: int) -> None:
        self.count = self.blank = count
        self.records = np.empty((count + 1, RECORD), np.float32)
        self.records[-1] = 0
        self.log_opacities, self.fronts = np.empty((2, count + 1), np.float32)
        self.log_opacities[-1], self.fronts[-1] = -np.inf, 0
        self.depths = np.empty(count + 1, np.float32)
        self.depths[-1] = 0
        self.boxes = np.empty((3, count), np.int16)


@np.errstate(all="ignore")  # overflow is met by float64 and by LIMIT, NaN is looked for
def project(
    block: Block,
    view: View,
    tile: tuple[int, int],
    splats: Splats,
    *,
    first: int = 0,
    shares: tuple[float, float] = (0, 1),
) -> NDArray:
    """Project a block into rows of `splats`.

    Visible are splats whose mean lies beyond the near plane and whose footprint holds a pixel centre.

    Args:
        block: the Gaussians.
        view: the camera.
        tile: (width, height) of a tile in pixels.
        splats: where to write.
        first: the first of these rows.
        shares: of their alphas that is drawn before all others, and of their opacities that they have.

    Returns:
        (m,) int32, the rows of visible splats, rising and in the block's order.
    """
    planes = np.empty((RECORD, block.size), np.float32)
    front, opaque = shares
    log_opacities = block.log_opacities + np.float32(math.log(opaque))
    ray = block.means + view.offset[:, None]  # (3, n) float64, from the camera centre
    point = np.einsum("ij,jn->in", view.projection, ray)
    in_front = point[2] > view.near_plane
    if not in_front.any():
        return np.zeros(0, np.int32)
    inverse_z = 1 / point[2]
    centred = point[:2] * inverse_z  # pixels from the principal point
    np.add(centred, view.camera.K[:2, 2:], out=planes[X : Y + 1], casting="same_kind")
    extents, wide = _shapes(block, view, centred, inverse_z, in_front, planes, log_opacities)
    (left, right), (top, bottom) = (
        pixels_between(centre - extent, centre + extent, size)
        for centre, extent, size in zip(planes[: Y + 1], extents, (view.camera.width, view.camera.height), strict=True)
    )
    keep = np.flatnonzero((left <= right) & (top <= bottom) & in_front)
    if not keep.size:
        return np.zeros(0, np.int32)
    left[wide], right[wide] = 0, view.camera.width - 1
    _colours(block, ray, keep, planes[RED : BLUE + 1])
    rows = slice(first, first + keep.size)
    # turned over first, as numpy picks rows in half the time that it picks columns in
    np.ascontiguousarray(planes.T).take(keep, axis=0, out=splats.records[rows], mode="wrap")
    splats.log_opacities[rows], splats.fronts[rows] = log_opacities.take(keep), front
    splats.depths[rows] = np.minimum(point[2].take(keep), LIMIT)
    left, right, top, bottom = (edges.take(keep) for edges in (left, right, top, bottom))
    splats.boxes[0, rows], splats.boxes[1, rows] = top // tile[1], bottom // tile[1]
    splats.boxes[2, rows] = right // tile[0] - left // tile[0] + 1
    return np.arange(rows.start, rows.stop, dtype=np.int32)


@np.errstate(all="ignore")
def may_show(part: Block | Part, view: View, every: int = 1) -> NDArray:
    """(n,) bool, false where a Gaussian cannot reach the picture, whatever its orientation and opacity; of one in
    `every` alone, (ceil(n / every),).

    A row of J·W is nowhere longer than at the ends of the image's margin, so that a footprint's half extent is at most
    √(2 ln 255) times the sum of that length by the largest scale and of the root of the dilation.
    """
    if isinstance(part, Block):
        means, scales, own = part.means, part.scales, part.own_pixels
    else:
        means, scales, own = np.ascontiguousarray(part.rows["means"].T), part.rows["scales"], part.own_pixels
    means, scales, own = means[:, ::every], scales[::every], None if own is None else own[::every]
    point = np.einsum("ij,jn->in", view.projection, means + view.offset[:, None])
    depth = point[2]
    largest = np.maximum(np.maximum(scales[:, 0], scales[:, 1]), scales[:, 2])
    widened = depth if own is None else np.maximum(depth, np.abs(own) * view.camera.focal)
    widened = math.sqrt(DILATION) * widened
    shows = depth > view.near_plane
    for axis, (size, row) in enumerate(zip((view.camera.width, view.camera.height), _longest_rows(view), strict=True)):
        extent = _FARTHEST * (row * largest + widened)
        middle = size / 2 - view.camera.K[axis, 2]
        shows &= ~(np.abs(point[axis] - middle * depth) > (size / 2 + 1) * depth + extent)  # NaN stays
    return shows


@np.errstate(all="ignore")
def parts_show(parts: Sequence[Part], view: View) -> NDArray:
    """(parts,) bool, false where none of a part's Gaussians can reach the picture, as far as its `bounds` tell.

    Where z > 0, what `may_show` holds against 0 is not less than a function that is linear in the place, so that this
    one's least value over a box lies in a corner.
    """
    bounds = np.stack([of.bounds for of in parts])
    x, y, z = (bounds[:, axis : axis + 4 : 3] for axis in range(3))  # (parts, 2) each
    corners = np.stack(np.broadcast_arrays(x[:, :, None, None], y[:, None, :, None], z[:, None, None, :]))
    point = np.einsum("ij,jn->in", view.projection, corners.reshape(3, -1) + view.offset[:, None])
    point, (largest, own) = point.reshape(3, len(parts), 8), bounds[:, 6:].T
    shows = (point[2] > view.near_plane).any(axis=1) | np.isnan(point[2]).any(axis=1)
    for axis, (size, row) in enumerate(zip((view.camera.width, view.camera.height), _longest_rows(view), strict=True)):
        beside = point[axis] - (size / 2 - view.camera.K[axis, 2]) * point[2]
        ends = (size / 2 + 1 + _FARTHEST * math.sqrt(DILATION)) * point[2]
        ends += _FARTHEST * (row * largest + math.sqrt(DILATION) * own * view.camera.focal)[:, None]
        shows &= ~((beside > ends).all(axis=1) | (-beside > ends).all(axis=1))
    return shows


def _longest_rows(view: View) -> list[float]:
    """Of J·W times z, by axis: the greatest length of the row at the ends of the image's margin."""
    rows = view.projection[:2, None] - np.stack(jacobian_limits(view), axis=1)[..., None] * view.projection[2]
    return np.linalg.norm(rows, axis=2).max(axis=1).tolist()


def footprint_exponent(log_opacities: NDArray) -> NDArray:
    """τ (N,) float32, the exponent at which a footprint ends: opacity·exp(−τ) = 1/255."""
    return log_opacities - np.float32(math.log(ALPHA_MIN))


def is_wide(half_width: NDArray, half_height: NDArray) -> NDArray:
    """(N,) bool: whether half extents (N,) per √τ, in pixels, are too large for float32, or NaN."""
    return ~(half_width + half_height < WIDE_PX)


def _shapes(
    block: Block,
    view: View,
    centred: NDArray,
    inverse_z: NDArray,
    in_front: NDArray,
    planes: NDArray,
    log_opacities: NDArray,
) -> tuple[NDArray, NDArray]:
    """Write the exponent's factors into `planes`, lower `log_opacities`, and take what cannot show out of `in_front`.

    Returns:
        (2, n) half extents of the footprints, pixels, and the indices of wide ones.
    """
    low, high = jacobian_limits(view)
    clamped = np.clip(centred, low[:, None], high[:, None])
    half = np.empty((2, block.size), np.float32)
    outs = [*planes[ALPHA_X : GAMMA + 1], *half]
    inverse_z = inverse_z.astype(np.float32)
    own_pixels = None if block.own_pixels is None else block.own_pixels * np.float32(view.camera.focal) * inverse_z
    factors, log_share = _factors(_jacobian(view, clamped.astype(np.float32), inverse_z), block.axes, own_pixels)
    for out, values in zip(outs, factors, strict=True):
        out[:] = values
    log_opacities += log_share
    wide = np.flatnonzero(is_wide(*half) & in_front)
    if wide.size:
        planes[: GAMMA + 1, wide], half[:, wide], log_opacities[wide] = wide_shapes(block, view, wide)
        in_front[wide] &= np.isfinite(planes[: GAMMA + 1, wide]).all(axis=0)  # NaN is among the wide
    in_front &= log_opacities >= np.float32(math.log(ALPHA_MIN))
    return half * np.sqrt(footprint_exponent(log_opacities)), wide


@np.errstate(all="ignore")
def wide_shapes(block: Block, view: View, rows: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Project `rows` (m,) of a block in float64.

    Returns:
        (5, m) pixels and factors of the exponent, (2, m) half extents per √τ, both float32 within `LIMIT`, or NaN, and
        (m,) float32 log opacities.
    """
    point = np.einsum("ij,jn->in", view.projection, block.means[:, rows] + view.offset[:, None])
    centred = point[:2] / point[2]
    low, high = jacobian_limits(view)
    jacobian = _jacobian(view, np.clip(centred, low[:, None], high[:, None]), 1 / point[2])
    axes = principal_axes(block.quats[rows].astype(np.float64), block.scales[rows].astype(np.float64))
    own_pixels = None if block.own_pixels is None else block.own_pixels[rows] * view.camera.focal / point[2]
    factors, log_share = _factors(jacobian, axes, own_pixels)
    values = np.stack([*(centred + view.camera.K[:2, 2:]), *factors])
    values = np.clip(values, -LIMIT, LIMIT).astype(np.float32)
    log_opacities = block.log_opacities[rows] + np.nan_to_num(log_share).astype(np.float32)
    return values[: GAMMA + 1], values[GAMMA + 1 :], log_opacities


def jacobian_limits(view: View) -> tuple[NDArray, NDArray]:
    """(2,) each: least and greatest pixel of the Jacobian's point, counted from the principal point."""
    size, principal = np.array([view.camera.width, view.camera.height]), view.camera.K[:2, 2]
    return -JACOBIAN_MARGIN * size - principal, (1 + JACOBIAN_MARGIN) * size - principal


def _jacobian(view: View, clamped: NDArray, inverse_z: NDArray) -> NDArray:
    """J·W (2, 3, n) at pixels `clamped` (2, n), counted from the principal point: ((K R)_i − u_i·R_2) / z."""
    rows = view.projection[:, :, None].astype(clamped.dtype)
    return (rows[:2] - clamped[:, None] * rows[2]) * inverse_z


def _factors(
    jacobian: NDArray, axes: NDArray, own_pixels: NDArray | None
) -> tuple[tuple[NDArray, ...], NDArray | float]:
    """The exponent's factors, and what dilation costs in opacity.

    Args:
        jacobian: (2, 3, n) J·W.
        axes: (3, 3, n) principal axes.
        own_pixels: (n,) width of own pixels on the screen, in its pixels; None to dilate by the screen's alone.

    Returns:
        αx, βx, γ, half the width and height per √τ, (n,) each; the logarithm of the share of the opacity that is left.
    """
    m1, m2 = (np.einsum("jn,jkn->kn", row, axes) for row in jacobian)
    width, b, height = (np.einsum("kn,kn->n", u, v) for u, v in ((m1, m1), (m1, m2), (m2, m2)))
    area = sum(np.square(m1[i] * m2[j] - m1[j] * m2[i]) for i, j in ((0, 1), (1, 2), (2, 0)))
    trace, own = width + height, None
    dilation: NDArray | float = DILATION
    if own_pixels is not None:
        own = DILATION * np.square(np.clip(np.abs(own_pixels), LEAST_OWN_PIXEL, math.sqrt(LIMIT)))
        own = np.where(own_pixels > 0, own, np.maximum(own, np.float32(DILATION)))
        largest = 0.5 * (trace + np.hypot(width - height, 2 * b))
        dilation = np.maximum(own - area / np.maximum(largest, LEAST_VARIANCE), DILATION)
    a, c = width + dilation, height + dilation
    det = area + dilation * (trace + dilation)
    alpha_x = np.sqrt(0.5 * c / det)
    log_share = 0.0 if own is None else np.where(own < DILATION, 0.5 * np.log((area + own * (trace + own)) / det), 0)
    return (alpha_x, -alpha_x * (b / c), np.sqrt(0.5 / c), np.sqrt(2 * a), np.sqrt(2 * c)), log_share


def pixels_between(low: NDArray, high: NDArray, size: int) -> tuple[NDArray, NDArray]:
    """First and last of `size` pixels, int32, any shape, with centres from low to high; first > last where none are."""
    first = np.ceil(np.clip(low - np.float32(0.5 + MARGIN_PX), 0, size))
    last = np.floor(np.clip(high - np.float32(0.5 - MARGIN_PX), -1, size - 1))
    return first.astype(np.int32), last.astype(np.int32)


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
