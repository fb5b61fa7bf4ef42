"""What a run from photos to a file is made of: how far it is, steps from there on, and what photos can become."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias

from ..codec.job import EncodeStats, Job
from ..codec.search import Coder
from ..container.limits import Limits
from ..gaussian.gaussians import Gaussians
from ..graphs.inference import GraphStore
from ..network.ways import Way
from ..scene.scenes import Scene
from ..system.told import NOBODY, Told
from .request import Coding, EncodeRequest

Shares: TypeAlias = list[tuple[str, float]]
"""What a step reports, with the usual share of a run's time: percentages measured on default captures
(docs/lab/seconds.md), which a run corrects as its own steps end."""

Fidelity: TypeAlias = Callable[[bytes], float]
"""PSNR (dB) of a file's pictures against those of the original Gaussians."""


class Tools(Protocol):
    """What every step works with, such as a `Runtime`.

    Attributes:
        store: opens graphs.
        threads: of each step; no result depends on them.
        limits: what a file may ask for when it is decoded.
    """

    store: GraphStore
    threads: int
    limits: Limits


@dataclass(frozen=True)
class Ready:
    """Gaussians that are ready to be coded.

    Attributes:
        coder: opens what codes them at any Q_g.
        fidelity: opens what measures a file of them.
        views: the views that it measures in, for people; empty where only a target asks for it.
    """

    coder: Callable[[], Coder]
    fidelity: Callable[[], Fidelity]
    views: str = ""


@dataclass(frozen=True)
class Kind:
    """What photos or Gaussians become.

    Attributes:
        mode: of the file.
        shares: of coding.
        ready: makes Gaussians ready to be coded.
        has_views: whether Gaussians belong to views, of which some can be decoded without the others.
        keeps_photos: whether the file has the photos, which whoever decodes it gives to the network.
        foretold: a line about the file that will come of photos, empty where there is nothing to say.
        seen: the photos as the network is given them.
        making: steps from the network's Gaussians to those that are coded.
        qp: Q_g of so many photos, where nobody asks for one.
    """

    mode: str
    shares: Shares
    ready: Callable[[Job, Coding, Limits], Ready]
    has_views: bool = True
    keeps_photos: bool = False
    foretold: Callable[[EncodeRequest, Scene], str] = lambda request, photos: ""
    seen: Callable[[Scene], Scene] = lambda photos: photos
    making: tuple[Step, ...] = ()
    qp: Callable[[int], float] = lambda photos: 0.0


@dataclass(frozen=True)
class Run:
    """What is asked for, and how far it is.

    Attributes:
        request: what is asked for.
        kind: what photos become.
        tools: to do it with.
        photos: as prepared, those that are left.
        seen: the same as the network is given them.
        told: who is told what goes on.
        stats: filled with what was measured, and the seconds of each step.
        gaussians: what the photos are by now; before the network, None.
        left: views of `gaussians` that photos are, where some were left out since.
        looks: how often photos that the others contradict are still looked for: two of one other scene support each
            other until one of them is left out.
        doubts: what is likely wrong with the photos, a line each.
        data: the file, once there is one.
    """

    request: EncodeRequest
    kind: Kind
    tools: Tools
    photos: Scene
    seen: Scene
    told: Told = NOBODY
    stats: EncodeStats = field(default_factory=EncodeStats)
    gaussians: Gaussians | None = None
    left: Sequence[int] = ()
    looks: int = 2
    doubts: tuple[str, ...] = ()
    data: bytes = b""

    @property
    def count(self) -> int:
        """Photos that are left."""
        return len(self.photos.frames)

    @property
    def made(self) -> Gaussians:
        """The Gaussians, from the network on."""
        assert self.gaussians is not None
        return self.gaussians

    @property
    def way(self) -> Way:
        """The photos' way through the requested network."""
        request, tools, whole = self.request, self.tools, self.kind.keeps_photos
        return Way.of(self.seen, request.model, tools.store, threads=tools.threads, whole=whole, joint=request.joint)


@dataclass(frozen=True)
class Step:
    """A step of a run.

    Attributes:
        take: the run after it.
        shares: what it reports, and of how much of the time.
    """

    take: Callable[[Run], Run]
    shares: Callable[[Run], Shares] = lambda run: []
