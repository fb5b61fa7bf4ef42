"""The plan of the profiles `fast`, `balanced` and `max`: steps from what an error does to the picture.

Against `paper`: steps of equal slope in place of σ/α, depth's measured on the scene itself; depth as −1/z, in two
layers where 12 bits are too coarse; ŝ through its own 3 × 3 PCA; rotations as three components relative to the view's
dominant rotation; one colour per Gaussian where the input views agree about it, else VABR weighted by the second moment
of the basis, so that all components are equally visible and one step is right; as many components as carry more than
the step lets through. What each gains: docs/CODEC.md.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import Gaussians
from ..gaussian.planes import CODING_ORDER, MAX_CODE, Channel, LayerPlan, PlaneClass, Reduction, hevc_step
from ..graphs.inference import GraphStore
from ..system import disk
from ..system.blas import product, symmetric_eigen
from .analysis import ProjectedLayer, blocks, coefficient_moment, color_planes, relative_rotation_planes
from .basis import (
    leading_signs,
    needed_degree,
    reduce_basis,
    second_moment_weighting,
    view_directions,
    weighted_spectrum,
)
from .depth_step.allocation import Steps, measured_depth_step, measured_opacity_step
from .depth_step.contrast import block_offsets, contrast
from .depth_step.probe import Probe
from .one_colour import as_seen
from .profiles import AdaptiveSettings
from .quantise import extent, mean_of

COARSE_DEPTH = 2.0
"""Step of the first depth picture in steps of the second, where two are needed. Where that is too fine for 12 bits too,
the first comes out as fine as they allow; 3, 6 and 12 cost 1 to 3 % of depth's bytes."""

_WORTH_TWO_PICTURES = 0.5
"""Depth is coded twice when the step wanted is below this share of the finest that 12 bits have. Two pictures cost a
tenth more than one of the same step would: nearer to it, the bytes buy more in other classes."""

MEASURED = (PlaneClass.DEPTH, PlaneClass.OPACITY)
"""Classes whose steps follow from a look at the scene."""

_LEAST_WIDTH, _LARGEST_WIDTH = 0.2, 1.0
"""Mean standard deviations in pixels between which the steps of scale and rotation follow them."""


@dataclass(frozen=True, eq=False)
class LayerGeometry:
    """What a layer's planes but colour are, whatever the Q_g.

    Attributes:
        planes: (V, C, H, W) float32 by class: −1/z, opacities, principal scales, vector parts of relative rotations,
            pixel offsets.
        reference_quats, scale_mix: see `LayerPlan`.
    """

    planes: Mapping[PlaneClass, NDArray]
    reference_quats: NDArray
    scale_mix: tuple[NDArray, NDArray]


@dataclass(frozen=True, eq=False)
class AdaptiveLayer(LayerGeometry):
    """A layer's planes, colour components among them, and maps, before they have steps.

    Attributes:
        layer: the Gaussians, of the degree and with the colours that are stored.
        reduction: VABR's maps, of at least as many components as will be coded.
        energies: (d,) weighted energy of every component, falling.
        shown: (V, H, W) how much an error of depth shows; see `contrast`.
    """

    layer: Gaussians
    reduction: Reduction
    energies: NDArray
    shown: NDArray

    @cached_property
    def depth_offsets(self) -> NDArray:
        """Differences of the QPs of depth's blocks from the plane's, (V, rows, columns); see `Channel`."""
        return block_offsets(self.shown)


def class_step(settings: AdaptiveSettings, plane_class: PlaneClass) -> float:
    """Step of a class at Q_g = 0 where nothing is measured, in the units of its planes."""
    sensitivity = plane_class.facts.sensitivity
    assert sensitivity is not None, "depth's step is measured"
    return settings.gain / math.sqrt(sensitivity)


def take_geometry(projected: ProjectedLayer) -> LayerGeometry:
    """VPT's planes as they are coded, in the very memory of `projected`, which is not to be used any more."""
    depth, scales = projected.planes(PlaneClass.DEPTH), projected.planes(PlaneClass.SCALE)
    for of_view in depth:
        np.divide(-1, of_view, out=of_view)
    mix = _turn_to_principal(scales)
    vectors = projected.planes(PlaneClass.ROTATION)[:, 1:]
    planes = {
        PlaneClass.DEPTH: depth,
        PlaneClass.OPACITY: projected.planes(PlaneClass.OPACITY),
        PlaneClass.SCALE: scales,
        PlaneClass.ROTATION: relative_rotation_planes(projected, projected.reference_quats, out=vectors),
        PlaneClass.OFFSET: projected.planes(PlaneClass.OFFSET),
    }
    return LayerGeometry(planes, projected.reference_quats, mix)


def prepare_layer(
    store: GraphStore, layer: Gaussians, geometry: LayerGeometry, settings: AdaptiveSettings, qp: float
) -> AdaptiveLayer:
    """Planes of a layer, of as high a degree and with as many colour components as Q_g = `qp` could ask for."""
    step = class_step(settings, PlaneClass.COLOR) * 2 ** (qp / 6)
    layer = as_seen(layer, settings.disagreement * step**2) or layer
    directions, moment = view_directions(layer.cameras), coefficient_moment(store, layer)
    finest = step * 2**-settings.margin
    degree = needed_degree(moment, directions, layer.degree, settings.energy_floor * finest**2)
    functions = (degree + 1) ** 2
    if degree < layer.degree:
        sh = disk.zeros((*layer.opacities.shape, functions, 3))
        for fewer, every in zip(sh, layer.sh, strict=True):
            fewer[:] = every[..., :functions, :]
        # a look at every number takes 8 ms
        layer = layer.changed(sh=sh, extra_layers=())
    weighting = second_moment_weighting(directions, degree)
    spectrum = weighted_spectrum(moment[: 3 * functions, : 3 * functions], weighting)
    reduction = reduce_basis(spectrum, weighting, kept_components(spectrum[0], finest, settings))
    planes = {**geometry.planes, PlaneClass.COLOR: color_planes(store, layer, reduction.projection)}
    maps = geometry.reference_quats, geometry.scale_mix
    return AdaptiveLayer(planes, *maps, layer, reduction, spectrum[0], contrast(layer))


def scene_steps(layers: Sequence[AdaptiveLayer], settings: AdaptiveSettings, threads: int) -> list[Steps]:
    """Steps at Q_g = 0 of every class of every layer.

    Depth's is the same in all layers, as a unit of −1/z moves what is seen alike in all of them.

    Args:
        layers: the scene.
        settings: how much of the scene is looked at.
        threads: for looking; never changes the steps.
    """
    inverse = [layer.planes[PlaneClass.DEPTH][:, 0] for layer in layers]
    depth = settings.depth_step * -mean_of(inverse[0])
    opacity = class_step(settings, PlaneClass.OPACITY)
    shown, offsets = [layer.shown for layer in layers], [layer.depth_offsets for layer in layers]
    probe = Probe([layer.layer for layer in layers], inverse, shown, settings.stripes, threads)
    depth = measured_depth_step(probe, inverse, offsets, depth, settings.depth_damage, settings.rounds)
    opacities = [layer.planes[PlaneClass.OPACITY][:, 0] for layer in layers]
    opacity = measured_opacity_step(probe, opacities, opacity, settings.opacity_damage)
    return [
        {
            **known_steps(layer.scale_mix, index, settings),
            PlaneClass.DEPTH: depth,
            PlaneClass.OPACITY: opacity * _factor(index, settings),
        }
        for index, layer in enumerate(layers)
    ]


def _factor(index: int, settings: AdaptiveSettings) -> float:
    """Of the steps of a layer, but for depth's."""
    return settings.behind if index else 1.0


def shown_width(size: float, settings: AdaptiveSettings) -> float:
    """Of splats of a mean ŝ, in pixels, of which the rasteriser's dilation hides little; over the settings' own."""
    return min(max(size, _LEAST_WIDTH), _LARGEST_WIDTH) / settings.width


def known_steps(scale_mix: tuple[NDArray, NDArray], index: int, settings: AdaptiveSettings) -> Steps:
    """Steps at Q_g = 0 of the classes for which nothing is measured, of the layer of that index.

    `scale_mix` is (3, 3) and (3,) float32. Of a small splat, the rasteriser's dilation hides size and rotation.
    """
    width = shown_width(float(scale_mix[1].mean()), settings)
    hidden = {PlaneClass.SCALE: 1 / width, PlaneClass.ROTATION: 1 / width**2}
    return {
        c: class_step(settings, c) * hidden.get(c, 1.0) * _factor(index, settings)
        for c in CODING_ORDER
        if c not in MEASURED
    }


def known_channels(geometry: LayerGeometry, index: int, settings: AdaptiveSettings, qp: float) -> Iterator[Channel]:
    """Channels at Q_g = `qp` of the classes for which nothing is measured, but for colour."""
    for plane_class, step in known_steps(geometry.scale_mix, index, settings).items():
        if plane_class != PlaneClass.COLOR:
            yield from _channels(plane_class, geometry.planes[plane_class], step * 2 ** (qp / 6), settings)


def color_channels(layer: AdaptiveLayer, index: int, settings: AdaptiveSettings, qp: float) -> Iterator[Channel]:
    """Those of colour, as many as carry more than its step lets through."""
    step = known_steps(layer.scale_mix, index, settings)[PlaneClass.COLOR] * 2 ** (qp / 6)
    planes = layer.planes[PlaneClass.COLOR][:, : kept_components(layer.energies, step, settings)]
    return _channels(PlaneClass.COLOR, planes, step, settings)


def _channels(
    plane_class: PlaneClass, planes: NDArray, step: float, settings: AdaptiveSettings, offsets: NDArray | None = None
) -> Iterator[Channel]:
    for target in range(planes.shape[1]):
        values = planes[:, target]
        # A relative rotation's vector part goes to the channels behind w, which is rebuilt.
        index = target + 1 if plane_class == PlaneClass.ROTATION else target
        window = extent(values)
        yield Channel(plane_class, index, values, step, window, offsets, settings.flat_share)


def adaptive_plan(
    layer: AdaptiveLayer, steps: Steps, known: Sequence[Channel], settings: AdaptiveSettings, qp: float
) -> LayerPlan:
    """Channels and maps of a layer at Q_g = `qp`, given its steps at 0, `known_channels` and `color_channels`."""
    scale = 2 ** (qp / 6)
    depth_step, opacity_step = (steps[plane_class] * scale for plane_class in MEASURED)
    (depth,) = _channels(PlaneClass.DEPTH, layer.planes[PlaneClass.DEPTH], depth_step, settings, layer.depth_offsets)
    opacity = _channels(PlaneClass.OPACITY, layer.planes[PlaneClass.OPACITY], opacity_step, settings)
    components = sum(channel.plane_class == PlaneClass.COLOR for channel in known)
    plan = LayerPlan(
        tuple(sorted([depth, *opacity, *known], key=lambda channel: channel.plane_class)),
        layer.layer.degree,
        (-1 / depth.window[0], -1 / depth.window[1]),
        inverse_depth=True,
        reference_quats=layer.reference_quats.astype(np.float32),
        scale_mix=layer.scale_mix,
        reduction=_truncated(layer, components),
    )
    return with_depth_pictures(plan, 2 if _fineness(depth) < _WORTH_TWO_PICTURES else 1)


def _fineness(depth: Channel) -> float:
    """The step of depth in the finest that codes of 12 bits have."""
    low, high = depth.window
    return depth.step * MAX_CODE / (hevc_step(0) * (high - low)) if high > low else math.inf


def _depth_channel(plan: LayerPlan) -> Channel:
    """The plan's depth, with the step that its pictures come to together."""
    (depth,) = (channel for channel in plan.channels if channel.plane_class == PlaneClass.DEPTH)
    return depth if plan.refine_depth is None else replace(depth, step=plan.refine_depth)


def depth_fineness(plan: LayerPlan) -> float | None:
    """The step wanted of depth in the finest that codes of 12 bits have; None of plans that have but one picture."""
    return _fineness(_depth_channel(plan)) if plan.inverse_depth else None


def with_depth_pictures(plan: LayerPlan, count: int) -> LayerPlan:
    """The plan with depth of the same step in one picture or in two; as it is where that is no choice."""
    if not plan.inverse_depth:
        return plan
    depth = _depth_channel(plan)
    coded = replace(depth, step=depth.step * COARSE_DEPTH) if count == 2 else depth
    channels = tuple(coded if channel.plane_class == PlaneClass.DEPTH else channel for channel in plan.channels)
    return replace(plan, channels=channels, refine_depth=depth.step if count == 2 else None)


def kept_components(energies: NDArray, step: float, settings: AdaptiveSettings) -> int:
    """How many components of energies (d,) float64 are coded: the others are small against a step (water-filling)."""
    left_out = np.append(np.cumsum(energies[::-1])[::-1], 0.0)  # left_out[k]: energy without the first k
    return max(1, int(np.argmax(left_out <= settings.energy_floor * step**2)))


def _truncated(layer: AdaptiveLayer, k: int) -> Reduction:
    """The maps of the first k components, or all that were prepared."""
    reduction, total = layer.reduction, float(layer.energies.sum())
    k = min(k, reduction.k)
    lost = float(layer.energies[k:].sum()) / total if total > 0 else 0.0
    return replace(
        reduction, inverse=reduction.inverse[:, :k], projection=reduction.projection[:, :k], energy_lost=lost
    )


def _turn_to_principal(scales: NDArray) -> tuple[NDArray, NDArray]:
    """Turn ŝ (V, 3, H, W) in place to its principal axes, and return the map back: ŝ = mix · planes + mean."""
    means = [of_view.mean(axis=(1, 2), dtype=np.float64) for of_view in scales]
    mean = np.mean(means, axis=0).astype(np.float32)
    moment = np.zeros((3, 3))
    for view, block in blocks(scales):
        centred = (scales[view, :, block] - mean[:, None, None]).reshape(3, -1).astype(np.float64)
        moment += product(centred, centred.T)
    _, vectors = symmetric_eigen(moment)
    vectors = (vectors * leading_signs(vectors))[:, ::-1].astype(np.float32)
    for view, block in blocks(scales):
        centred = scales[view, :, block] - mean[:, None, None]
        scales[view, :, block] = product(vectors.T, centred.reshape(3, -1)).reshape(centred.shape)
    return vectors, mean
