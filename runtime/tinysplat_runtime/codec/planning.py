"""Planners: each looks at a scene once, and says for any Q_g how its layers are to be coded."""

import itertools
from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias

from ..gaussian.planes import Channel, LayerPlan
from .adaptive import (
    AdaptiveLayer,
    adaptive_plan,
    color_channels,
    known_channels,
    prepare_layer,
    scene_steps,
    take_geometry,
)
from .analysis import ProjectedLayer
from .depth_step.allocation import Steps
from .job import Job
from .paper import paper_colors, paper_plan
from .profiles import AdaptiveSettings, PaperSettings

Ready: TypeAlias = Callable[[Channel], object]


class Planner(Protocol):
    """Says how a scene is coded."""

    def plan(self, qp: float, ready: Ready) -> list[LayerPlan]:
        """How to code each layer at Q_g = `qp`; `ready` is given channels that are known before the others."""


class PaperPlanner:
    """Steps relative to each channel's deviation; see `paper`."""

    def __init__(self, job: Job, projected: Sequence[ProjectedLayer], settings: PaperSettings) -> None:
        self._job, self._projected, self._settings = job, projected, settings

    def plan(self, qp: float, ready: Ready) -> list[LayerPlan]:
        """How to code each layer at Q_g = `qp`."""
        watch, plans = self._job.stats.watch, []
        for layer, projected in zip(self._job.gaussians.layers, self._projected, strict=True):
            with watch.stage("vabr"):
                colors, reduction = paper_colors(self._job.store, layer, self._settings)
            with watch.stage("quantise"):
                plans.append(paper_plan(projected, colors, reduction, layer.degree, qp))
        return plans


class AdaptivePlanner:
    """Steps of equal slope; see `adaptive`. They belong to the scene: measured once, on the planes of Q_g = 0.

    The scene's projected planes become the planner's own, and the codec's in place of VPT's.
    """

    def __init__(self, job: Job, projected: Sequence[ProjectedLayer], settings: AdaptiveSettings) -> None:
        self._job, self._settings = job, settings
        with job.stats.watch.stage("vabr"):
            self._geometry = [take_geometry(layer) for layer in projected]
        self._prepared: list[AdaptiveLayer] | None = None
        self._steps: list[Steps] | None = None

    def plan(self, qp: float, ready: Ready) -> list[LayerPlan]:
        """How to code each layer at Q_g = `qp`."""
        watch, settings = self._job.stats.watch, self._settings
        known = [list(known_channels(layer, index, settings, qp)) for index, layer in enumerate(self._geometry)]
        for channel in itertools.chain(*known):
            ready(channel)
        with watch.stage("vabr"):
            if self._prepared is None:
                self._prepared = self._layers(0.0)
            prepared = self._prepared if qp >= 0 else self._layers(qp)
        colors = [list(color_channels(layer, index, settings, qp)) for index, layer in enumerate(prepared)]
        for channel in itertools.chain(*colors):
            ready(channel)
        with watch.stage("quantise"):
            if self._steps is None:
                self._steps = scene_steps(self._prepared, settings, self._job.threads)
            layers = zip(prepared, self._steps, known, colors, strict=True)
            return [adaptive_plan(layer, steps, [*a, *b], settings, qp) for layer, steps, a, b in layers]

    def _layers(self, qp: float) -> list[AdaptiveLayer]:
        pairs = zip(self._job.gaussians.layers, self._geometry, strict=True)
        return [prepare_layer(self._job.store, layer, planes, self._settings, qp) for layer, planes in pairs]


def planner_of(job: Job, projected: Sequence[ProjectedLayer]) -> Planner:
    """The planner that the profile's settings are for, given VPT's planes of each layer."""
    settings = job.profile.settings
    if isinstance(settings, PaperSettings):
        return PaperPlanner(job, projected, settings)
    return AdaptivePlanner(job, projected, settings)
