"""The plan of the profiles `fast`, `balanced` and `max`: steps from what an error does to the picture.

Against `paper`: absolute steps from measured sensitivities in place of σ/α; depth as −1/z, in two layers where 12 bits
are too coarse; ŝ through its own 3 × 3 PCA; rotations as three components relative to the view's dominant rotation;
VABR weighted by the second moment of the basis, so that all components are equally visible and one step is right; as
many components as carry more than the step lets through. What each gains: docs/FORMAT.md, "Profiles".
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..blas import single_thread
from ..gaussians import Gaussians
from ..inference import GraphStore
from .analysis import ProjectedLayer, coefficient_moment, color_planes, relative_rotation_planes
from .basis import reduce_basis, second_moment_weighting, view_directions, weighted_spectrum
from .hevc import MAX_CODE
from .planes import Channel, LayerPlan, PlaneClass, Reduction
from .profiles import AdaptiveSettings
from .quantize import hevc_step

_COARSE_DEPTH = 6.0
"""Step of the first depth layer in steps of the second, where two are needed."""


def class_step(settings: AdaptiveSettings, plane_class: PlaneClass, qp: float) -> float:
    """Quantiser step of a class in the units of its planes, at Q_g = `qp`."""
    return settings.gain / math.sqrt(settings.sensitivity[plane_class]) * 2 ** (qp / 6)


def adaptive_colors(
    store: GraphStore, layer: Gaussians, settings: AdaptiveSettings, qp: float
) -> tuple[NDArray, Reduction]:
    """Colour planes (V, k, H, W) and their maps, k by reverse water-filling against the colour step."""
    moment = coefficient_moment(store, layer)
    weighting = second_moment_weighting(view_directions(layer.cameras), layer.degree)
    spectrum = weighted_spectrum(moment, weighting)
    budget = settings.energy_floor * class_step(settings, PlaneClass.COLOR, qp) ** 2
    left_out = np.append(np.cumsum(spectrum[0][::-1])[::-1], 0.0)  # left_out[k]: energy without the first k
    k = max(1, int(np.argmax(left_out <= budget)))
    reduction = reduce_basis(spectrum, weighting, k)
    return color_planes(store, layer, reduction.projection), reduction


def adaptive_plan(
    projected: ProjectedLayer, colors: NDArray, reduction: Reduction, degree: int, settings: AdaptiveSettings, qp: float
) -> LayerPlan:
    """Channels and steps at Q_g = `qp`."""
    depth = projected.planes(PlaneClass.DEPTH)
    inverse = -1 / depth
    depth_step = settings.depth_step * float(-inverse.mean(dtype=np.float64)) * 2 ** (qp / 6)
    span = float(inverse.max()) - float(inverse.min())
    is_too_fine = depth_step < hevc_step(0) * span / MAX_CODE
    scale_planes, scale_mix = _principal_scales(projected.planes(PlaneClass.SCALE))
    planes = {
        PlaneClass.DEPTH: inverse,
        PlaneClass.COLOR: colors,
        PlaneClass.OPACITY: projected.planes(PlaneClass.OPACITY),
        PlaneClass.SCALE: scale_planes,
        PlaneClass.ROTATION: relative_rotation_planes(projected, projected.reference_quats),
        PlaneClass.OFFSET: projected.planes(PlaneClass.OFFSET),
    }
    channels = []
    for plane_class, values in planes.items():
        for target in range(values.shape[1]):
            channel = values[:, target]
            if plane_class == PlaneClass.DEPTH:
                step = depth_step * (_COARSE_DEPTH if is_too_fine else 1.0)
            else:
                step = class_step(settings, plane_class, qp)
            # A relative rotation's vector part goes to the channels behind w, which is rebuilt.
            index = target + 1 if plane_class == PlaneClass.ROTATION else target
            channels.append(Channel(plane_class, index, channel, step, (float(channel.min()), float(channel.max()))))
    return LayerPlan(
        tuple(channels),
        degree,
        (float(depth.min()), float(depth.max())),
        inverse_depth=True,
        refine_depth=depth_step if is_too_fine else None,
        reference_quats=projected.reference_quats.astype(np.float32),
        scale_mix=scale_mix,
        reduction=reduction,
    )


def _principal_scales(scales: NDArray) -> tuple[NDArray, tuple[NDArray, NDArray]]:
    """ŝ (V, 3, H, W) in its principal axes, and the map back: ŝ = mix · planes + mean."""
    flat = np.moveaxis(scales, 1, 0).reshape(3, -1)
    mean = flat.mean(axis=1, dtype=np.float64)
    centred = flat - mean[:, None].astype(np.float32)
    with single_thread():
        _, vectors = np.linalg.eigh((centred @ centred.T).astype(np.float64))
    vectors = vectors[:, ::-1]
    leading = np.abs(vectors).argmax(axis=0)
    vectors = (vectors * np.sign(vectors[leading, range(3)])).astype(np.float32)
    planes = (vectors.T @ centred).reshape(3, len(scales), *scales.shape[2:])
    return np.moveaxis(planes, 0, 1), (vectors, mean.astype(np.float32))
