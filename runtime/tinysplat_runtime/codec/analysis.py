"""Gaussians of one layer to real-valued planes: runs the analysis graphs (VPT and VABR) and what surrounds them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import NumericError
from ..gaussian.gaussians import FIELDS, Gaussians
from ..gaussian.planes import GEOMETRY, PlaneClass
from ..gaussian.quaternions import conjugate_quats, left_multiplication_matrices, matrices_to_quats
from ..graphs.inference import GraphStore, as_input
from ..scene.cameras import Camera
from ..system import disk
from ..system.blas import product, symmetric_eigen
from .basis import leading_signs

BLOCK_PIXELS = 1 << 16
"""About as many pixels are projected at a time."""

MAX_PLANE = 1e15
"""Largest magnitude of a plane's values: sums of a million of their squares stay inside float32."""

MAX_SH = 1e15
"""The same for SH coefficients."""


@dataclass(frozen=True)
class ProjectedLayer:
    """VPT's result.

    Attributes:
        geometry: (V, 11, H, W) float32, channels by `GEOMETRY`; depth is > 0 everywhere.
        reference_quats: (V, 4) float64, dominant eigenvector of each view's Σ q qᵀ, its largest
            component positive.
    """

    geometry: NDArray
    reference_quats: NDArray

    def planes(self, plane_class: PlaneClass) -> NDArray:
        """(V, C, H, W) float32 view of one class."""
        return self.geometry[:, GEOMETRY[plane_class]]


def project_layer(store: GraphStore, layer: Gaussians, *, drop_invalid: bool, where: str) -> ProjectedLayer:
    """VPT: depth, pixel offset, projected scale, camera-frame rotation, opacity.

    arXiv 2506.09479, view projection: z·(x, y, 1)ᵀ = K(Rμ + T), q̂ = Quat(R)·q, ŝ = f·s/z.

    Args:
        store: opens the graph.
        layer: per-pixel Gaussians.
        drop_invalid: make Gaussians at or behind their own camera transparent in place of refusing them.
        where: the layer's name for messages.

    Raises:
        NumericError: Gaussians with z ≤ 0, or with a plane beyond MAX_PLANE, named by view and count.
    """
    geometry, moment = _projected(store, layer)
    valid = np.stack([_is_valid(planes) for planes in geometry])
    if not valid.all():
        _handle_invalid(geometry, valid, drop_invalid, where)
        if not np.isfinite(moment).all():
            moment = _rotation_moment(geometry)
    reference = _dominant_quats(moment)
    rotation = geometry[:, GEOMETRY[PlaneClass.ROTATION]]
    # q and -q are the same rotation: the sign nearer to the reference keeps planes free of jumps.
    for quats, towards in zip(rotation, reference.astype(np.float32), strict=True):
        similarity = np.einsum("c,chw->hw", towards, quats)
        quats *= np.where(similarity < 0, np.float32(-1), np.float32(1))
    return ProjectedLayer(geometry, reference)


def _projected(store: GraphStore, layer: Gaussians) -> tuple[NDArray, NDArray]:
    """The graph's planes (V, 11, H, W), and second moments (V, 4, 4) of rotations; a block of rows at a time.

    What lies between input and planes then stays in a processor's cache, and takes no memory that grows.
    """
    views, height, width = layer.opacities.shape
    geometry, moments = disk.zeros((views, 11, height, width)), np.zeros((views, 4, 4), np.float32)
    graph, fixed = store.transform("analysis_vpt"), [_fixed_inputs(camera, layer.origin) for camera in layer.cameras]
    for view, block in blocks(geometry):
        K = layer.cameras[view].K.copy()
        K[1, 2] -= block.start
        inputs = {name: getattr(layer, name)[view : view + 1, block] for name in FIELDS if name != "sh"}
        out = graph.run({**inputs, **fixed[view], "K": as_input(K[None])})
        geometry[view, :, block] = out["geometry"][0]
        moments[view] += out["rotation_moment"][0] * np.float32((block.stop - block.start) / height)
    return geometry, moments


def _fixed_inputs(camera: Camera, origin: NDArray) -> dict[str, NDArray]:
    """What all blocks of a view are given: its pose, the centre in two parts."""
    centre = camera.centre - origin
    high = centre.astype(np.float32)
    return {
        "rotation": as_input(camera.rotation[None]),
        "rotation_quat": as_input(matrices_to_quats(camera.rotation[None])),
        "centre_high": high[None],
        "centre_low": as_input(centre - high)[None],
    }


def relative_rotation_planes(projected: ProjectedLayer, reference: NDArray, out: NDArray | None = None) -> NDArray:
    """Vector parts (V, 3, H, W) of reference⁻¹ ⊗ q, with the sign that makes the scalar part positive.

    Args:
        projected: VPT's result.
        reference: (V, 4) float64 unit quaternions.
        out: where to write them, which may be the last three of the rotations themselves; None for fresh memory.
    """
    left = left_multiplication_matrices(conjugate_quats(reference)).astype(np.float32)
    rotation = projected.planes(PlaneClass.ROTATION)
    vector = np.empty_like(rotation[:, 1:]) if out is None else out
    for view, block in blocks(rotation):
        quats = rotation[view, :, block]
        relative = product(left[view], quats.reshape(4, -1)).reshape(quats.shape)
        np.negative(relative[1:], out=relative[1:], where=relative[:1] < 0)
        vector[view, :, block] = relative[1:]
    return vector


def blocks(planes: NDArray) -> Iterator[tuple[int, slice]]:
    """Views of planes (V, C, H, W) and rows of each, about `BLOCK_PIXELS` at a time."""
    views, _, height, width = planes.shape
    rows = max(BLOCK_PIXELS // width, 1)
    for view in range(views):
        for first in range(0, height, rows):
            yield view, slice(first, min(first + rows, height))


def coefficient_moment(store: GraphStore, layer: Gaussians) -> NDArray:
    """(d, d) float64 uncentred second moment X Xᵀ / M of the layer's SH coefficients, X (d, M).

    arXiv 2506.09479, basis reduction: what its PCA decomposes, before the weighting Δ.

    Raises:
        NumericError: a coefficient whose square would leave float32.
    """
    moment = store.transform("analysis_moment").run({"sh": layer.sh})["moment"].astype(np.float64)
    if not np.abs(moment).max() <= MAX_SH**2:
        index = np.unravel_index(int(np.abs(layer.sh).argmax()), layer.sh.shape)
        found = f"a coefficient of {layer.sh[index]:.3g}, at most {MAX_SH:g} can be coded"
        raise NumericError(found, where=f"sh{[int(i) for i in index]}")
    return moment


def color_planes(store: GraphStore, layer: Gaussians, projection: NDArray) -> NDArray:
    """(V, k, H, W) float32 planes of the layer's SH coefficients under `projection` (d, k).

    arXiv 2506.09479, basis reduction: Z = WᵀΔX with projection = (WᵀΔ)ᵀ.
    """
    views, height, width = layer.opacities.shape
    planes = disk.zeros((views, projection.shape[1], height, width))
    graph, mix = store.transform("analysis_project"), as_input(projection)
    for view, block in blocks(planes):
        planes[view, :, block] = graph.run({"sh": layer.sh[view : view + 1, block], "projection": mix})["color"][0]
    return planes


def _is_valid(planes: NDArray) -> NDArray:
    """(H, W) bool of planes (11, H, W)."""
    valid: NDArray = planes[0] > 0
    # Largest and smallest per channel show NaN and what is too large faster than a look at every number.
    if not max(planes.max(), -planes.min()) <= MAX_PLANE:
        valid &= (np.abs(planes) <= MAX_PLANE).all(axis=0)
    return valid


def _handle_invalid(geometry: NDArray, valid: NDArray, drop_invalid: bool, where: str) -> None:
    counts = (~valid).sum(axis=(1, 2))
    view = int(np.argmax(counts > 0))
    if not drop_invalid:
        raise NumericError(
            f"view {view}: {counts[view]} Gaussians at or behind their own camera (z ≤ 0) or beyond {MAX_PLANE:g}"
            f" ({int(counts.sum())} in all); expected z > 0, or --drop-invalid to make them transparent",
            where=where,
        )
    if not valid.any():
        raise NumericError(f"every Gaussian is at or behind its own camera or beyond {MAX_PLANE:g}", where=where)
    # A dropped pixel takes its view's median everywhere but in opacity, so that it costs next to nothing.
    for planes, mask in zip(geometry, valid, strict=True):
        seen = planes[:, mask] if mask.any() else np.moveaxis(geometry, 1, 0)[:, valid]
        planes[:, ~mask] = np.median(seen, axis=1)[:, None]
        planes[GEOMETRY[PlaneClass.OPACITY], ~mask] = 0


def _rotation_moment(geometry: NDArray) -> NDArray:
    q = geometry[:, GEOMETRY[PlaneClass.ROTATION]].reshape(len(geometry), 4, -1)
    return product(q, q.swapaxes(1, 2)) / q.shape[2]


def _dominant_quats(moments: NDArray) -> NDArray:
    dominant = np.stack([symmetric_eigen(moment)[1][:, -1] for moment in moments.astype(np.float64)])
    return dominant * leading_signs(dominant.T)[:, None]
