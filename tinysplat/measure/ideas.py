"""The profile `balanced` with one idea undone, coded as a real file: what each idea is worth.

Steps of the undone class are those of the plan, brought to the units of the planes that take its place, so that errors
stay about what they were and the bytes tell. Whoever wants both at once takes the BD-rate over several Q_g.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.analysis import ProjectedLayer, coefficient_moment, color_planes, project_layer
from tinysplat_runtime.codec.basis import (
    mean_magnitude_weighting,
    reduce_basis,
    second_moment_weighting,
    view_directions,
    weighted_spectrum,
)
from tinysplat_runtime.codec.encoder import SceneEncoder
from tinysplat_runtime.codec.profiles import PROFILES, AdaptiveSettings, Profile
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.planes import LayerPlan, PlaneClass
from tinysplat_runtime.graphs.inference import GraphStore

BASE = PROFILES["balanced"]
"""The profile whose ideas these are."""

PAPER_K = 6

STEPS_NOT_MEASURED = "steps not measured"
"""Of `other_settings`."""


@dataclass(frozen=True, eq=False)
class PlannedLayer:
    """A layer with what a changed plan needs of it, worked out when it does."""

    layer: Gaussians
    store: GraphStore

    @cached_property
    def projected(self) -> ProjectedLayer:
        """Its planes."""
        return project_layer(self.store, self.layer, drop_invalid=True, where="layer")


Change = Callable[[LayerPlan, PlannedLayer], LayerPlan]


def depth_as_z(plan: LayerPlan, part: PlannedLayer) -> LayerPlan:
    """z in place of −1/z, at the step that is as fine at the mean depth."""
    z = part.projected.planes(PlaneClass.DEPTH)[:, 0]
    factor = float(z.mean(dtype=np.float64)) ** 2
    step = _steps(plan, PlaneClass.DEPTH)[0] * factor
    refine = None if plan.refine_depth is None else plan.refine_depth * factor
    return replace(_with(plan, PlaneClass.DEPTH, z[:, None], step), inverse_depth=False, refine_depth=refine)


def one_depth_picture(plan: LayerPlan, part: PlannedLayer) -> LayerPlan:
    """Depth once, as finely as 12 bits allow where the step wanted is finer."""
    if plan.refine_depth is None:
        return plan
    values = next(c.values for c in plan.channels if c.plane_class == PlaneClass.DEPTH)
    return replace(_with(plan, PlaneClass.DEPTH, values[:, None], plan.refine_depth), refine_depth=None)


def one_qp(plan: LayerPlan, part: PlannedLayer) -> LayerPlan:
    """Every block of depth at the plane's own QP."""
    return replace(plan, channels=tuple(replace(channel, offsets=None) for channel in plan.channels))


def scales_as_they_are(plan: LayerPlan, part: PlannedLayer) -> LayerPlan:
    """ŝ without its principal axes."""
    planes = part.projected.planes(PlaneClass.SCALE)
    return replace(_with(plan, PlaneClass.SCALE, planes, _steps(plan, PlaneClass.SCALE)[0]), scale_mix=None)


def rotations_as_they_are(plan: LayerPlan, part: PlannedLayer) -> LayerPlan:
    """Four components, relative to nothing."""
    planes = part.projected.planes(PlaneClass.ROTATION)
    return replace(_with(plan, PlaneClass.ROTATION, planes, _steps(plan, PlaneClass.ROTATION)[0]), reference_quats=None)


def paper_weighting(plan: LayerPlan, part: PlannedLayer) -> LayerPlan:
    """VABR weighted by diag(E|Y|), k = 6, at a step that is the same share of the leading component's deviation."""
    layer = part.layer
    weighting = mean_magnitude_weighting(view_directions(layer.cameras), layer.degree)
    moment = coefficient_moment(part.store, layer)
    reduction = reduce_basis(weighted_spectrum(moment, weighting), weighting, min(PAPER_K, len(moment)))
    planes = color_planes(part.store, layer, reduction.projection)
    leading = next(c for c in plan.channels if c.plane_class == PlaneClass.COLOR)
    step = leading.step * float(planes[:, 0].std() / max(float(leading.values.std()), 1e-30))
    return replace(_with(plan, PlaneClass.COLOR, planes, step), reduction=reduction, degree=layer.degree)


def all_bands(plan: LayerPlan, part: PlannedLayer) -> LayerPlan:
    """SH of the layer's own degree, with as many components at the same step."""
    layer = part.layer
    if plan.degree == layer.degree or plan.reduction is None:
        return plan
    weighting = second_moment_weighting(view_directions(layer.cameras), layer.degree)
    spectrum = weighted_spectrum(coefficient_moment(part.store, layer), weighting)
    reduction = reduce_basis(spectrum, weighting, plan.reduction.k)
    planes = color_planes(part.store, layer, reduction.projection)
    step = _steps(plan, PlaneClass.COLOR)[0]
    return replace(_with(plan, PlaneClass.COLOR, planes, step), reduction=reduction, degree=layer.degree)


def components(k: int) -> Change:
    """Keeps at most k colour components."""

    def change(plan: LayerPlan, part: PlannedLayer) -> LayerPlan:
        reduction = plan.reduction
        assert reduction is not None
        kept = tuple(c for c in plan.channels if c.plane_class != PlaneClass.COLOR or c.target < k)
        cut = replace(reduction, inverse=reduction.inverse[:, :k], projection=reduction.projection[:, :k])
        return replace(plan, channels=kept, reduction=cut)

    return change


CHANGES: dict[str, Change] = {
    "depth as z": depth_as_z,
    "one depth picture": one_depth_picture,
    "one QP for depth": one_qp,
    "ŝ without PCA": scales_as_they_are,
    "rotation as four components": rotations_as_they_are,
    "VABR as the paper's": paper_weighting,
    "all SH bands": all_bands,
    "k ≤ 1": components(1),
    "k ≤ 3": components(3),
}
"""By what is undone."""


def encode_changed(gaussians: Gaussians, qp: float, runtime: Runtime, change: Change) -> bytes:
    """A file of `balanced` whose layers' plans went through `change`."""
    encoder = _encoder(gaussians, runtime)
    return encoder.code(_changed(encoder, qp, runtime.store, change), qp)


def idea_coders(runtime: Runtime) -> dict[str, Callable[[Gaussians, float], bytes]]:
    """What codes Gaussians at a Q_g: the profile, other settings of it, and the profile without each other idea."""

    def setting(profile: Profile) -> Callable[[Gaussians, float], bytes]:
        return lambda gaussians, qp: _encoder(gaussians, runtime, profile).encode(qp)

    settings = {name: setting(profile) for name, profile in {BASE.name: BASE, **other_settings()}.items()}
    return settings | {name: partial(encode_changed, runtime=runtime, change=one) for name, one in CHANGES.items()}


def _encoder(gaussians: Gaussians, runtime: Runtime, profile: Profile = BASE) -> SceneEncoder:
    return SceneEncoder(gaussians, profile, runtime.store, threads=runtime.threads, drop_invalid=True)


def _changed(encoder: SceneEncoder, qp: float, store: GraphStore, change: Change) -> list[LayerPlan]:
    return [
        change(plan, PlannedLayer(layer, store))
        for plan, layer in zip(encoder.plan(qp), encoder.gaussians.layers, strict=True)
    ]


def other_settings() -> dict[str, Profile]:
    """Ideas that are undone by a setting of `balanced`: depth's step at a fixed share of the mean inverse depth, layers
    behind the first coded with its steps, and VABR of all SH coefficients however little input views disagree.
    """
    settings = BASE.settings
    assert isinstance(settings, AdaptiveSettings)
    changed = {
        STEPS_NOT_MEASURED: replace(settings, stripes=0),
        "layers behind as fine": replace(settings, behind=1.0),
        "no colours as seen": replace(settings, disagreement=-1.0),
    }
    return {name: replace(BASE, settings=other) for name, other in changed.items()}


def _steps(plan: LayerPlan, plane_class: PlaneClass) -> Sequence[float]:
    return [c.step for c in plan.channels if c.plane_class == plane_class]


def _with(plan: LayerPlan, plane_class: PlaneClass, planes: NDArray, step: float) -> LayerPlan:
    """The plan with other planes (V, C, H, W) for a class; what else was chosen for the class stays."""
    model = next(c for c in plan.channels if c.plane_class == plane_class)
    channels = [c for c in plan.channels if c.plane_class != plane_class]
    for target in range(planes.shape[1]):
        values = np.ascontiguousarray(planes[:, target])
        window = (float(values.min()), float(values.max()))
        channels.append(replace(model, target=target, values=values, step=step, window=window))
    return replace(plan, channels=tuple(sorted(channels, key=lambda c: c.plane_class)))
