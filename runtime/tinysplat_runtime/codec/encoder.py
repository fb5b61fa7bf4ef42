"""Gaussians to a `.tsplat` file's bytes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..container.layers import CodedLayer
from ..container.layout import MAX_VIEWS
from ..container.limits import Limits
from ..container.planes import planes_file
from ..container.reader import read_container
from ..container.records import ChannelRecord, Picture
from ..container.writer import Head
from ..errors import FormatError, InputError, NumericError
from ..gaussian.gaussians import Gaussians
from ..gaussian.planes import Channel, LayerPlan, PlaneClass
from ..system import disk
from ..system.told import Told
from .analysis import MAX_PLANE, project_layer
from .hevc import CodedPlane, encode_plane
from .job import EncodeStats, Job, PlaneCoder, check_qp
from .planning import planner_of
from .profiles import EncoderSettings, Profile
from .quantise import CodeMap, choose_code_map, extent, mean_and_spread, without_outliers

_UNLIMITED = Limits(max_pixels=1 << 62, max_memory_bytes=1 << 62, max_layers=1 << 16)


@dataclass(frozen=True)
class MappedChannel:
    """A channel and what its codes mean; values outside the window are clipped."""

    channel: Channel
    code_map: CodeMap
    window: tuple[float, float]

    def codes(self, view: int) -> tuple[NDArray, int]:
        """A view's codes (H, W) uint16, and how many values were clipped."""
        values, (low, high) = self.channel.values[view], self.window
        # Codes may reach a little beyond the window, whose ends a coarse step rounds; only what lies outside is lost.
        return self.code_map.quantise(values)[0], int(np.count_nonzero((values < low) | (values > high)))


class SceneEncoder:
    """Codes one scene as often as a search wants: what does not depend on Q_g happens once, and so does the coding of
    planes that are the same from one time to the next.
    """

    def __init__(self, job: Job) -> None:
        """Check and project the job's Gaussians; its Q_g plays no part.

        Raises:
            InputError: a list, more views than 4,096.
            NumericError: Gaussians at or behind their own camera, or beyond the range of the format's numbers.
        """
        job.gaussians.check_pixels()
        views = len(job.gaussians.cameras)
        if views > MAX_VIEWS:
            raise InputError(f"{views} views, accepted are 1 to {MAX_VIEWS}", where="cameras")
        self.job, self._coder = job, _OnceEach(job.plane_coder or encode_plane, job.profile.encoder)
        with job.stats.watch.stage("vpt"):
            projected = [
                project_layer(job.store, layer, drop_invalid=job.drop_invalid, where=f"layer {index}")
                for index, layer in enumerate(job.gaussians.layers)
            ]
        self._planner = planner_of(job, projected)

    def plan(self, qp: float) -> list[LayerPlan]:
        """How to code each layer at Q_g = `qp`; InputError beyond ±60."""
        check_qp(qp)
        return self._planner.plan(qp, lambda channel: None)

    def code(self, plans: Sequence[LayerPlan], qp: float) -> bytes:
        """The file of such plans; `qp` is what its header says."""
        return self._file(lambda begin: plans, qp)

    def encode(self, qp: float) -> bytes:
        """What `code(plan(qp), qp)` gives, sooner: planes are coded while the planner looks at others."""
        check_qp(qp)
        return self._file(lambda begin: self._planner.plan(qp, begin), qp)

    def _file(self, planned: Callable[[Callable[[Channel], object]], Sequence[LayerPlan]], qp: float) -> bytes:
        job = self.job
        job.stats.clipped.clear()
        with _Coding(self._coder, job.threads, job.stats, job.told) as coding:
            pairs = list(zip(job.gaussians.layers, planned(coding.begin), strict=True))
            for _, plan in pairs:
                for channel in plan.channels:
                    coding.begin(channel)
            coding.wait()
            coded = [coding.finish(layer, plan) for layer, plan in pairs]
        return write_planes(coded, job.gaussians, job.profile, qp, job.stats)


def write_planes(
    layers: Sequence[CodedLayer], gaussians: Gaussians, profile: Profile, qp: float, stats: EncodeStats
) -> bytes:
    """The file of coded layers.

    Raises:
        NumericError: no reader would take it: scenes at the end of float32 can lead to that.
    """
    with stats.watch.stage("write"):
        head = Head(gaussians.cameras, gaussians.origin, profile.name, qp, gaussians.notes)
        data = planes_file(head, layers)
        try:
            read_container(data, _UNLIMITED)
        except FormatError as error:
            raise NumericError(f"beyond what a file can hold: {error.message}", where=error.where) from None
    return data


class _OnceEach:
    """A coder under one profile's settings, which is given each plane only once."""

    def __init__(self, coder: PlaneCoder, settings: EncoderSettings) -> None:
        self._coder, self._settings = coder, settings
        self._coded: dict[tuple[bytes, int], CodedPlane] = {}

    def __call__(self, codes: NDArray, qp: int, offsets: NDArray | None) -> CodedPlane:
        by_block = b"" if offsets is None else offsets.tobytes()
        key = sha256(np.ascontiguousarray(codes).data).digest() + repr(codes.shape).encode() + by_block, qp
        if key not in self._coded:
            self._coded[key] = self._coder(codes, qp, self._settings, offsets)
        return self._coded[key]


def is_flat(channel: Channel, mean: float, spread: float, step: float) -> bool:
    """Whether a channel of that mean and standard deviation is stored as a number when coded at `step`."""
    low, high = channel.window
    flat = channel.plane_class.facts.flat
    floor = flat * abs(mean) if channel.plane_class == PlaneClass.DEPTH else flat
    return not high > low or spread <= max(floor, channel.flat_share * step)


def map_channel(channel: Channel) -> MappedChannel:
    """Codes for a channel, or its mean where nothing but rounding is in it.

    Raises:
        NumericError: values beyond what can be coded.
    """
    values = channel.values
    low, high = channel.window
    if not max(-low, high) <= MAX_PLANE:
        raise NumericError(
            f"values from {low:.3g} to {high:.3g}, at most {MAX_PLANE:g} can be coded", where=channel.name
        )
    if channel.plane_class != PlaneClass.DEPTH:
        low, high = without_outliers(values, low, high, channel.step)
    mean, spread = mean_and_spread(values)
    flat = is_flat(channel, mean, spread, channel.step)
    code_map = CodeMap(0.0, mean, 0) if flat else choose_code_map(low, high, mean, channel.step)
    return MappedChannel(channel, code_map, (low, high))


_Jobs: TypeAlias = list[Future[tuple[CodedPlane, int]]]
"""Each view's plane, and how many of its values were clipped."""


class _Coding:
    """Channels on their way through the coder, several planes at a time; to be used in a `with` statement."""

    def __init__(self, coder: _OnceEach, threads: int, stats: EncodeStats, told: Told) -> None:
        self._coder, self._stats, self._told = coder, stats, told
        self._pool = ThreadPoolExecutor(max_workers=threads)
        self._begun: dict[int, tuple[MappedChannel, _Jobs]] = {}

    def __enter__(self) -> _Coding:
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        self._pool.shutdown(cancel_futures=error is not None)

    def begin(self, channel: Channel) -> tuple[MappedChannel, _Jobs]:
        """Give a channel to the coder, unless it has it; NumericError for values beyond what can be coded."""
        if id(channel) not in self._begun:
            with self._stats.watch.stage("quantise"):
                mapped = map_channel(channel)
            self._begun[id(channel)] = mapped, self._submit(mapped)
        return self._begun[id(channel)]

    def _submit(self, mapped: MappedChannel) -> _Jobs:
        """Codes are made, and let go, where they are coded."""
        code_map, offsets = mapped.code_map, mapped.channel.offsets
        if not code_map.scale:
            return []

        def code(view: int) -> tuple[CodedPlane, int]:
            codes, clipped = mapped.codes(view)
            return self._coder(codes, code_map.qp, None if offsets is None else offsets[view]), clipped

        return [self._pool.submit(code, view) for view in range(len(mapped.channel.values))]

    def wait(self) -> None:
        """Until all that was begun is coded."""
        every = [future for _, futures in self._begun.values() for future in futures]
        with self._stats.watch.stage("x265"):
            for _ in self._told.progress("coding planes", as_completed(every), total=len(every)):
                pass

    def finish(self, layer: Gaussians, plan: LayerPlan) -> CodedLayer:
        """A layer, once all its channels have been begun and are coded."""
        jobs = [self.begin(channel) for channel in plan.channels]
        with self._stats.watch.stage("x265"):
            if plan.refine_depth is not None and jobs[0][1]:
                depth = [future.result()[0] for future in jobs[0][1]]
                refinement = _refine(jobs[0][0], depth, plan.refine_depth, self._pool)
                jobs.insert(1, (refinement, self._submit(refinement)))
            planes = [(mapped, [future.result() for future in futures]) for mapped, futures in jobs]
        channels = []
        for mapped, coded in planes:
            if coded:
                self._stats.add_clipped(mapped.channel.plane_class, sum(count for _, count in coded))
            code_map, pictures = mapped.code_map, Picture.each_of(plane.payload for plane, _ in coded)
            channels.append(ChannelRecord(*mapped.channel.key, code_map.qp, code_map.scale, code_map.offset, pictures))
        sets = {plane.parameter_sets for _, coded in planes for plane, _ in coded}
        assert len(sets) <= 1, "parameter sets differ among planes of one size"
        height, width = layer.opacities.shape[1:]
        parameter_sets = next(iter(sets), b"")
        return CodedLayer(height, width, layer.degree, plan, tuple(channels), parameter_sets, layer.cameras)


def _refine(base: MappedChannel, coded: Sequence[CodedPlane], step: float, pool: ThreadPoolExecutor) -> MappedChannel:
    """What coding left of the base channel, as a channel of its own: it adds to the same target."""
    values, code_map = base.channel.values, base.code_map
    rest = disk.zeros(values.shape)

    def decode(view: int) -> None:
        decoded = coded[view].decoded(*values.shape[1:])
        np.subtract(values[view], code_map.dequantise(decoded), out=rest[view])

    list(pool.map(decode, range(len(coded))))
    return map_channel(replace(base.channel, values=rest, step=step, window=extent(rest)))
