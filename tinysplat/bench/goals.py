"""The project's goals for two cores without a GPU, each held against what a run found.

Ratios are taken of CPU seconds, which neighbours on a shared machine disturb least; a goal whose rows were not measured
is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE

from .timing import Row
from .views import megabytes, percent, seconds

EQUAL_DB = (38.0, 39.0, 40.0, 41.0)
"""dB against the raw render at which sizes are compared."""

Value = Callable[[Sequence[Row]], float | None]


@dataclass(frozen=True)
class Goal:
    """A bound that a figure should stay below.

    Attributes:
        name: what is bounded.
        bound: at most.
        write: how both are written.
        value: finds the figure in a run's rows; None where it was not measured.
    """

    name: str
    bound: float
    write: Callable[[float], str]
    value: Value


def _first(rows: Sequence[Row], stage: str, variant: str, case: str = "") -> Row | None:
    for row in rows:
        if row.stage == stage and row.variant == variant and case in row.case and row.seconds is not None:
            return row
    return None


def _decode_ratio(rows: Sequence[Row]) -> float | None:
    row = _first(rows, "decode", f"{DEFAULT_PROFILE} qp 0, 1 thread", "2×256×256")
    return row.cpu_ratio if row else None


def _encode_ratio(rows: Sequence[Row]) -> float | None:
    row = _first(rows, "encode", f"{DEFAULT_PROFILE} qp 0", "2×256×256")
    return row.cpu_ratio if row else None


def _wall(stage: str, variant: str, case: str = "") -> Value:
    def value(rows: Sequence[Row]) -> float | None:
        row = _first(rows, stage, variant, case)
        return row.seconds.median if row and row.seconds else None

    return value


def _decode_peak(rows: Sequence[Row]) -> float | None:
    row = _first(rows, "growth decode", "2×256×256", "pixels")
    return float(row.peak_bytes) if row and row.peak_bytes else None


def size_at_equal_db(rows: Sequence[Row]) -> float | None:
    """Mean over `EQUAL_DB` of the default profile's bytes by `paper`'s, log bytes interpolated over dB."""
    encodes = [row for row in rows if row.stage == "encode"]
    curves = {}
    for profile in ("paper", DEFAULT_PROFILE):
        points = [
            (row.figures["psnr_decoded_raw"], math.log(row.figures["bytes"]))
            for row in encodes
            if row.case == encodes[0].case and row.settings["profile"] == profile
        ]
        curves[profile] = sorted(points)
    ratios = []
    for level in EQUAL_DB:
        at = [_interpolated(curve, level) for curve in curves.values()]
        if at[0] is not None and at[1] is not None:
            ratios.append(math.exp(at[1] - at[0]))
    return float(np.mean(ratios)) if ratios else None


def _interpolated(curve: Sequence[tuple[float, float]], level: float) -> float | None:
    if len(curve) < 2 or not curve[0][0] <= level <= curve[-1][0]:
        return None
    return float(np.interp(level, [db for db, _ in curve], [size for _, size in curve]))


def _times(value: float) -> str:
    return f"{value:.2f} ×"


GOALS: tuple[Goal, ...] = (
    Goal("decoding 2×256×256, by libavcodec alone on the same streams (1 thread, CPU)", 1.5, _times, _decode_ratio),
    Goal("encoding 2×256×256, by libx265 alone on the same planes (CPU)", 1.2, _times, _encode_ratio),
    Goal("encoding 2×256×256", 1.0, seconds, _wall("encode", f"{DEFAULT_PROFILE} qp 0", "2×256×256")),
    Goal(
        "a frame of 131,072 Gaussians at 256×256, 1 thread",
        0.05,
        seconds,
        _wall("rasteriser", "numpy, 1 thread", "131,072 Gaussians at 256×256"),
    ),
    Goal(
        "the same compiled, 2 threads",
        1 / 60,
        seconds,
        _wall("rasteriser", "compiled, 2 threads", "131,072 Gaussians at 256×256"),
    ),
    Goal("size at equal dB to raw (38 to 41), by `paper`'s", 0.45, percent, size_at_equal_db),
    Goal("`tinysplat decode` from a cold start", 0.6, seconds, _wall("cold start", "tinysplat decode")),
    Goal("peak memory of decoding 2×256×256", 250e6, megabytes, _decode_peak),
)


def goal_lines(rows: Sequence[Row]) -> Iterator[str]:
    """The table of goals that were measured; nothing where none was."""
    found = [(goal, goal.value(rows)) for goal in GOALS]
    measured = [(goal, value) for goal, value in found if value is not None]
    if not measured:
        return
    yield from ("", "## Goals", "", "For two cores to ourselves, without a GPU.", "")
    yield from ("| | found | at most | |", "|---|--:|--:|---|")
    for goal, value in measured:
        verdict = "met" if value <= goal.bound else "not met"
        yield f"| {goal.name} | {goal.write(value)} | {goal.write(goal.bound)} | {verdict} |"
