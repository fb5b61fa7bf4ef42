"""What a prediction lacks, as planes, and the sum of both: the codec's part of mode `hybrid`.

Encoder and decoder run the same network on the same decoded photos and project what it gives; the planes hold the
difference in float, in the units of docs/FORMAT.md. Nothing else depends on the prediction: pictures decode without
it, so that another processor's last bits move a Gaussian by as little, and never drift.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..container.layers import LayerHeader
from ..errors import FormatError, InputError
from ..gaussian.gaussians import Gaussians
from ..gaussian.planes import CODING_ORDER, GEOMETRY, Channel, LayerPlan, PlaneClass, Reduction
from ..graphs.inference import GraphStore
from .adaptive import kept_components, with_enough_depth_pictures
from .analysis import ProjectedLayer, coefficient_moment, color_planes, project_layer
from .base import fitted_sh
from .basis import reduce_basis, second_moment_weighting, view_directions, weighted_spectrum
from .depth_step.allocation import Steps
from .profiles import ADAPTIVE_PROFILES, AdaptiveSettings, Profile


def hybrid_settings(profile: Profile) -> AdaptiveSettings:
    """The profile's steps; InputError for `paper`, whose steps say nothing of differences."""
    if not isinstance(profile.settings, AdaptiveSettings):
        accepted = ", ".join(ADAPTIVE_PROFILES)
        raise InputError(f"'{profile.name}' with mode hybrid, accepted are {accepted}", where="profile")
    return profile.settings


def predicted_geometry(store: GraphStore, prediction: Gaussians, where: str) -> NDArray:
    """(V, 11, H, W) float32 planes of a network's layer, with −1/z for depth.

    A Gaussian that the network puts behind its camera has no depth: the view's median stands in, with opacity 0.
    """
    geometry = project_layer(store, prediction, drop_invalid=True, where=where).geometry
    depth = geometry[:, GEOMETRY[PlaneClass.DEPTH]]
    np.divide(-1, depth, out=depth)
    return geometry


def residual_plan(
    store: GraphStore,
    layer: Gaussians,
    projected: ProjectedLayer,
    prediction: Gaussians,
    steps: Steps,
    settings: AdaptiveSettings,
    qp: float,
) -> LayerPlan:
    """Channels for the difference between a layer and its prediction at Q_g = `qp`, given the steps at 0."""
    predicted = predicted_geometry(store, prediction, "prediction")
    geometry = projected.geometry.copy()
    depth = geometry[:, 0]
    limits = (float(depth.min()), float(depth.max()))
    np.divide(-1, depth, out=depth)
    scale = 2 ** (qp / 6)
    rotation = GEOMETRY[PlaneClass.ROTATION]
    similarity = (geometry[:, rotation] * predicted[:, rotation]).sum(axis=1, keepdims=True)
    geometry[:, rotation] *= np.where(similarity < 0, np.float32(-1), np.float32(1))
    geometry -= predicted
    difference = replace(layer, sh=layer.sh - fitted_sh(prediction.sh, layer.sh.shape), extra_layers=())
    colors, reduction = _colours(store, difference, steps[PlaneClass.COLOR] * scale, settings)

    channels = []
    for plane_class in CODING_ORDER:
        planes = colors if plane_class == PlaneClass.COLOR else geometry[:, GEOMETRY[plane_class]]
        step = steps[plane_class] * scale
        for target in range(planes.shape[1]):
            values = planes[:, target]
            window = (float(values.min()), float(values.max()))
            channels.append(Channel(plane_class, target, values, step, window, flat_share=settings.flat_share))
    plan = LayerPlan(tuple(channels), layer.degree, limits, inverse_depth=True, reduction=reduction)
    return with_enough_depth_pictures(plan)


def _colours(
    store: GraphStore, difference: Gaussians, step: float, settings: AdaptiveSettings
) -> tuple[NDArray, Reduction]:
    """Colour planes of the difference; as many components as carry more than the step lets through."""
    weighting = second_moment_weighting(view_directions(difference.cameras), difference.degree)
    spectrum = weighted_spectrum(coefficient_moment(store, difference), weighting)
    reduction = reduce_basis(spectrum, weighting, kept_components(spectrum[0], step, settings))
    return color_planes(store, difference, reduction.projection), reduction


def check_prediction(layer: LayerHeader, prediction: Gaussians, index: int) -> None:
    """FormatError unless the network gave the grid that the layer corrects."""
    found = prediction.opacities.shape
    if found != (len(layer.cameras), layer.height, layer.width):
        expected = f"{layer.width}x{layer.height}"
        message = f"{expected}, but the network gives {found[2]}x{found[1]} for it"
        raise FormatError(message, where=f"layer {index}")
