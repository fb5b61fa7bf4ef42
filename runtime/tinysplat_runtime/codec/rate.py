"""Rate control of planes: what a search for a size or a fidelity codes at each Q_g, and where it looks first.

A model predicts what a plane costs at a quantiser step from the statistics of its 8 × 8 DCT, so that the first file
coded is within a few percent of the size; in the next one a few channels alone change.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..container.layers import CodedLayer
from ..container.planes import planes_file
from ..container.records import ChannelRecord, Picture
from ..container.writer import Head
from ..gaussian.planes import Channel, LayerPlan, PlaneClass
from .adaptive import depth_fineness, with_depth_pictures
from .depth_step.blocks import DEAD_ZONE, SIDE, dct
from .encoder import SceneEncoder, is_flat
from .job import MAX_GLOBAL_QP
from .quantise import choose_code_map
from .search import Coder

_PLANS = 3
_SAME_STEPS = 1.5
"""Farther than this from the Q_g that plans are of, and not too often, new plans are made."""

_REACH = 4.0
"""QPs that channels move by, one after the other."""

_TOO_FINE, _FINE_ENOUGH = 0.15, 1.0
"""Steps of depth, in the finest that 12 bits have, between which one picture and two are both tried."""

_SAMPLED_BLOCKS = 1024
_BINS_PER_OCTAVE = 8
_LEAST_LEVEL = 0.6
"""Coefficients below this share of the step cost nothing."""

_TINY = 1e-30
_LEAST_FALL = 0.02
_SHIFT_RESOLUTION = 1e-3

_BITS_PER_COEFFICIENT, _BITS_PER_OCTAVE, _BITS_PER_BLOCK = 3.0, 1.05, 0.9
"""Fitted to the four profiles on two scenes over 30 QPs, whose totals they predict to 5 %; to 15 % elsewhere."""


class PlanesCoder(Coder):
    """Files of one scene at many Q_g, whose plans are made anew only where Q_g has moved.

    Once near, steps alone change: what else follows from Q_g (components kept, the SH degree) could jump. On the way to
    a size channels move one after the other, so that files share most planes, which are coded once.
    """

    db_per_qp = 0.6

    def __init__(self, encoder: SceneEncoder, depth_pictures: int | None = None) -> None:
        self.profile = encoder.job.profile
        self._encoder, self._pictures = encoder, depth_pictures
        self._plans: list[LayerPlan] = []
        self._planned, self._times, self._one_by_one = math.inf, 0, False

    def code(self, qp: float) -> bytes:
        """The file of Q_g = `qp`."""
        return self._encoder.code(self._plans_at(qp), qp)

    def expect(self, size: float) -> tuple[float, float]:
        """Q_g whose file the model expects to have `size` bytes, and octaves lost by Q_g there; plans stay near it."""
        qp = 0.0
        while True:
            plans = self._plans_at(qp)
            predicted = partial(_predicted, _models(plans), self._metadata_bytes(plans))
            shift = _solve(lambda by: predicted(by) - size, -MAX_GLOBAL_QP - qp, MAX_GLOBAL_QP - qp)  # noqa: B023
            qp += shift
            if abs(shift) <= _SAME_STEPS or self._times == _PLANS:
                self._plans, self._planned, self._times = [_scaled(plan, shift) for plan in plans], qp, _PLANS
                self._one_by_one = True
                return qp, max(math.log2(predicted(shift - 0.5) / predicted(shift + 0.5)), _LEAST_FALL)

    def other(self, qp: float) -> Coder | None:
        """One picture of depth in place of two or the other way round, unless those planned are clearly right.

        The choice changes dB by steps: with both tried, asking for more dB hardly ever gives fewer bytes.
        """
        for plan in self._plans_at(qp):
            fineness = depth_fineness(plan)
            if fineness is not None and _TOO_FINE < fineness < _FINE_ENOUGH:
                return PlanesCoder(self._encoder, 1 if plan.refine_depth is not None else 2)
        return None

    def _plans_at(self, qp: float) -> list[LayerPlan]:
        if abs(qp - self._planned) > _SAME_STEPS and self._times < _PLANS:
            plans = self._encoder.plan(qp)
            if self._pictures is not None:
                plans = [with_depth_pictures(plan, self._pictures) for plan in plans]
            self._plans, self._planned, self._times = plans, qp, self._times + 1
        shift = qp - self._planned
        if not shift or not self._one_by_one:
            return [_scaled(plan, shift) for plan in self._plans]
        shifts = iter(_one_by_one(_models(self._plans), shift))
        return [_scaled(plan, [next(shifts) for _ in plan.channels]) for plan in self._plans]

    def _metadata_bytes(self, plans: Sequence[LayerPlan]) -> int:
        """About what a file of such plans has besides its pictures."""
        layers = []
        for layer, plan in zip(self._encoder.job.gaussians.layers, plans, strict=True):
            one_each = Picture.each_of([b"\0"] * len(layer.cameras))
            channels = tuple(ChannelRecord(c.plane_class, c.target, 0, 0.0, 0.0, one_each) for c in plan.channels)
            height, width = layer.opacities.shape[1:]
            layers.append(CodedLayer(height, width, layer.degree, plan, channels, b"", layer.cameras))
        scene = self._encoder.job.gaussians
        return len(planes_file(Head(scene.cameras, scene.origin, "", 0.0, scene.notes), layers))


class ChannelModel:
    """What the pictures of a channel cost at any step, from a sample of the 8 × 8 DCT of its values."""

    def __init__(self, channel: Channel, refine_step: float | None = None) -> None:
        """Sample the channel.

        Args:
            channel: its step is the one at shift 0.
            refine_step: step of the second coding of what the first leaves, if there is one.
        """
        self._channel, self._refine_step = channel, refine_step
        self._spread = float(channel.values.std(dtype=np.float64))
        self._mean = float(channel.values.mean(dtype=np.float64))
        self._coefficients, self._blocks_per_sample = _sampled_dct(channel.values)
        # Sums over the coefficients above each bin's lower edge, for a look-up in place of a pass over all of them.
        octaves = np.log2(np.maximum(self._coefficients.ravel(), _TINY), dtype=np.float64)
        bins = np.floor(octaves * _BINS_PER_OCTAVE).astype(np.int64)
        self._first_bin = int(bins.min())
        self._counts = np.bincount(bins - self._first_bin)[::-1].cumsum()[::-1]
        self._octaves = np.bincount(bins - self._first_bin, weights=octaves)[::-1].cumsum()[::-1]

    def bytes_at(self, shift: float) -> float:
        """Bytes with the channel's steps multiplied by 2^(shift/6)."""
        factor = 2 ** (shift / 6)
        (low, high), step = self._channel.window, self._channel.step * factor
        if is_flat(self._channel, self._mean, self._spread, step):
            return 0.0
        step = choose_code_map(low, high, self._mean, step).step
        edges = self._first_bin + np.arange(len(self._counts))
        at = math.log2(_LEAST_LEVEL * step) * _BINS_PER_OCTAVE
        count = float(np.interp(at, edges, self._counts, right=0.0))
        octaves = float(np.interp(at, edges, self._octaves, right=0.0))
        bits = self._bits(count, octaves, step)
        if self._refine_step is not None:
            bits += self._refinement_bits(step, self._refine_step * factor)
        return bits / 8

    def _refinement_bits(self, coarse: float, fine: float) -> float:
        rounded = np.floor(self._coefficients / coarse + DEAD_ZONE)
        rest = np.abs(self._coefficients - coarse * rounded)
        kept = rest[rest > _LEAST_LEVEL * fine]
        return self._bits(len(kept), float(np.log2(kept).sum(dtype=np.float64)), fine)

    def _bits(self, count: float, octaves: float, step: float) -> float:
        above = octaves - count * math.log2(step)
        sampled = len(self._coefficients)
        bits = _BITS_PER_COEFFICIENT * count + _BITS_PER_OCTAVE * above + _BITS_PER_BLOCK * sampled
        return bits * self._blocks_per_sample


def _sampled_dct(values: NDArray) -> tuple[NDArray, float]:
    """Magnitudes (n, 64) float32 of the DCT of about `_SAMPLED_BLOCKS` of the planes' blocks, and blocks per sample.

    The mean of a block counts by half its difference to its neighbour, as intra prediction takes off the rest.
    """
    views, height, width = values.shape
    if height < SIDE or width < SIDE:
        grow = ((0, 0), (0, max(SIDE - height, 0)), (0, max(SIDE - width, 0)))
        values = np.pad(values, grow, mode="edge")
    rows, columns = values.shape[1] // SIDE, values.shape[2] // SIDE
    blocks = values[:, : rows * SIDE, : columns * SIDE].reshape(views, rows, SIDE, columns, SIDE)
    means = blocks.mean(axis=(2, 4))  # (V, rows, columns)
    steps = np.diff(means, axis=2, prepend=np.roll(means[:, :, :1], 1, axis=1))
    count = means.size
    stride = -(-count // _SAMPLED_BLOCKS) | 1  # odd, so that it does not fall in step with the columns
    sampled = blocks.swapaxes(2, 3).reshape(count, SIDE, SIDE)[::stride].astype(np.float32)
    magnitudes = np.abs(dct(np.ascontiguousarray(np.moveaxis(sampled, 0, -1)))).reshape(SIDE * SIDE, -1).T.copy()
    magnitudes[:, 0] = np.abs(steps.reshape(count)[::stride]) * (SIDE / 2)
    return magnitudes, count / len(sampled)


def _models(plans: Sequence[LayerPlan]) -> list[ChannelModel]:
    """One per channel, in the plans' order."""
    return [
        ChannelModel(channel, plan.refine_depth if channel.plane_class == PlaneClass.DEPTH else None)
        for plan in plans
        for channel in plan.channels
    ]


def _predicted(models: Sequence[ChannelModel], others: int, shift: float) -> float:
    return sum(model.bytes_at(shift) for model in models) + others


def _one_by_one(models: Sequence[ChannelModel], shift: float) -> NDArray:
    """Shifts of channels that come to `shift` in the mean over their bytes, the largest channel's first."""
    sizes = np.array([model.bytes_at(0) for model in models]) + _TINY
    order = np.argsort(-sizes, kind="stable")
    before = np.empty(len(sizes))
    before[order] = np.cumsum(sizes[order]) - sizes[order]
    rounds, part = divmod(abs(shift) / _REACH, 1)
    moved = np.clip((part * sizes.sum() - before) / sizes, 0, 1)
    return math.copysign(_REACH, shift) * (rounds + moved)


def _scaled(plan: LayerPlan, shift: float | Sequence[float]) -> LayerPlan:
    """The plan with its steps multiplied by 2^(shift/6), one shift for all channels or one for each."""
    shifts = np.broadcast_to(np.asarray(shift, np.float64), (len(plan.channels),))
    channels = [replace(c, step=c.step * 2 ** (float(s) / 6)) for c, s in zip(plan.channels, shifts, strict=True)]
    fine = plan.refine_depth
    if fine is not None:
        depth = next(i for i, c in enumerate(plan.channels) if c.plane_class == PlaneClass.DEPTH)
        fine *= 2 ** (float(shifts[depth]) / 6)
    return replace(plan, channels=tuple(channels), refine_depth=fine)


def _solve(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a falling function crosses 0, or the end that is nearer to it."""
    if function(low) <= 0:
        return low
    if function(high) >= 0:
        return high
    while high - low > _SHIFT_RESOLUTION:
        middle = (low + high) / 2
        if function(middle) > 0:
            low = middle
        else:
            high = middle
    return high
