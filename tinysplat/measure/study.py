"""What a study is, and what a run gives it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.errors import InputError

from .clock import Effort
from .lpips import LpipsFiles, find_lpips
from .pictures import Drawing
from .rows import Row, RowFile
from .runner import Plan, WindowJob, list_jobs
from .show.plots import Chart
from .show.tables import Listing, View
from .subjects.cases import Case, Source, Window
from .subjects.made import made_case
from .subjects.room import Motorcycle, Room
from .subjects.sources import FileSource

Table = Callable[[Sequence[Row]], str]
"""Rows of a run to Markdown; empty where none is its."""

Plot = Callable[[Path, Sequence[Row]], bool]
"""Draws rows of a run into a PNG file; False where none is its."""


@dataclass(frozen=True)
class Study:
    """A question.

    Attributes:
        title: of its part of the report.
        measure: what answers it; rows of one or more names of `Row.study`.
        tables: by name, in the report's order; places in README and docs name them too.
        plots: by name.
    """

    title: str
    measure: Callable[[Run], Iterator[Row]]
    tables: Mapping[str, Table]
    plots: Mapping[str, Plot] = field(default_factory=dict)

    @classmethod
    def of(cls, title: str, measure: Callable[[Run], Iterator[Row]], *shown: View | Listing | Chart) -> Study:
        """A study whose tables and plots go by the names of its rows."""
        tables = {one.study: one for one in shown if not isinstance(one, Chart)}
        plots: dict[str, Plot] = {one.study: one for one in shown if isinstance(one, Chart)}
        plots |= {one.study: one.chart for one in shown if isinstance(one, View) and one.y}
        return cls(title, measure, tables, plots)


@dataclass(frozen=True)
class Options:
    """What the command line adds to a study; each takes what concerns it.

    Attributes:
        models: networks; empty for all that ship.
        profiles, modes, peers: ways to store Gaussians; empty for the study's own choice.
        qps: Q_g; empty for the study's own.
        kinds, views, limit: which windows of scenes.
        size: (height, width) of photos, or None for the study's own.
        targets: pictures per window at most.
        rounds: of timing; 0 for the study's own.
        data: data sets in chunks: (name, folder, index).
        lpips_backbone, lpips_linear: weights of LPIPS with VGG; None for those at hand.
        jobs: windows at a time.
        beside: another checkout, whose commands or refinement is timed in turns with this one's.
        near, far: over the inputs' own.
    """

    models: tuple[str, ...] = ()
    profiles: tuple[str, ...] = ()
    modes: tuple[str, ...] = ()
    peers: tuple[str, ...] = ()
    qps: tuple[float, ...] = ()
    kinds: tuple[str, ...] = ()
    views: tuple[int, ...] = ()
    limit: int | None = None
    size: tuple[int, int] | None = None
    targets: int = 3
    rounds: int = 0
    data: tuple[tuple[str, str, str], ...] = ()
    lpips_backbone: Path | None = None
    lpips_linear: Path | None = None
    jobs: int = 1
    beside: Path | None = None
    near: float | None = None
    far: float | None = None


@dataclass
class Run:
    """One run of `tinysplat bench`.

    Attributes:
        quick: the short form.
        runtime: with the run's number of threads.
        store: keeps rows as they come.
        folder: of the report; its plots go to `plots/`.
        sources: a user's own; the built-in ones take their place where there are none.
        paths: as the user gave them.
        models: networks, the first of which codes.
        options: what else the command line says.
        left_out: lines for the report.
    """

    quick: bool
    runtime: Runtime
    store: RowFile
    folder: Path
    sources: Sequence[Source] = ()
    paths: Sequence[Path] = ()
    models: Sequence[str] = ()
    options: Options = field(default_factory=Options)
    left_out: list[str] = field(default_factory=list)

    @property
    def threads(self) -> int:
        """How many the run may use."""
        return self.runtime.threads

    @property
    def thread_counts(self) -> list[int]:
        """One thread, and all of them."""
        return sorted({1, self.threads})

    @property
    def drawing(self) -> Drawing:
        """How pictures are drawn for judging."""
        return Drawing.as_defined(self.threads)

    @property
    def effort(self) -> Effort:
        """Of an ordinary comparison."""
        rounds, budget = (5, 1.5) if self.quick else (9, 20.0)
        return Effort(self.options.rounds or rounds, budget, least=min(3, self.options.rounds or 3))

    @property
    def side(self) -> int:
        """Of coded views, and of the pictures that networks are judged at."""
        return 128 if self.quick else 256

    @property
    def size(self) -> tuple[int, int]:
        """Of a user's photos."""
        return self.options.size or (self.side, self.side)

    @property
    def lpips(self) -> LpipsFiles | None:
        """LPIPS with VGG, the paper's, where its weights are at hand."""
        return find_lpips("vgg", self.options.lpips_backbone, self.options.lpips_linear)[0]

    def plan(self, views: Sequence[int] = (), kinds: Sequence[str] = ()) -> Plan:
        """Which of the user's windows are measured."""
        options = self.options
        return Plan(self.sources, self.models[:1] if not options.models else options.models, self.size,
                    options.kinds or kinds, options.views or views, options.limit or 1)  # fmt: skip

    def jobs(self, views: Sequence[int]) -> Iterator[WindowJob]:
        """For every scene and number of photos the first windows of so many, or the first photos of larger ones."""
        plan = self.plan()
        jobs, left_out, notes = list_jobs(replace(plan, limit=None))
        self.left_out += [*map(str, left_out), *notes]
        scenes: dict[tuple[str, str], list[WindowJob]] = {}
        for job in jobs:
            scenes.setdefault((job.source.name, job.model), []).append(job)
        for same in scenes.values():
            for count in plan.views or views:
                exact = [job for job in same if len(job.window.context) == count]
                larger = [job for job in same if len(job.window.context) > count]
                for job in (exact or larger)[: plan.limit]:
                    yield replace(job, window=replace(job.window, context=job.window.context[:count]))

    @cached_property
    def photos(self) -> list[tuple[Source, Window]]:
        """The first window of each scene with photos: the user's, or the built-in ones."""
        if self.sources and not any(source.needs_network for source in self.sources):
            self.left_out.append("left out networks: Gaussian files have no photos")
        return self._photos

    @cached_property
    def _photos(self) -> list[tuple[Source, Window]]:
        own = [source for source in self.sources if source.needs_network]
        if self.sources:
            return [(source, windows[0]) for source in own if (windows := self._windows(source))]
        try:
            Motorcycle().shots(Window("motorcycle", (0,), (1,)), (16, 16))
            built_in: list[Source] = [Room(), Motorcycle()]
        except InputError as error:
            self.left_out.append(f"left out {error}")
            built_in = [Room()]
        return [(source, source.windows()[0][0]) for source in built_in]

    @cached_property
    def cases(self) -> list[Case]:
        """Gaussians to code: network-like ones of SH degree 4 and a network's, or those of the user's inputs."""
        size = (self.side, self.side)
        files = [source for source in self.sources if isinstance(source, FileSource)]
        made = [] if self.sources else [made_case(2, *size, 4)]
        found = [source.case(source.windows()[0][0], "", size, self.runtime) for source in files]
        # Of the built-in scenes the real photos, which come last.
        photos = self._photos if self.sources else self._photos[-1:]
        for source, window in photos:
            for model in self.models[:1]:
                case = source.case(window, model, size, self.runtime)
                views = len(case.gaussians.cameras)
                found.append(renamed(case, f"{model} on {case.name}, {views}×{size[1]}×{size[0]}"))
        return [*made, *(case.with_inputs() for case in found)]

    def _windows(self, source: Source) -> list[Window]:
        try:
            windows, lost = source.windows()
        except InputError as error:
            self.left_out.append(f"left out {error}")
            return []
        self.left_out += map(str, lost)
        return windows


def renamed(case: Case, name: str) -> Case:
    """The same case under another name."""
    return replace(case, name=name)
