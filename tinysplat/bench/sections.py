"""What a report consists of: sections that measure, and how far each goes in the short and in the full form."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.errors import InputError

from . import chain, codec, growth, network, peers, rasteriser, reduction, transforms
from .inputs import (
    Case,
    FileSource,
    Folder,
    Motorcycle,
    PhotoSource,
    Room,
    file_case,
    made_case,
    made_gaussians,
    network_case,
    truncated,
)
from .judge import Judge
from .timing import Effort, Row, measure
from .torch_peer import torch_peer_rows


@dataclass(frozen=True)
class Plan:
    """How far to go.

    Attributes:
        name: `quick` or `full`.
        effort: of an ordinary stage.
        size: side of the coded views and of the pictures that networks are judged at.
        network_sizes: sides of a network's input.
        chain_sizes: those of the whole chain.
        qps: Q_g of every profile.
        presets, preset_qps: of libx265.
        sizes, counts: of the rasteriser's pictures and Gaussians; around `count` at `size`.
        ks: numbers of colour planes.
        codings: (profile, Q_g) of the whole chain.
        axes: of growth.
        sog_limit_s: how long SOG may take.
    """

    name: str
    effort: Effort
    size: int
    network_sizes: Sequence[int]
    chain_sizes: Sequence[int]
    qps: Sequence[float]
    presets: Sequence[str]
    preset_qps: Sequence[float]
    sizes: Sequence[int]
    counts: Sequence[int]
    count: int
    ks: Sequence[int]
    codings: Sequence[tuple[str, float]]
    axes: growth.Axes
    sog_limit_s: float


QUICK = Plan(
    name="quick",
    effort=Effort(rounds=5, budget_s=1.5),
    size=128,
    network_sizes=(64, 128),
    chain_sizes=(128,),
    qps=(0,),
    presets=("ultrafast, min-cu-size=8", "superfast, rdoq-level=2"),
    preset_qps=(0,),
    sizes=(64, 256),
    counts=(8_192, 131_072),
    count=32_768,
    ks=(1, 6, 24),
    codings=(("fast", 0), ("balanced", 0)),
    axes=growth.Axes(
        views=(1, 2, 4, 8),
        view_size=(64, 64),
        pixels=((64, 64), (128, 128), (256, 256)),
        gaussians=(8_192, 32_768, 131_072),
        picture=(256, 256),
        network_views=(2, 4),
        memory_axes=("pixels",),
    ),
    sog_limit_s=5,
)

FULL = Plan(
    name="full",
    effort=Effort(rounds=9, budget_s=20),
    size=256,
    network_sizes=(64, 128, 192, 256, 384),
    chain_sizes=(128, 256),
    qps=(-6, 0, 6, 12),
    presets=tuple(codec.PRESETS),
    preset_qps=(0, 6),
    sizes=(64, 128, 256, 512, 1024),
    counts=(8_192, 32_768, 131_072, 524_288, 1_048_576),
    count=131_072,
    ks=(1, 2, 3, 4, 6, 8, 12, 24, 75),
    codings=(("fast", 0), ("balanced", 0), ("balanced", 6), ("max", 0), ("paper", 0)),
    axes=growth.Axes(
        views=(1, 2, 4, 8, 16),
        view_size=(256, 256),
        pixels=((64, 64), (128, 128), (256, 256), (512, 512), (540, 960)),
        gaussians=(8_192, 32_768, 131_072, 524_288, 1_048_576),
        picture=(256, 256),
        network_views=(2, 3, 4, 5, 6),
        memory_axes=("views", "pixels", "Gaussians"),
    ),
    sog_limit_s=240,
)


@dataclass
class Bench:
    """A run: its plan, its inputs, and what could not be done.

    Attributes:
        plan: how far to go.
        runtime: with the run's number of threads.
        scenes, files: a user's own inputs; the built-in ones take their place where both are empty.
        models: networks to measure.
        left_out: lines for the report.
    """

    plan: Plan
    runtime: Runtime
    scenes: Sequence[Folder] = ()
    files: Sequence[FileSource] = ()
    models: Sequence[str] = ()
    left_out: list[str] = field(default_factory=list)

    @property
    def threads(self) -> int:
        """How many the run may use."""
        return self.runtime.threads

    @property
    def thread_counts(self) -> list[int]:
        """One thread, and all of them."""
        return sorted({1, self.threads})

    @cached_property
    def photo_sources(self) -> list[PhotoSource]:
        """Scenes with photos: the user's, or the built-in ones."""
        if self.scenes or self.files:
            if not self.scenes:
                self.left_out.append("left out chain and network: Gaussian files have no photos")
            return list(self.scenes)
        try:
            Motorcycle().context(16, 16)
        except InputError as error:
            self.left_out.append(f"left out {error}")
            return [Room()]
        return [Room(), Motorcycle()]

    @cached_property
    def cases(self) -> list[Case]:
        """Gaussians to code: network-like ones of SH degree 4 and a network's, or those of the user's inputs."""
        size, is_own = self.plan.size, bool(self.scenes or self.files)
        made = [] if is_own else [made_case(2, size, size, 4)]
        files = [file_case(source, (size, size)) for source in self.files]
        # Of the built-in scenes the real photos, which come last.
        sources = self.photo_sources if is_own else self.photo_sources[-1:]
        predicted = [
            network_case(source, model, size, size, self.runtime) for source in sources for model in self.models[:1]
        ]
        return [*made, *files, *predicted]

    def judge(self, case: Case) -> Judge:
        """A judge of a case."""
        return Judge(case, self.threads)


def chain_section(bench: Bench) -> Iterator[Row]:
    """Photos to a picture."""
    plan = bench.plan
    sizes = [(side, side) for side in plan.chain_sizes]
    for source in bench.photo_sources:
        stage, failed = chain.chain_stage(
            source, bench.models, sizes, plan.codings, (plan.size, plan.size), bench.runtime
        )
        yield from measure(stage, plan.effort)
        yield from failed


def network_section(bench: Bench) -> Iterator[Row]:
    """Photos to Gaussians."""
    plan = bench.plan
    sizes = [(side, side) for side in plan.network_sizes]
    for source in bench.photo_sources:
        stage, failed = network.network_stage(source, bench.models, sizes, (plan.size, plan.size), bench.thread_counts)
        yield from measure(stage, plan.effort)
        yield from failed


def transform_section(bench: Bench) -> Iterator[Row]:
    """VPT, VABR and synthesis against float64."""
    size = bench.plan.size
    case = f"2×{size}×{size}, SH degree 4"
    for stage in transforms.transform_stages(case, made_gaussians(2, size, size, 4), bench.threads):
        yield from measure(stage, bench.plan.effort)


def codec_section(bench: Bench) -> Iterator[Row]:
    """Encoding, presets, decoding."""
    plan = bench.plan
    for case in bench.cases:
        judge = bench.judge(case)
        stage, files = codec.encode_stage(case, judge, bench.runtime, codec.all_profiles(), plan.qps)
        yield from measure(stage, plan.effort)
        yield from measure(codec.decode_stage(case, files, bench.thread_counts), plan.effort)
    case = bench.cases[0]
    with tempfile.TemporaryDirectory() as folder:
        data = bench.runtime.compress(case.gaussians, drop_invalid=True)
        yield from measure(codec.cold_start_stage(case, data, Path(folder)), plan.effort)
    presets = codec.preset_stage(case, bench.judge(case), bench.runtime, plan.presets, plan.preset_qps)
    yield from measure(presets, plan.effort)


def rasteriser_section(bench: Bench) -> Iterator[Row]:
    """Pictures."""
    plan = bench.plan
    for stage in rasteriser.size_and_count_stages(plan.sizes, plan.counts, plan.size, plan.count, bench.thread_counts):
        yield from measure(stage, plan.effort)
    gaussians = made_gaussians(2, plan.size, plan.size, 4)
    case = f"{gaussians.count:,} Gaussians at {plan.size}×{plan.size}, SH degree 4"
    yield from measure(rasteriser.approximation_stage(gaussians, plan.size, case, bench.threads), plan.effort)


def reduction_section(bench: Bench) -> Iterator[Row]:
    """k and SH degree."""
    case = made_case(2, bench.plan.size, bench.plan.size, 4)
    judge = bench.judge(case)
    yield from measure(reduction.k_stage(case, judge, bench.runtime, bench.plan.ks), bench.plan.effort)
    yield from measure(reduction.degree_stage(case, judge, bench.runtime), bench.plan.effort)


def peer_section(bench: Bench) -> Iterator[Row]:
    """Other formats, and another rasteriser."""
    formats = peers.peer_formats(bench.runtime, bench.plan.sog_limit_s)
    for case in bench.cases:
        if case.gaussians.degree > peers.MAX_DEGREE:
            cut = truncated(case.gaussians, peers.MAX_DEGREE)
            case = replace(case, name=f"{case.name}, cut to {peers.MAX_DEGREE}", gaussians=cut)
        yield from peers.peer_rows(case, bench.judge(case), formats, bench.plan.effort)
    yield from torch_peer_rows(made_gaussians(2, 64, 64, peers.MAX_DEGREE), 64, bench.threads, bench.plan.effort)


def growth_section(bench: Bench, tasks: Collection[str] = growth.TASKS) -> Iterator[Row]:
    """Views, pixels, Gaussians, of some tasks."""
    model = bench.models[0] if bench.models else None
    yield from growth.growth_rows(bench.plan.axes, model, bench.runtime, bench.plan.effort, tasks)


SECTIONS: dict[str, Callable[[Bench], Iterator[Row]]] = {
    "chain": chain_section,
    "network": network_section,
    "transforms": transform_section,
    "codec": codec_section,
    "rasteriser": rasteriser_section,
    "reduction": reduction_section,
    "peers": peer_section,
    "growth": growth_section,
}
"""Sections in the report's order; `--stages` names some of them."""
