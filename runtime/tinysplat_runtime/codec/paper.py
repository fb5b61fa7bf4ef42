"""The plan of profile `paper`: the configuration of arXiv 2506.09479.

Planes are z, offset, ŝ, the camera-frame quaternion, opacity and the k leading VABR components. A 14-bit integer step
is σ/α of the channel over all views, and HEVC quantises those integers at QP = Q_c + Q_g; the step that results,
σ/α · 64 · 2^((Q_c + Q_g − 4)/6), is what the 12-bit codes of `quantise` reproduce.
"""

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import Gaussians
from ..gaussian.planes import CODING_ORDER, GEOMETRY, Channel, LayerPlan, PlaneClass, Reduction
from ..graphs.inference import GraphStore
from .analysis import ProjectedLayer, coefficient_moment, color_planes
from .basis import mean_magnitude_weighting, reduce_basis, view_directions, weighted_spectrum
from .profiles import PaperSettings

_LEVELS = 1 << 14
_HEVC_STEP_14_BITS = 64.0  # 2^(14 − 8), quantiser step in 14-bit codes at QP 4


def paper_colors(store: GraphStore, layer: Gaussians, settings: PaperSettings) -> tuple[NDArray, Reduction | None]:
    """Colour planes (V, k, H, W) float32 and VABR's maps; for SH degree 0 the three coefficients, and no VABR."""
    if layer.degree == 0:
        return np.ascontiguousarray(np.moveaxis(layer.sh[..., 0, :], -1, 1)), None
    moment = coefficient_moment(store, layer)
    weighting = mean_magnitude_weighting(view_directions(layer.cameras), layer.degree)
    reduction = reduce_basis(weighted_spectrum(moment, weighting), weighting, min(settings.k, len(moment)))
    return color_planes(store, layer, reduction.projection), reduction


def paper_plan(
    projected: ProjectedLayer, colors: NDArray, reduction: Reduction | None, degree: int, qp: float
) -> LayerPlan:
    """Channels and steps at Q_g = `qp`.

    arXiv 2506.09479, quantisation: σ_c/α, one step for all colours, and QP = Q_c + Q_g.

    `colors` is (V, k, H, W) float32, as `paper_colors` gives it.
    """
    channels: list[Channel] = []
    for plane_class in CODING_ORDER:
        planes = colors if plane_class == PlaneClass.COLOR else projected.planes(plane_class)
        sigmas = planes.std(axis=(0, 2, 3), dtype=np.float64)
        if plane_class == PlaneClass.COLOR:  # one step for all, from the dominant component
            sigmas[:] = sigmas[0] if reduction is not None else sigmas.max()
        channels += _class_channels(plane_class, planes, sigmas, qp)
    depth = projected.geometry[:, GEOMETRY[PlaneClass.DEPTH]]
    return LayerPlan(tuple(channels), degree, (float(depth.min()), float(depth.max())), reduction=reduction)


def _class_channels(plane_class: PlaneClass, planes: NDArray, sigmas: NDArray, qp: float) -> list[Channel]:
    channels = []
    for target, sigma in enumerate(sigmas):
        values = planes[:, target]
        low, high = float(values.min()), float(values.max())
        integer_step = float(sigma) / plane_class.facts.alpha
        step = integer_step * _HEVC_STEP_14_BITS * 2 ** ((plane_class.facts.class_qp + qp - 4) / 6)
        # The offset makes the minimum 0; what 14 bits do not reach from there is cut.
        window = (low, min(high, low + (_LEVELS - 1) * integer_step))
        channels.append(Channel(plane_class, target, values, step, window))
    return channels
