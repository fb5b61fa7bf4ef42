"""Planners: each looks at a scene once, and says for any Q_g how its layers are to be coded."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from ..gaussian.gaussians import Gaussians
from ..gaussian.planes import Channel, LayerPlan
from ..graphs.inference import GraphStore
from ..system.stopwatch import Stopwatch
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
from .paper import paper_colors, paper_plan
from .profiles import AdaptiveSettings, PaperSettings, Profile


@dataclass(frozen=True)
class ProjectedScene:
    """What planners start from.

    Attributes:
        layers: Gaussians of each layer.
        projected: VPT's planes of each.
        store: opens the analysis graphs.
        threads: for looking at the scene; never changes a plan.
        watch: takes the seconds of stages `vabr` and `quantise`.
    """

    layers: Sequence[Gaussians]
    projected: Sequence[ProjectedLayer]
    store: GraphStore
    threads: int
    watch: Stopwatch


Ready: TypeAlias = Callable[[Channel], object]


class Planner(Protocol):
    """Says how a scene is coded."""

    def plan(self, qp: float, ready: Ready) -> list[LayerPlan]:
        """How to code each layer at Q_g = `qp`; `ready` is given channels that are known before the others."""


class PaperPlanner:
    """Steps relative to each channel's deviation; see `paper`."""

    def __init__(self, scene: ProjectedScene, settings: PaperSettings) -> None:
        self._scene, self._settings = scene, settings

    def plan(self, qp: float, ready: Ready) -> list[LayerPlan]:
        """How to code each layer at Q_g = `qp`."""
        scene, settings, plans = self._scene, self._settings, []
        for layer, projected in zip(scene.layers, scene.projected, strict=True):
            with scene.watch.stage("vabr"):
                colors, reduction = paper_colors(scene.store, layer, settings)
            with scene.watch.stage("quantise"):
                plans.append(paper_plan(projected, colors, reduction, layer.degree, qp))
        return plans


class AdaptivePlanner:
    """Steps of equal slope; see `adaptive`. They belong to the scene: measured once, on the planes of Q_g = 0.

    The scene's projected planes become the planner's own, and the codec's in place of VPT's.
    """

    def __init__(self, scene: ProjectedScene, settings: AdaptiveSettings) -> None:
        self._scene, self._settings = scene, settings
        with scene.watch.stage("vabr"):
            self._geometry = [take_geometry(projected) for projected in scene.projected]
        self._prepared: list[AdaptiveLayer] | None = None
        self._steps: list[Steps] | None = None

    def plan(self, qp: float, ready: Ready) -> list[LayerPlan]:
        """How to code each layer at Q_g = `qp`."""
        watch, settings = self._scene.watch, self._settings
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
                self._steps = scene_steps(self._prepared, settings, self._scene.threads)
            layers = zip(prepared, self._steps, known, colors, strict=True)
            return [adaptive_plan(layer, steps, [*a, *b], settings, qp) for layer, steps, a, b in layers]

    def _layers(self, qp: float) -> list[AdaptiveLayer]:
        pairs = zip(self._scene.layers, self._geometry, strict=True)
        return [prepare_layer(self._scene.store, layer, planes, self._settings, qp) for layer, planes in pairs]


def planner_of(profile: Profile, scene: ProjectedScene) -> Planner:
    """The planner that a profile's settings are for."""
    if isinstance(profile.settings, PaperSettings):
        return PaperPlanner(scene, profile.settings)
    return AdaptivePlanner(scene, profile.settings)
