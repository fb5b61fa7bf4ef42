"""Channels of a list's tiers, in the order in which a decoder meets them: coded to pictures, or rounded alone.

Opacity, the size, and how long a Gaussian is come first, each sorted by those before it (`orders`), and then the others
by all that they depend on. What is coded is decoded again at once, since the order of what follows depends on what a
decoder will see. Colours come last, so that they can make up for what all else lost.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...codec.depth_step.blocks import whole_steps
from ...codec.hevc import CodedPlane, encode_plane
from ...codec.profiles import EncoderSettings
from ...codec.quantise import CodeMap, choose_code_map, without_outliers
from ...container.list import DETERMINING, MAX_EXPONENT, ListChannel, PointGrid, WeightClasses, order_of
from ...container.records import ChannelRecord
from ...gaussian.planes import PlaneClass
from .attributes import KNEE, Columns, companded
from .colours import FLAT_SHARE, Palette, principal_colours
from .decoder import arrays_by_tier, fill
from .grid import means_of
from .levels import Level
from .orders import Numbers, Order, along_the_curve, choose_classes, order_by, reached
from .planes import to_plane
from .steps import Steps

EVEN_SIZES = 8.0
"""Sizes of a place all have steps of the same share: they are coded where `companded` is so many times finer."""

ROOT_THRESHOLDS = np.exp2(np.arange(-8, 1) / 2).astype(np.float32)
"""Half octaves of √opacity, from that of the least opacity that shows."""

LENGTH_THRESHOLDS = (np.arange(1, 5) * math.log(2)).astype(np.float32)
"""Half octaves of the square root of length over width; none beyond √20, where errors stop growing."""


@dataclass(frozen=True)
class CodedChannel:
    """A channel in the file, its picture unless it is a number, and what a decoder makes of it."""

    channel: ListChannel
    picture: CodedPlane | None
    values: Numbers


@dataclass(frozen=True)
class PlacedTier:
    """Gaussians of a tier along the curve.

    Attributes:
        level: how it is made.
        rows: which of all Gaussians they are.
        grid, cells: where they lie.
        columns: their channels.
        coded: those that are coded so far.
        orders: what follows from these.
    """

    level: Level
    rows: NDArray
    grid: PointGrid
    cells: NDArray
    columns: Columns
    coded: list[CodedChannel] = field(default_factory=list)
    orders: list[Order] = field(default_factory=list)


@dataclass(frozen=True)
class ChannelCoder:
    """Codes channels at some steps; without settings they are rounded alone."""

    steps: Steps
    settings: EncoderSettings | None
    run_jobs: Callable

    def all(self, jobs: Sequence[tuple[PlaneClass, int, NDArray]], tier: PlacedTier) -> list[CodedChannel]:
        """Channels of a tier that do not depend on one another, by class and target."""

        def one(job: tuple[PlaneClass, int, NDArray]) -> CodedChannel:
            return self.one(*job, tier)

        found: list[CodedChannel] = self.run_jobs(one, jobs)
        return found

    def one(self, plane_class: PlaneClass, target: int, values: NDArray, tier: PlacedTier) -> CodedChannel:
        """A channel: numbers over their gains, as a picture in their order."""
        step, order = self._step(plane_class, target) * tier.level.steps, tier.orders[order_of(plane_class, target)]
        # Components of colour have no mean: it is stored for all coefficients.
        centre = 0.0 if plane_class == PlaneClass.COLOR else float(np.float32(values.mean()))
        numbers = ((values - centre) / order.gains).astype(np.float32)
        low, high, mean = float(numbers.min()), float(numbers.max()), float(numbers.mean(dtype=np.float64))
        is_flat = numbers.std(dtype=np.float64) <= FLAT_SHARE * step or not high > low
        if not is_flat:
            low, high = without_outliers(numbers, low, high, step)
        code_map, picture, codes = CodeMap(0.0, float(np.float32(mean)), 0), None, None
        if high > low and not is_flat:  # a range far from zero can vanish in rounding
            if self.settings is None:
                whole = _narrow(whole_steps((numbers - mean) / step))
                channel = ListChannel(ChannelRecord(plane_class, target, 0, 0.0, 0.0), centre)
                return CodedChannel(channel, None, Numbers(whole, step, mean, order.gains, centre))
            code_map = choose_code_map(low, high, mean, step)
            codes, _ = code_map.quantise(to_plane(numbers[order.rows]))
            picture = encode_plane(codes, code_map.qp, self.settings)
            codes = picture.decoded(*codes.shape)
        record = ChannelRecord(plane_class, target, code_map.qp, code_map.scale, code_map.offset)
        channel = ListChannel(record, centre)
        return CodedChannel(channel, picture, Numbers.of(channel, codes, order))

    def _step(self, plane_class: PlaneClass, target: int) -> float:
        step = self.steps.of(plane_class, target)
        if (plane_class, target) == (PlaneClass.SCALE, 0) and not self.steps.by_size:
            step *= EVEN_SIZES
        return step


@dataclass(frozen=True)
class Shapes:
    """What all channels but colours are coded with; attributes as those of `ListScene`."""

    size_middle: float
    thresholds: tuple[NDArray, ...]
    orders: tuple[WeightClasses, ...]


def code_shapes(tiers: Sequence[PlacedTier], code: ChannelCoder) -> Shapes:
    """Code all channels of tiers but colours, which says by what each one's order is known.

    In a place, larger Gaussians weigh no more than smaller ones.
    """
    sizes = np.concatenate([tier.columns.sizes for tier in tiers])
    middle = _middle(sizes) if code.steps.by_size else _far_below(sizes)
    by_size = _size_thresholds(sizes, middle) if code.steps.by_size else np.zeros(0, np.float32)
    thresholds = (ROOT_THRESHOLDS, by_size, LENGTH_THRESHOLDS)
    weights: list[WeightClasses] = []
    logs = np.zeros(len(sizes))
    counts = [np.zeros(len(tier.cells), np.uint16) for tier in tiers]
    sources = [_sources_of(tier.columns, middle) for tier in tiers]
    for tier in tiers:
        tier.orders.append(along_the_curve(len(tier.cells)))
    for number, name in enumerate(DETERMINING):
        for tier, source, count in zip(tiers, sources, counts, strict=True):
            tier.coded.append(code.one(*name, source.pop(name), tier))
            count += reached(tier.coded[-1].values[:], thresholds[number])
        if code.steps.by_size or name != (PlaneClass.SCALE, 0):
            logs += np.concatenate([_log_weight(tier.columns, number) for tier in tiers])
        weights.append(choose_classes(np.concatenate(counts), logs))
        for tier, own in zip(tiers, counts, strict=True):
            tier.orders.append(order_by(own, weights[number]))
    for tier, source in zip(tiers, sources, strict=True):
        tier.coded.extend(code.all([(*name, values) for name, values in source.items()], tier))
    return Shapes(middle, thresholds, tuple(weights))


def _sources_of(columns: Columns, middle: float) -> dict[tuple[PlaneClass, int], NDArray]:
    """All channels but colours; `middle` as `ListScene` has it."""
    return {
        (PlaneClass.OPACITY, 0): columns.roots,
        (PlaneClass.SCALE, 0): companded(columns.sizes, middle),
        (PlaneClass.SCALE, 1): columns.lengths,
        (PlaneClass.SCALE, 2): columns.thins,
        **{(PlaneClass.ROTATION, target): columns.turns[:, target] for target in range(3)},
    }


def code_colours(tiers: Sequence[PlacedTier], code: ChannelCoder, sh: NDArray, rows: Sequence[NDArray]) -> Palette:
    """Code colours of tiers, whose rows (n,) of SH (N, B, 3) these are, behind all else; sorts each tier's channels by
    their records.
    """
    gains = np.concatenate([tier.orders[2].gains for tier in tiers])
    flat = sh.reshape(len(sh), -1)
    palette = principal_colours(flat, np.concatenate(rows), gains, code.steps)
    for tier, own in zip(tiers, rows, strict=True):
        for first, components in palette.components(flat, own):
            jobs = [(PlaneClass.COLOR, target, values) for target, values in enumerate(components, start=first)]
            tier.coded.extend(code.all(jobs, tier))
        tier.coded.sort(key=lambda c: c.channel.record.key)
    return palette


def _log_weight(columns: Columns, determinant: int) -> NDArray:
    """log2 of what a determinant makes a Gaussian weigh."""
    if determinant == 0:
        return np.log2(np.maximum(columns.roots, 1e-9))
    return (columns.sizes if determinant == 1 else columns.lengths) / math.log(4)


def _middle(sizes: NDArray) -> float:
    """The size whose steps are those of the logarithm."""
    return float(np.float32(2 * np.log(np.exp(sizes / 2 - sizes.max() / 2).mean()) + sizes.max()))


def _far_below(sizes: NDArray) -> float:
    """The same such that steps of all sizes are the same share of them, `EVEN_SIZES` times finer."""
    return float(np.float32(max(float(np.percentile(sizes, 0.5)) - KNEE, -MAX_EXPONENT)))


def _size_thresholds(sizes: NDArray, middle: float) -> NDArray:
    """Half octaves of the square root of sizes, between those of nearly all, as companded numbers."""
    low, high = np.percentile(sizes, (0.5, 99.5)) / math.log(2)
    at = np.arange(math.floor(low), math.ceil(high) + 1)[:128] * math.log(2)
    return np.unique(companded(at, middle).astype(np.float32))


def _narrow(whole: NDArray) -> NDArray:
    """Whole numbers, of two bytes each where these hold them."""
    most = np.abs(whole).max()
    return whole.astype(np.int16) if most < 1 << 15 else whole


def decoded(tiers: Sequence[PlacedTier], middle: float, mean: NDArray, basis: NDArray) -> dict[str, NDArray]:
    """Arrays of what a decoder will see of tiers, by name; `middle`, `mean` and `basis` are those of `ListScene`."""
    fields, parts = arrays_by_tier([len(tier.cells) for tier in tiers], len(mean))
    for tier, part in zip(tiers, parts, strict=True):
        part["means"][:] = means_of(tier.grid, tier.cells)
        fill(part, {c.channel.record.key: c.values for c in tier.coded}, middle, mean, basis)
    return fields
