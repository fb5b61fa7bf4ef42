"""Rate control: the file of a wanted size, or of a wanted fidelity.

A model predicts what a plane costs at a quantiser step from the statistics of its 8 × 8 DCT, so that the first file
coded is within a few percent of the size; a second one, in which a few channels alone change, hits it. What was
searched, and in which order, follows from bytes and pictures only, never from threads or clocks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..container.layers import CodedChannel, CodedLayer
from ..container.reader import read_container
from ..container.writer import write_container
from ..errors import InputError
from ..gaussian.planes import Channel, LayerPlan, PlaneClass
from .adaptive import depth_fineness, with_depth_pictures
from .depth_step.blocks import DEAD_ZONE, SIDE, dct
from .encoder import MAX_GLOBAL_QP, SceneEncoder, is_flat
from .quantise import choose_code_map

SIZE_TOLERANCE = 0.03
"""A file of a target size is at most this share smaller where steps allow it, and never larger."""

PSNR_TOLERANCE = 0.2
"""A file of a target PSNR has at least that many dB, and at most this many more where steps allow it."""

_AIM = 1 - SIZE_TOLERANCE / 2
_ROUNDS = 8
_LARGEST_SHIFT = 3.0
"""Most that a fine step moves a channel's QP: beyond it, more channels are moved instead."""

_TRIALS, _OTHER_TRIALS, _PSNR_PLANS = 14, 6, 3
_SAME_STEPS = 1.5
"""Farther than this from the Q_g that plans are of, and not too often, new plans are made."""

_TOO_FINE, _FINE_ENOUGH = 0.15, 1.0
"""Steps of depth, in the finest that 12 bits have, between which one picture and two are both tried."""

_LEAST_STEP = 0.02
"""Of Q_g, within which no second file is coded."""

_DB_PER_QP = 0.6
"""Typical fall of the PSNR, for the first guess."""

_LEAST_APART = 0.1

_SAMPLED_BLOCKS = 1024
_BINS_PER_OCTAVE = 8
_LEAST_LEVEL = 0.6
"""Coefficients below this share of the step cost nothing."""

_TINY = 1e-30
_PLANS = 3
_SAME_PLAN = 1.0
"""A shift of Q_g within which the steps alone are changed, not what else follows from Q_g."""
_SHIFT_RESOLUTION = 1e-3

_BITS_PER_COEFFICIENT, _BITS_PER_OCTAVE, _BITS_PER_BLOCK = 3.0, 1.05, 0.9
"""Fitted to the four profiles on two scenes over 30 QPs, whose totals they predict to 5 %; to 15 % elsewhere."""


def encode_to_size(encoder: SceneEncoder, target: int) -> bytes:
    """The largest file found of at most `target` bytes: 97 % of it or more, unless the finest steps give less.

    Args:
        encoder: the scene.
        target: bytes, > 0.

    Raises:
        InputError: the coarsest steps give more; says how much.
    """
    plans, qp = _plan_for(encoder, target * _AIM)
    data = encoder.code(plans, qp)
    best = _better(b"", data, target)
    for _ in range(_ROUNDS):
        if _fits(data, target):
            return data
        plans, shift = _corrected(plans, data, target)
        qp = min(max(qp + shift, -MAX_GLOBAL_QP), MAX_GLOBAL_QP)
        data = encoder.code(plans, qp)
        best = _better(best, data, target)
    best = best or encoder.encode(MAX_GLOBAL_QP)
    if len(best) > target:
        message = f"{target} bytes; profile {encoder.profile.name} codes this scene to {len(best)} at least"
        raise InputError(message, where="target_size")
    return best


def encode_to_psnr(encoder: SceneEncoder, target: float, measure: Callable[[bytes], float]) -> bytes:
    """The smallest file found of at least `target` dB, mostly of at most 0.2 more.

    Whether depth is coded in one picture or in two changes dB by steps, so that near the border between them both are
    tried: asking for more dB hardly ever gives fewer bytes then.

    Args:
        encoder: the scene.
        target: dB.
        measure: the PSNR of a file.

    Raises:
        InputError: no file has as many; says the most that one has.
    """
    steps = _Steps(encoder)
    found = list(tries(steps.code, measure, target, target + PSNR_TOLERANCE, _DB_PER_QP))
    met = [file for file in found if file.score >= target]
    if not met:
        most = max(file.score for file in found)
        message = f"{target:g} dB; profile {encoder.profile.name} reaches {most:.2f} dB here at most"
        raise InputError(message, where="target_psnr")
    best = min(met, key=lambda file: len(file.data))
    pictures = _other_pictures(steps.plans(best.qp))
    if pictures is not None:
        code = _Steps(encoder, pictures).code
        others = tries(code, measure, target, target + PSNR_TOLERANCE, _DB_PER_QP, start=best.qp, count=_OTHER_TRIALS)
        met += [file for file in others if file.score >= target]
    return min(met, key=lambda file: len(file.data)).data


@dataclass(frozen=True)
class Try:
    """A file that a search coded.

    Attributes:
        qp: its Q_g.
        data: its bytes.
        score: what is searched by, which falls with Q_g.
    """

    qp: float
    data: bytes
    score: float


def tries(
    code: Callable[[float], bytes],
    score: Callable[[bytes], float],
    low: float,
    high: float,
    slope: float,
    *,
    start: float = 0.0,
    count: int = _TRIALS,
) -> Iterator[Try]:
    """Files on the way to a score from `low` to `high`; the last one has it, or there is nowhere left to look.

    Args:
        code: the file of a Q_g.
        score: of a file; falls with Q_g, by about `slope` at first.
        low, high: what is wanted.
        start: the first Q_g.
        count: files at most.
    """
    qp, aim, falls = start, (low + high) / 2, slope
    seen: list[tuple[float, float]] = []
    for _ in range(count):
        data = code(qp)
        found = score(data)
        yield Try(qp, data, found)
        if low <= found <= high:
            return
        # Where new plans made the curve jump, what contradicts the latest file is of the old ones.
        seen = [(q, s) for q, s in seen if (q - qp) * (s - found) <= 0]
        seen.append((qp, found))
        falls = _slope(seen, falls, slope)
        following = min(max(next_qp(seen, aim, falls), -MAX_GLOBAL_QP), MAX_GLOBAL_QP)
        if any(abs(following - qp) < _LEAST_STEP for qp, _ in seen):
            return
        qp = following


class _Steps:
    """Files of one scene at many Q_g, whose plans are made anew only where Q_g has moved.

    Once near, steps alone change: what else follows from Q_g (components kept, the SH degree) could jump.
    """

    def __init__(self, encoder: SceneEncoder, depth_pictures: int | None = None) -> None:
        self._encoder, self._pictures = encoder, depth_pictures
        self._plans: list[LayerPlan] = []
        self._planned, self._times = math.inf, 0

    def code(self, qp: float) -> bytes:
        """The file of Q_g = `qp`."""
        return self._encoder.code(self.plans(qp), qp)

    def plans(self, qp: float) -> list[LayerPlan]:
        """How that file's layers are coded."""
        if abs(qp - self._planned) > _SAME_STEPS and self._times < _PSNR_PLANS:
            plans = self._encoder.plan(qp)
            if self._pictures is not None:
                plans = [with_depth_pictures(plan, self._pictures) for plan in plans]
            self._plans, self._planned, self._times = plans, qp, self._times + 1
        return [_scaled(plan, qp - self._planned) for plan in self._plans]


def _other_pictures(plans: Sequence[LayerPlan]) -> int | None:
    """How many pictures of depth are worth a try in place of those planned; None where these are clearly right."""
    for plan in plans:
        fineness = depth_fineness(plan)
        if fineness is not None and _TOO_FINE < fineness < _FINE_ENOUGH:
            return 1 if plan.refine_depth is not None else 2
    return None


def _slope(seen: Sequence[tuple[float, float]], before: float, typical: float) -> float:
    """Score lost per Q_g: between the two latest files, if they are far enough apart to tell, else what it was."""
    if len(seen) < 2 or abs(seen[-1][0] - seen[-2][0]) < _LEAST_APART:
        return before
    found = (seen[-2][1] - seen[-1][1]) / (seen[-1][0] - seen[-2][0])
    return min(max(found, typical / 2), typical * 2)


def next_qp(seen: Sequence[tuple[float, float]], aim: float, slope: float) -> float:
    """Where to look next, of a score that falls with Q_g: between the nearest files on either side, or along the slope
    where all lie on one.

    Args:
        seen: Q_g and score of files, latest last.
        aim: score wanted.
        slope: lost per Q_g.
    """
    above = [(qp, score) for qp, score in seen if score >= aim]
    below = [(qp, score) for qp, score in seen if score < aim]
    if not above or not below:
        # Ever farther, so that a curve that levels off is soon followed to its end.
        return seen[-1][0] + (seen[-1][1] - aim) / slope * 2 ** max(len(seen) - 2, 0)
    low, high = max(above), min(below)
    share = (low[1] - aim) / (low[1] - high[1])
    # Away from the ends, so that a curve that is no line still shortens the bracket before long.
    return low[0] + min(max(share, 0.1), 0.9) * (high[0] - low[0])


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


def _scaled(plan: LayerPlan, shift: float | Sequence[float]) -> LayerPlan:
    """The plan with its steps multiplied by 2^(shift/6), one shift for all channels or one for each."""
    shifts = np.broadcast_to(np.asarray(shift, np.float64), (len(plan.channels),))
    channels = [replace(c, step=c.step * 2 ** (float(s) / 6)) for c, s in zip(plan.channels, shifts, strict=True)]
    fine = plan.refine_depth
    if fine is not None:
        depth = next(i for i, c in enumerate(plan.channels) if c.plane_class == PlaneClass.DEPTH)
        fine *= 2 ** (float(shifts[depth]) / 6)
    return replace(plan, channels=tuple(channels), refine_depth=fine)


def _plan_for(encoder: SceneEncoder, size: float) -> tuple[list[LayerPlan], float]:
    """Plans whose file the model expects to have `size` bytes, and their Q_g."""
    qp = 0.0
    for _ in range(_PLANS):
        plans = encoder.plan(qp)
        models = _models(plans)
        wanted = size - _metadata_bytes(encoder, plans)
        shift = _solve(partial(_excess, models, wanted), -MAX_GLOBAL_QP - qp, MAX_GLOBAL_QP - qp)
        qp += shift
        if abs(shift) <= _SAME_PLAN:
            break
    else:
        return encoder.plan(qp), qp
    return [_scaled(plan, shift) for plan in plans], qp


def _excess(models: Sequence[ChannelModel], wanted: float, shift: float) -> float:
    return sum(model.bytes_at(shift) for model in models) - wanted


def _metadata_bytes(encoder: SceneEncoder, plans: Sequence[LayerPlan]) -> int:
    """About what a file of such plans has besides its pictures."""
    layers = []
    for layer, plan in zip(encoder.gaussians.layers, plans, strict=True):
        one_each = (b"\0",) * len(layer.cameras)
        channels = tuple(CodedChannel(c.plane_class, c.target, 0, 0.0, 0.0, one_each) for c in plan.channels)
        height, width = layer.opacities.shape[1:]
        layers.append(CodedLayer(height, width, layer.degree, plan, channels, b"", layer.cameras))
    scene = encoder.gaussians
    return len(write_container(layers, scene.cameras, scene.origin, "", 0.0, notes=scene.notes))


def _corrected(plans: Sequence[LayerPlan], data: bytes, target: int) -> tuple[list[LayerPlan], float]:
    """Plans whose file should have the aimed-at size, given the file of `plans`, and the shift common to all channels.

    As few channels as possible are moved, the largest first, each by at most `_LARGEST_SHIFT`.
    """
    found = _bytes_by_channel(plans, data)
    wanted = target * _AIM - (len(data) - sum(found))
    moved, shift = _fewest_moved(_models(plans), found, wanted)
    shifts = iter([shift if i in moved else 0.0 for i in range(len(found))])
    scaled = [_scaled(plan, [next(shifts) for _ in plan.channels]) for plan in plans]
    return scaled, shift if len(moved) == len(found) else 0.0


def _fewest_moved(models: Sequence[ChannelModel], found: Sequence[int], wanted: float) -> tuple[frozenset[int], float]:
    """Which channels to shift, and by how much, so that pictures of `found` bytes come to `wanted` in all."""
    at_zero = [model.bytes_at(0) for model in models]

    def excess(shift: float, moved: Sequence[int]) -> float:
        change = (found[i] * (models[i].bytes_at(shift) / at_zero[i] - 1) for i in moved if at_zero[i] > 0)
        return sum(found) + sum(change) - wanted

    order = sorted(range(len(models)), key=lambda i: (-found[i], i))
    reach = math.copysign(_LARGEST_SHIFT, sum(found) - wanted)
    for count in range(1, len(order) + 1):
        if excess(reach, order[:count]) * reach <= 0:
            moved = order[:count]
            return frozenset(moved), _solve(partial(excess, moved=moved), min(0.0, reach), max(0.0, reach))
    most = 2.0 * MAX_GLOBAL_QP
    return frozenset(order), _solve(partial(excess, moved=order), -most, most)


def _bytes_by_channel(plans: Sequence[LayerPlan], data: bytes) -> list[int]:
    """Bytes of the pictures of every channel of the plans, a depth's two records together."""
    totals: dict[tuple[int, int, int], int] = {}
    for index, channels in enumerate(read_container(data).pictures.channels):
        for record in channels:
            key = index, record.plane_class, record.target
            totals[key] = totals.get(key, 0) + sum(stream.length for stream in record.streams)
    return [totals[i, c.plane_class, c.target] for i, plan in enumerate(plans) for c in plan.channels]


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


def _fits(data: bytes, target: int) -> bool:
    return (1 - SIZE_TOLERANCE) * target <= len(data) <= target


def _better(best: bytes, data: bytes, target: int) -> bytes:
    """The larger one of those that are within the target."""
    return data if len(best) < len(data) <= target else best
