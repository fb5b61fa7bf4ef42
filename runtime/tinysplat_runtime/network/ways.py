"""Ways through a network: it takes photos group by group, as they are or as small copies, or one by one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from ..errors import warn, within
from ..gaussian.gaussians import Gaussians
from ..graphs.inference import Graph, GraphStore
from ..scene.neighbours import CLOSE, Group
from ..scene.scenes import Scene
from ..system.stopwatch import Stopwatch
from ..system.threads import Crew
from ..system.told import NOBODY, Told
from .each import predict_each
from .enlarge import LARGE_PIXELS, Enlarger, predict_large
from .masked import hidden
from .predict import NetworkLimits, predict
from .walk import capture_groups, predict_groups

LEAST_EACH = 3
"""Fewest photos that go through a network's stages one by one: two have no third to agree with."""


@dataclass(frozen=True)
class Way(ABC):
    """How photos go through a network.

    Attributes:
        store: opens graphs.
        model: the network's name in the manifest, or the path of an .onnx file.
    """

    store: GraphStore
    model: str

    @staticmethod
    def of(
        scene: Scene, model: str, store: GraphStore, *, threads: int, whole: bool = False, joint: bool = True
    ) -> Way:
        """Choose the way for a scene; see `Runtime.predict` for the arguments."""
        camera = scene.cameras[0]
        if not whole and camera.width * camera.height > LARGE_PIXELS and (graph := store.enlarger()) is not None:
            enlarger = Enlarger.of(graph)
            if store.shipped_network(model) in enlarger.networks:
                return SmallCopies(store, model, enlarger)
        if not whole and len(scene.frames) >= LEAST_EACH and store.has_stages(model):
            return OneByOne(store, model, threads if joint else None)
        return Grouped(store, model)

    def predicted(self, scene: Scene, watch: Stopwatch, told: Told = NOBODY) -> Gaussians:
        """Gaussians of all views of a scene, hidden where masks leave pixels out; see `Runtime.predict`."""
        return hidden(self._predicted(scene, watch, told), scene)

    @property
    @abstractmethod
    def steps(self) -> list[tuple[str, float]]:
        """(label, usual share of the time) of each step, as in `recipe.steps`."""

    @abstractmethod
    def _predicted(self, scene: Scene, watch: Stopwatch, told: Told) -> Gaussians:
        """`predicted` before masks are applied."""


@dataclass(frozen=True)
class Grouped(Way):
    """Photos go through group by group, at full size."""

    @property
    def steps(self) -> list[tuple[str, float]]:
        return [("Gaussians of photos", 28.0)]

    def _predicted(self, scene: Scene, watch: Stopwatch, told: Told) -> Gaussians:
        graph = self.store.network(self.model)

        def run(views: Sequence[int]) -> Gaussians:
            part = scene.views(views)
            images = [part.images()]
            with watch.stage("network"):
                return self._run(images, part, graph)

        groups, (near, _) = _groups(scene, graph), scene.depth_range()
        return predict_groups(scene.cameras, near, groups, run, told)

    def _run(self, images: list[NDArray], scene: Scene, graph: Graph) -> Gaussians:
        """Gaussians of one group; its photos may be freed."""
        return predict(images.pop(), scene.cameras, *scene.depth_range(), graph)


@dataclass(frozen=True)
class SmallCopies(Grouped):
    """Large photos: what the network finds on small copies of them is brought to every pixel.

    Attributes:
        enlarger: brings it there.
    """

    enlarger: Enlarger

    def _run(self, images: list[NDArray], scene: Scene, graph: Graph) -> Gaussians:
        return predict_large(images.pop(), scene.cameras, *scene.depth_range(), graph, self.enlarger)


@dataclass(frozen=True)
class OneByOne(Way):
    """Three or more photos go through the stages of a network one by one, each beside its partners.

    Attributes:
        threads: for the step in which they agree on depth; None to skip it.
    """

    threads: int | None

    @property
    def steps(self) -> list[tuple[str, float]]:
        agreeing = [("agreeing on depth", 20.0)] * bool(self.threads)
        return [("opening the network", 2.0), ("depth of photos", 12.0), *agreeing, ("Gaussians of photos", 11.0)]

    def _predicted(self, scene: Scene, watch: Stopwatch, told: Told) -> Gaussians:
        stages = self.store.stages(self.model)
        groups = _groups(scene, stages["glance"], CLOSE)  # one by one, groups of their own cost no calls
        run_jobs = Crew(self.threads).map if self.threads else None
        if run_jobs is not None and find_spec("numba") is None:
            warn('depths of photos are not made to agree, which needs numba: pip install "tinysplat[fast]"')
            run_jobs = None

        with watch.stage("network"):
            return predict_each(scene, stages, groups, told, run_jobs)


def _groups(scene: Scene, graph: Graph, shared: float = np.inf) -> tuple[Group, ...]:
    scene.check_one_size()
    with within(str(scene.path)):
        return capture_groups(scene.cameras, *scene.depth_range(), NetworkLimits.of(graph), shared)
