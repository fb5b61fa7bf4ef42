"""The project's goals for two cores without a GPU, each held against what a run found.

Ratios are taken of CPU seconds, which neighbours on a shared machine disturb least; a goal whose rows were not measured
is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE

from ..curves import bytes_at
from ..rows import Row
from .tables import duration, format_table, megabytes, percent

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


def cost(study: str, way: str, name: str = "seconds", subject: str = "") -> Value:
    """A cost of the first row of a study whose way begins, and whose subject holds, so."""

    def value(rows: Sequence[Row]) -> float | None:
        found = (row.costs[name] for row in rows if row.study == study and row.way.startswith(way)
                 and subject in row.subject and name in row.costs)  # fmt: skip
        return next(found, None)

    return value


def size_at_equal_db(rows: Sequence[Row]) -> float | None:
    """Geometric mean over `EQUAL_DB` of the default profile's bytes by `paper`'s, on the first subject."""
    encodes = [row for row in rows if row.study == "encode"]
    curves = [
        [(row.figures["bytes"], row.figures["psnr_decoded_raw"]) for row in encodes
         if row.subject == encodes[0].subject and row.setting["profile"] == profile]
        for profile in ("paper", DEFAULT_PROFILE)
    ]  # fmt: skip
    pairs = [[bytes_at(curve, db) for curve in curves] for db in EQUAL_DB]
    ratios = [ours / paper for paper, ours in pairs if paper is not None and ours is not None]
    return math.exp(float(np.mean(np.log(ratios)))) if ratios else None


def _times(value: float) -> str:
    return f"{value:.2f} ×"


_CODED, _DRAWN = "2×256×256", "131,072 Gaussians at 256×256"

GOALS: tuple[Goal, ...] = (
    Goal("decoding 2×256×256, by libavcodec alone on the same streams (1 thread, CPU)", 1.5, _times,
         cost("decode", f"{DEFAULT_PROFILE} qp 0, 1 thread", "cpu_ratio", _CODED)),
    Goal("encoding 2×256×256, by libx265 alone on the same planes (CPU)", 1.2, _times,
         cost("encode", f"{DEFAULT_PROFILE} qp 0", "cpu_ratio", _CODED)),
    Goal("encoding 2×256×256", 1.0, duration, cost("encode", f"{DEFAULT_PROFILE} qp 0", subject=_CODED)),
    Goal("a frame of 131,072 Gaussians at 256×256, 1 thread", 0.05, duration,
         cost("rasteriser", "numpy, 1 thread", subject=_DRAWN)),
    Goal("the same compiled, 2 threads", 1 / 60, duration,
         cost("rasteriser", "compiled, 2 threads", subject=_DRAWN)),
    Goal("size at equal dB to raw (38 to 41), by `paper`'s", 0.45, percent, size_at_equal_db),
    Goal("`tinysplat decode` from a cold start", 0.6, duration, cost("cold start", "tinysplat decode")),
    Goal("peak memory of decoding 2×256×256", 250e6, megabytes,
         cost("decode", f"{DEFAULT_PROFILE} qp 0, 1 thread", "peak_bytes", _CODED)),
)  # fmt: skip


def goal_table(rows: Sequence[Row]) -> str:
    """Goals that were measured; empty where none was."""
    found = [(goal, goal.value(rows)) for goal in GOALS]
    lines = [
        [goal.name, goal.write(value), goal.write(goal.bound), "met" if value <= goal.bound else "not met"]
        for goal, value in found
        if value is not None
    ]
    return format_table(["", "found", "at most", ""], lines) if lines else ""
