"""A list to a file's bytes, as often as a search for a size or a quality wants.

Tiers (`levels`) are coded one after the other, with one grid, one set of gains and one basis of colours for all.

Positions go to a grid and into an octree, which sorts all else along a Morton curve. Then opacity, the size, and how
long a Gaussian is are coded, in this order, each sorted by those before it (`orders`), and the others by all that they
depend on. What is coded is decoded again at once, since the order of what follows depends on what a decoder will see.
Colours come last, so that they can make up for what all else lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ...codec.depth_step.blocks import whole_steps
from ...codec.hevc import CodedPlane, encode_plane
from ...codec.job import Job, check_qp
from ...codec.profiles import EncoderSettings
from ...codec.quantise import CodeMap, choose_code_map, without_outliers
from ...codec.search import Coder
from ...container.cameras import rounded_cameras
from ...container.list import (
    DETERMINING,
    MAX_EXPONENT,
    MAX_PER_BYTE,
    ListChannel,
    ListScene,
    PointGrid,
    Tier,
    WeightClasses,
    list_rows,
    list_sections,
    order_of,
    range_fault,
)
from ...container.records import ChannelRecord
from ...container.writer import Head, write_container
from ...errors import InputError
from ...gaussian.curve import morton_keys
from ...gaussian.gaussians import FIELDS, Gaussians
from ...gaussian.planes import PlaneClass
from ...scene.cameras import Camera
from ...scene.neighbours import spread
from ...system import disk
from ...system.decibels import decibels
from ...system.evenly import evenly
from ...system.threads import Crew
from ..blocks import blocks_of
from ..evenness import sizes_about
from ..views import Views, pictures_of, views_of, views_of_block
from ..visible import taken, visible_rows
from .attributes import KNEE, LEAST_SCALE, Columns, companded, to_columns
from .colours import FLAT_SHARE, principal_colours
from .decoder import arrays_by_tier, fill
from .grid import cells_in, grid_of, means_of, with_cell
from .levels import WHOLE, Level, Tiers
from .octree import encode_points
from .orders import Numbers, Order, along_the_curve, choose_classes, order_by, reached
from .planes import to_plane
from .steps import DENSE_PLACE, OBJECT, OBJECT_DB, PLACE_DB, SPARSE, Steps, of_pictures

ROUND, LONGEST, COARSEST_TURN = 1.5, 80, 16.0
"""How a round Gaussian is turned does not show: steps of rotation are as many times coarser as the logarithm of the
ratio of the largest to the smallest scale, in this percentile of Gaussians, goes into the first number; at most so
many times. Trained scenes have 3.7 and more, all pixels of a capture 0.2.
"""

EVEN_SIZES = 8.0
"""Sizes of a place all have steps of the same share: they are coded where `companded` is so many times finer."""

ROOT_THRESHOLDS = np.exp2(np.arange(-8, 1) / 2).astype(np.float32)
"""Half octaves of √opacity, from that of the least opacity that shows."""

LENGTH_THRESHOLDS = (np.arange(1, 5) * math.log(2)).astype(np.float32)
"""Half octaves of the square root of length over width; none beyond √20, where errors stop growing."""

UNSEEN = 0.9
"""Steps of what nobody knows how it is looked at, over those of Gaussians that cover several pixels."""

MOST_MEASURED, MOST_BLOCKS = 8, 4
"""Views that steps are measured in; and blocks of a large list."""

MOST_VIEWPOINTS = 64
"""Cameras of photos that a file keeps; of more, those that lie far from one another."""


@dataclass(frozen=True)
class _Coded:
    """A channel in the file, its picture unless it is a number, and what a decoder makes of it."""

    channel: ListChannel
    picture: CodedPlane | None
    values: Numbers


@dataclass(frozen=True)
class _Tier:
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
    coded: list[_Coded] = field(default_factory=list)
    orders: list[Order] = field(default_factory=list)


class ListEncoder(Coder):
    """Codes one set of Gaussians at any Q_g.

    Attributes:
        steps: at Q_g = 0.
    """

    def __init__(
        self,
        job: Job,
        *,
        views: Views | None = None,
        steps: Steps | None = None,
        tiers: Tiers | None = None,
        recolour: Callable[[Gaussians, NDArray], NDArray] | None = None,
    ) -> None:
        """Leave out what no renderer shows.

        Args:
            job: any Gaussians, with `tiers` a list, and how they are coded; its Q_g is not looked at.
            views: where people look at them from; None for what `views_of` finds.
            steps: at Q_g = 0; None for those that pictures of `views` ask for.
            tiers: what a prefix shows first; None for one tier.
            recolour: gives SH (N, B, 3) to Gaussians as they are decoded, but with the colours that they had; told
                which of the job's they are.

        Raises:
            InputError: no Gaussian shows; or numbers beyond what a file can hold.
        """
        shown = visible_rows(flat := job.gaussians.flat())
        self._shown = np.flatnonzero(shown)
        self._gaussians = taken(flat, self._shown)
        self._job, self._recolour = replace(job, gaussians=self._gaussians), recolour
        self.profile = job.profile
        self._tiers = tiers.of(shown) if tiers else Tiers.whole(self._gaussians.count)
        views = views or views_of(self._gaussians)
        self._sizes = None if views.is_object else sizes_about(self._gaussians)
        # Order by weight leaves no blocks that have QPs of their own.
        self._settings = replace(job.profile.encoder, block_qps=False)
        if steps is None:
            with job.stats.watch.stage("steps"):
                steps = self._of_pictures(views)
        self.steps = steps

    def code(self, qp: float, factor: float = 1.0) -> bytes:
        """The file at Q_g, whose steps are taken so many times.

        Raises:
            InputError: Q_g is beyond ±60, or a reader would refuse the file: numbers too large for it, or so many equal
                Gaussians that its bytes do not pay for them.
        """
        check_qp(qp)
        steps = self._steps_at(qp, factor)
        with self._job.stats.watch.stage("sort"):
            tiers = self._placed(steps)
        with self._job.stats.watch.stage("x265"):
            scene = self._coded(tiers, steps, self._settings)
        fault = range_fault(scene)
        if fault is not None:
            raise InputError(fault[1], where=fault[0])
        pictures = [{c.channel.record.key: c.picture for c in tier.coded if c.picture} for tier in tiers]
        payloads = [{key: picture.payload for key, picture in own.items()} for own in pictures]
        sets = [next((picture.parameter_sets for picture in own.values()), b"") for own in pictures]
        with self._job.stats.watch.stage("write"):
            origin, viewpoints = self._gaussians.origin, spread(self._gaussians.viewpoints, MOST_VIEWPOINTS)
            cameras, notes = rounded_cameras(viewpoints, origin), self._gaussians.notes
            head, sections = Head(cameras, origin, self.profile.name, qp, notes), list_sections(scene, sets)
            data = write_container(head, sections, list(list_rows(scene, payloads)), len(scene.tiers), views=1)
        if scene.count > MAX_PER_BYTE * len(data):
            found = f"{scene.count} Gaussians come to {len(data)} bytes, which stand for {MAX_PER_BYTE} each at most"
            raise InputError(found, where="qp")
        return data

    def rounded(self, qp: float, factor: float = 1.0) -> Gaussians:
        """About what a decoder will see of a file of one tier at Q_g, in the order given: all rounded to their steps.

        Without x265 and the octree's bytes, which take most of the time.
        """
        return self._rounded(self._steps_at(qp, factor))

    def _steps_at(self, qp: float, factor: float) -> Steps:
        return self.steps.times(self.profile.list_steps * factor * 2 ** (qp / 6))

    def _rounded(self, steps: Steps) -> Gaussians:
        grid, space = grid_of(self._gaussians.means.astype(np.float64), self._sizes, steps.cell)
        rows = np.arange(self._gaussians.count)
        tiers = [_Tier(WHOLE[0], rows, grid, cells_in(grid, space), to_columns(self._gaussians, rows))]
        scene = self._coded(tiers, steps, None)
        fields = _decoded(tiers, scene.size_middle, scene.mean, scene.basis)
        return Gaussians.unchecked(**fields, origin=self._gaussians.origin)

    def _of_pictures(self, views: Views) -> Steps:
        """Steps that views ask for; of what nobody knows how it is looked at, those that show from anywhere."""
        dense = (OBJECT if views.is_object else DENSE_PLACE).turned_by(_turn_step(self._gaussians))
        looked_at = list(self._looked_at(views))
        if not looked_at:
            return SPARSE.times(UNSEEN)

        def pictures(of: Callable[[ListEncoder], Gaussians]) -> Iterator[NDArray]:
            for coder, cameras in looked_at:
                yield from pictures_of(of(coder), cameras, self._job.threads)
                disk.let_go()

        wanted = list(pictures(lambda coder: coder._gaussians))

        def psnr(steps: Steps) -> float:
            found = pictures(lambda coder: coder._rounded(steps))
            return decibels(float(np.mean([np.square(a - b).mean() for a, b in zip(found, wanted, strict=True)])))

        return of_pictures(dense, psnr, OBJECT_DB if views.is_object else PLACE_DB)

    def _looked_at(self, views: Views) -> Iterator[tuple[ListEncoder, list[Camera]]]:
        """Coders of some blocks, whose steps nobody knows yet, and cameras that see these."""
        if not views.deciding:
            return
        blocks = blocks_of(self._gaussians.means)
        if len(blocks) == 1:
            yield self, views.some(MOST_MEASURED)
            return
        for number in evenly(len(blocks), MOST_BLOCKS):
            block = taken(self._gaussians, blocks[number])
            cameras = views_of_block(block, views).some(MOST_MEASURED // min(len(blocks), MOST_BLOCKS))
            if cameras:
                yield self.of_block(block, views, SPARSE), cameras
            disk.let_go()

    def of_block(self, block: Gaussians, views: Views, steps: Steps) -> ListEncoder:
        """The same for a block of them."""
        return ListEncoder(replace(self._job, gaussians=block), views=views, steps=steps)

    def _placed(self, steps: Steps) -> list[_Tier]:
        """Tiers with their positions coded, each along the curve."""
        whole, space = grid_of(self._gaussians.means.astype(np.float64), self._sizes, steps.cell)
        placed = []
        for number, level in enumerate(self._tiers.levels):
            rows = np.flatnonzero(self._tiers.numbers == number)
            grid = with_cell(whole, whole.cell * level.cell, space)
            cells = cells_in(grid, space[rows])
            keys = morton_keys(cells)
            order = _settled_order(keys, self._gaussians, rows)
            points = encode_points(keys[order], int(cells.max()).bit_length() or 1)
            columns = to_columns(self._gaussians, rows[order])
            placed.append(_Tier(level, rows[order], replace(grid, **vars(points)), cells[order], columns))
        return placed

    def _coded(self, tiers: Sequence[_Tier], steps: Steps, settings: EncoderSettings | None) -> ListScene:
        """The scene, and in each tier its channels in the order of records; without settings rounded alone."""
        run_jobs = Crew(self._job.threads).map
        code = _ChannelCoder(steps, settings, self._job.told.counted("coding", run_jobs) if settings else run_jobs)
        sizes = np.concatenate([tier.columns.sizes for tier in tiers])
        middle = _middle(sizes) if steps.by_size else _far_below(sizes)
        thresholds, weights = _code_shapes(tiers, middle, code)
        sh, rows = self._gaussians.sh, [tier.rows for tier in tiers]
        if self._recolour and settings is not None:
            fields = _decoded(tiers, middle, np.zeros(3, np.float32), np.zeros((3, 0), np.float16))
            fields["sh"] = sh[np.concatenate(rows)]
            decoded = Gaussians.unchecked(**fields, origin=self._gaussians.origin)
            sh = self._recolour(decoded, self._shown[np.concatenate(rows)])
            rows = np.split(np.arange(len(sh)), np.cumsum([len(own) for own in rows])[:-1])
        gains = np.concatenate([tier.orders[2].gains for tier in tiers])
        flat = sh.reshape(len(sh), -1)
        palette = principal_colours(flat, np.concatenate(rows), gains, steps)
        mean, basis = palette.mean, palette.basis
        coded = []
        for number, (tier, own) in enumerate(zip(tiers, rows, strict=True)):
            for first, components in palette.components(flat, own):
                jobs = [(PlaneClass.COLOR, target, values) for target, values in enumerate(components, start=first)]
                tier.coded.extend(code.all(jobs, tier))
            tier.coded.sort(key=lambda c: c.channel.record.key)
            growth = self._tiers.growths[number - 1] if number else 0.0
            coded.append(Tier(len(tier.cells), tier.grid, tuple(c.channel for c in tier.coded), growth=growth))
        degree = math.isqrt(len(mean) // 3) - 1
        return ListScene(degree, middle, thresholds, weights, mean, basis, tuple(coded))


def _settled_order(keys: NDArray, gaussians: Gaussians, of: NDArray) -> NDArray:
    """Along the curve; of the Gaussians `of` (n,) integer, those of one cell by their numbers, so that the order they
    came in plays no part.
    """
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    is_same = ordered[1:] == ordered[:-1]
    tied = np.flatnonzero(np.append(is_same, False) | np.append(False, is_same))
    if len(tied):
        rows = order[tied]
        numbers = [getattr(gaussians, name)[of[rows]].reshape(len(rows), -1) for name in reversed(FIELDS)]
        order[tied] = rows[np.lexsort([*np.concatenate(numbers, axis=1).T, ordered[tied]])]
    return order


def _decoded(tiers: Sequence[_Tier], middle: float, mean: NDArray, basis: NDArray) -> dict[str, NDArray]:
    """Arrays of what a decoder will see of tiers; `middle`, `mean` and `basis` are those of `ListScene`."""
    fields, parts = arrays_by_tier([len(tier.cells) for tier in tiers], len(mean))
    for tier, part in zip(tiers, parts, strict=True):
        part["means"][:] = means_of(tier.grid, tier.cells)
        fill(part, {c.channel.record.key: c.values for c in tier.coded}, middle, mean, basis)
    return fields


@dataclass(frozen=True)
class _ChannelCoder:
    """Codes channels at some steps; without settings they are rounded alone."""

    steps: Steps
    settings: EncoderSettings | None
    run_jobs: Callable

    def all(self, jobs: Sequence[tuple[PlaneClass, int, NDArray]], tier: _Tier) -> list[_Coded]:
        """Channels of a tier that do not depend on one another, by class and target."""

        def one(job: tuple[PlaneClass, int, NDArray]) -> _Coded:
            return self.one(*job, tier)

        found: list[_Coded] = self.run_jobs(one, jobs)
        return found

    def one(self, plane_class: PlaneClass, target: int, values: NDArray, tier: _Tier) -> _Coded:
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
                return _Coded(channel, None, Numbers(whole, step, mean, order.gains, centre))
            code_map = choose_code_map(low, high, mean, step)
            codes, _ = code_map.quantise(to_plane(numbers[order.rows]))
            picture = encode_plane(codes, code_map.qp, self.settings)
            codes = picture.decoded(*codes.shape)
        record = ChannelRecord(plane_class, target, code_map.qp, code_map.scale, code_map.offset)
        channel = ListChannel(record, centre)
        return _Coded(channel, picture, Numbers.of(channel, codes, order))

    def _step(self, plane_class: PlaneClass, target: int) -> float:
        step = self.steps.of(plane_class, target)
        if (plane_class, target) == (PlaneClass.SCALE, 0) and not self.steps.by_size:
            step *= EVEN_SIZES
        return step


def _code_shapes(
    tiers: Sequence[_Tier], middle: float, code: _ChannelCoder
) -> tuple[tuple[NDArray, ...], tuple[WeightClasses, ...]]:
    """Code all channels of tiers but colours, and say by which thresholds and weights each one's order is known.

    In a place, larger Gaussians weigh no more than smaller ones.
    """
    sizes = np.concatenate([tier.columns.sizes for tier in tiers])
    by_size = _size_thresholds(sizes, middle) if code.steps.by_size else np.zeros(0, np.float32)
    thresholds = (ROOT_THRESHOLDS, by_size, LENGTH_THRESHOLDS)
    weights: list[WeightClasses] = []
    logs = np.zeros(len(sizes))
    counts = [np.zeros(len(tier.cells), np.uint16) for tier in tiers]
    for tier in tiers:
        tier.orders.append(along_the_curve(len(tier.cells)))
    for number, (plane_class, target) in enumerate(DETERMINING):
        for tier, count in zip(tiers, counts, strict=True):
            source = (tier.columns.roots, companded(tier.columns.sizes, middle), tier.columns.lengths)[number]
            tier.coded.append(code.one(plane_class, target, source, tier))
            count += reached(tier.coded[-1].values[:], thresholds[number])
        if code.steps.by_size or (plane_class, target) != (PlaneClass.SCALE, 0):
            logs += np.concatenate([_log_weight(tier.columns, number) for tier in tiers])
        weights.append(choose_classes(np.concatenate(counts), logs))
        for tier, own in zip(tiers, counts, strict=True):
            tier.orders.append(order_by(own, weights[number]))
    for tier in tiers:
        rest = [(PlaneClass.SCALE, 2, tier.columns.thins)]
        rest += [(PlaneClass.ROTATION, target, tier.columns.turns[:, target]) for target in range(3)]
        tier.coded.extend(code.all(rest, tier))
    return thresholds, tuple(weights)


def _log_weight(columns: Columns, determinant: int) -> NDArray:
    """log2 of what a determinant makes a Gaussian weigh."""
    if determinant == 0:
        return np.log2(np.maximum(columns.roots, 1e-9))
    return (columns.sizes if determinant == 1 else columns.lengths) / math.log(4)


def _middle(sizes: NDArray) -> float:
    """The size whose steps are those of the logarithm."""
    return float(np.float32(2 * np.log(np.exp(sizes / 2 - sizes.max() / 2).mean()) + sizes.max()))


def _turn_step(gaussians: Gaussians) -> float:
    """By how much steps of rotation are coarser, as Gaussians are round."""
    longest, smallest = gaussians.scales.max(axis=1), gaussians.scales.min(axis=1)
    ratios = np.log(np.maximum(longest, LEAST_SCALE) / np.maximum(smallest, LEAST_SCALE), dtype=np.float64)
    return float(np.clip(ROUND / max(np.percentile(ratios, LONGEST), 1e-9), 1, COARSEST_TURN))


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
