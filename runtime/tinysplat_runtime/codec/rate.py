"""Rate control: the file of a wanted size, or of a wanted fidelity.

A model predicts what a plane costs at a quantiser step from the statistics of its 8 × 8 DCT, so that the first file
coded is within a few percent of the size; a second one, in which a few channels alone change, hits it. What was
searched, and in which order, follows from bytes and pictures only, never from threads or clocks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..container.reader import read_container
from ..container.writer import CodedChannel, CodedLayer, write_container
from ..errors import InputError
from ..gaussian.planes import Channel, LayerPlan, PlaneClass
from .depth_step.blocks import DEAD_ZONE, SIDE, dct
from .encoder import MAX_GLOBAL_QP, SceneEncoder, is_flat
from .quantise import choose_code_map

SIZE_TOLERANCE = 0.03
"""A file of a target size is at most this share smaller, and never larger."""

PSNR_TOLERANCE = 0.2
"""A file of a target PSNR has at least that many dB, and at most this many more."""

_AIM = 1 - SIZE_TOLERANCE / 2
_ROUNDS = 8
_LARGEST_SHIFT = 3.0
"""Most that a fine step moves a channel's QP: beyond it, more channels are moved instead."""

_PSNR_TRIALS, _PSNR_PLANS = 14, 3
_SAME_STEPS = 1.5
"""Farther than this from the Q_g that plans are of, in one of the first trials, new plans are made."""

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
    """A file of at most `target` bytes and at least 97 % of it.

    Args:
        encoder: the scene.
        target: bytes, > 0.

    Raises:
        InputError: no such file exists; says the nearest size that does.
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
    if _fits(best, target):
        return best
    raise _unreachable(encoder, target, best)


def encode_to_psnr(encoder: SceneEncoder, target: float, measure: Callable[[bytes], float]) -> bytes:
    """A file of at least `target` dB and at most 0.2 more.

    Args:
        encoder: the scene.
        target: dB.
        measure: the PSNR of a file.

    Raises:
        InputError: no such file exists; says the nearest PSNR that does.
    """
    qp, aim, slope = 0.0, target + PSNR_TOLERANCE / 2, _DB_PER_QP
    plans, planned = encoder.plan(qp), qp
    seen: list[tuple[float, float]] = []  # Q_g and dB of files of the present plans, latest last
    nearest = math.inf
    for trial in range(_PSNR_TRIALS):
        data = encoder.code([_scaled(plan, qp - planned) for plan in plans], qp)
        found = measure(data)
        if target <= found <= target + PSNR_TOLERANCE:
            return data
        nearest = min(nearest, found, key=lambda db: abs(db - target))
        seen.append((qp, found))
        slope = _slope(seen, slope)
        following = min(max(next_qp(seen, aim, slope), -MAX_GLOBAL_QP), MAX_GLOBAL_QP)
        if following == qp:
            break
        # Once near, steps alone change: what else follows from Q_g (components kept, depth layers) could jump.
        if abs(following - planned) > _SAME_STEPS and trial < _PSNR_PLANS:
            plans, planned, seen = encoder.plan(following), following, []
        qp = following
    message = f"{target:g} dB; profile {encoder.profile.name} reaches {nearest:.2f} dB here as the nearest"
    raise InputError(message, where="target_psnr")


def _slope(seen: Sequence[tuple[float, float]], before: float) -> float:
    """dB lost per Q_g: between the two latest files, if they are far enough apart to tell, else what it was before."""
    if len(seen) < 2 or abs(seen[-1][0] - seen[-2][0]) < _LEAST_APART:
        return before
    found = (seen[-2][1] - seen[-1][1]) / (seen[-1][0] - seen[-2][0])
    return min(max(found, _DB_PER_QP / 2), _DB_PER_QP * 2)


def next_qp(seen: Sequence[tuple[float, float]], aim: float, slope: float) -> float:
    """Where to look next, of a score that falls with Q_g: between the nearest files on either side, or along the slope
    where all lie on one.

    Args:
        seen: Q_g and score of files, latest last.
        aim: score wanted.
        slope: lost per Q_g.
    """
    above = [(qp, db) for qp, db in seen if db >= aim]
    below = [(qp, db) for qp, db in seen if db < aim]
    if not above or not below:
        return seen[-1][0] + (seen[-1][1] - aim) / slope
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
    for index, layer in enumerate(read_container(data).layers):
        for record in layer.channels:
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


def _unreachable(encoder: SceneEncoder, target: int, best: bytes) -> InputError:
    smallest, largest = (len(encoder.code(encoder.plan(qp), qp)) for qp in (MAX_GLOBAL_QP, -MAX_GLOBAL_QP))
    name = encoder.profile.name
    if target < smallest:
        message = f"{target} bytes; profile {name} codes this scene to {smallest} at least"
    elif largest < target:
        message = f"{target} bytes; profile {name} codes this scene to {largest} at most"
    else:
        message = f"{target} bytes; profile {name} has {len(best)} here as the nearest below it"
    return InputError(message, where="target_size")
