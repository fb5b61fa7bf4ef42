"""The file of a wanted size, or of a wanted fidelity: Q_g is tried until one fits.

What is tried, and in which order, follows from bytes and pictures only, never from threads or clocks.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from ..errors import InputError
from .job import MAX_GLOBAL_QP
from .profiles import Profile

SIZE_TOLERANCE = 0.03
"""A file of a target size is at most this share smaller where steps allow it, and never larger."""

PSNR_TOLERANCE = 0.2
"""A file of a target PSNR has at least that many dB, and at most this many more where steps allow it."""

_TRIALS, _OTHER_TRIALS, _SETTLINGS = 14, 6, 4
_NEAR_DB = 0.8
"""Above a target, from where coarser steps alone go the rest of the way; finer ones do not give back what was lost."""

_LEAST_STEP = 0.02
"""Of Q_g, within which no second file is coded."""

_LEAST_APART = 0.1

Made = TypeVar("Made")


class Coder(ABC):
    """Codes the same Gaussians at any Q_g.

    Attributes:
        profile: how planes are coded.
        db_per_qp: typical fall of the PSNR, for the first guesses.
        near: octaves of bytes below and above a target from where steps of what is `settled` alone do about as well the
            rest of the way; None where nothing takes long.
    """

    profile: Profile
    db_per_qp = 0.95
    near: tuple[float, float] | None = None

    @abstractmethod
    def code(self, qp: float) -> bytes:
        """The file at Q_g; InputError beyond ±60."""

    def expect(self, size: float) -> tuple[float, float]:
        """Q_g at which to look first for a file of `size` bytes, and about how many octaves its size falls by Q_g."""
        return 0.0, 0.1

    def settled(self, qp: float) -> Coder:
        """What has decided what takes long as this Q_g asks for, and codes about as well at others near it."""
        return self

    def other(self, qp: float) -> Coder | None:
        """What else might code better about this Q_g, if anything."""
        return None


class Once(Coder):
    """Codes in one way, whatever Q_g: what `make` makes."""

    def __init__(self, profile: Profile, make: Callable[[], bytes]) -> None:
        self.profile, self._make = profile, make

    def code(self, qp: float) -> bytes:
        """The file."""
        return self._make()


def code_to_size(coder: Coder, target: int) -> bytes:
    """The largest file found of at most `target` bytes: 97 % of it or more, unless the finest steps give less.

    Raises:
        InputError: the coarsest steps give more; says how much.
    """
    low, high = math.log2((1 - SIZE_TOLERANCE) * target), math.log2(target)
    aim, (below, above) = (1 - SIZE_TOLERANCE / 2) * target, coder.near or (0.0, 0.0)

    def slope(coder: Coder) -> float:
        return coder.expect(aim)[1]

    near = low - below, high + above
    tried = _files(coder, lambda data: math.log2(len(data)), (low, high), near, slope, coder.expect(aim)[0])
    files = [file.data for file in tried]
    within = [data for data in files if len(data) <= target]
    if within:
        return max(within, key=len)
    message = f"{target} bytes; profile {coder.profile.name} codes this scene to {min(map(len, files))} at least"
    raise InputError(message, where="target_size")


def code_to_psnr(coder: Coder, target: float, measure: Callable[[bytes], float]) -> bytes:
    """The smallest file found of at least `target` dB, mostly of at most 0.2 more; `measure` is the PSNR of a file.

    Raises:
        InputError: no file has as many; says the most that one has.
    """
    wanted, near = (target, target + PSNR_TOLERANCE), (target, target + _NEAR_DB)
    files = list(_files(coder, measure, wanted, near, lambda coder: coder.db_per_qp))
    met = [file for file in files if file.score >= target]
    if not met:
        most = max(file.score for file in files)
        message = f"{target:g} dB; profile {coder.profile.name} reaches {most:.2f} dB here at most"
        raise InputError(message, where="target_psnr")
    qp = min(met, key=lambda file: len(file.data)).qp
    other = coder.other(qp)
    if other is not None:
        others = tries(other.code, measure, *wanted, coder.db_per_qp, start=qp, count=_OTHER_TRIALS)
        met += [file for file in others if file.score >= target]
    return min(met, key=lambda file: len(file.data)).data


def _files(
    coder: Coder,
    score: Callable[[bytes], float],
    wanted: tuple[float, float],
    near: tuple[float, float],
    slope: Callable[[Coder], float],
    start: float = 0.0,
) -> Iterator[Try[bytes]]:
    """Files on the way to a score that is wanted, as `tries` makes them; a coder that settles something does so on the
    way to a score that is `near`.
    """
    if coder.near is None:
        yield from tries(coder.code, score, *wanted, slope(coder), start=start)
        return

    def settle(qp: float) -> tuple[Coder, bytes]:
        settled = coder.settled(qp)
        return settled, settled.code(qp)

    made: list[Try[tuple[Coder, bytes]]] = []
    for one in tries(settle, lambda made: score(made[1]), *near, slope(coder), start=start):
        made.append(one)
        if len(made) >= _SETTLINGS and any(one.score >= near[0] for one in made):
            break
    first = max((one for one in made if one.score >= near[0]), key=lambda one: one.qp, default=made[-1])
    settled, data = first.data

    def code(qp: float) -> bytes:
        return data if qp == first.qp else settled.code(qp)

    yield from tries(code, score, *wanted, slope(settled), start=first.qp)


@dataclass(frozen=True)
class Try(Generic[Made]):
    """What a search made.

    Attributes:
        qp: at which Q_g, or whatever else is searched over.
        data: what was made.
        score: what is searched by, which falls with Q_g.
    """

    qp: float
    data: Made
    score: float


def tries(
    make: Callable[[float], Made],
    score: Callable[[Made], float],
    low: float,
    high: float,
    slope: float,
    *,
    start: float = 0.0,
    count: int = _TRIALS,
) -> Iterator[Try[Made]]:
    """Files on the way to a score from `low` to `high`; the last one has it, or there is nowhere left to look.

    Args:
        make: a file at a Q_g within ±60, or anything else that depends on one number so.
        score: of a file; falls with Q_g, by about `slope` at first.
        low, high: what is wanted.
        slope: see `score`.
        start: the first Q_g.
        count: files at most.
    """
    qp, aim, falls = start, (low + high) / 2, slope
    seen: list[tuple[float, float]] = []
    for _ in range(count):
        data = make(qp)
        reached = score(data)
        yield Try(qp, data, reached)
        if low <= reached <= high:
            return
        # Where new plans made the curve jump, what contradicts the latest file is of the old ones.
        seen = [(q, s) for q, s in seen if (q - qp) * (s - reached) <= 0]
        seen.append((qp, reached))
        falls = _slope(seen, falls, slope)
        following = min(max(_next_qp(seen, aim, falls), -MAX_GLOBAL_QP), MAX_GLOBAL_QP)
        if any(abs(following - qp) < _LEAST_STEP for qp, _ in seen):
            return
        qp = following


def _slope(seen: Sequence[tuple[float, float]], before: float, typical: float) -> float:
    """Score lost per Q_g: between the two latest files, if they are far enough apart to tell, else what it was."""
    if len(seen) < 2 or abs(seen[-1][0] - seen[-2][0]) < _LEAST_APART:
        return before
    lost = (seen[-2][1] - seen[-1][1]) / (seen[-1][0] - seen[-2][0])
    return min(max(lost, typical / 2), typical * 2)


def _next_qp(seen: Sequence[tuple[float, float]], aim: float, slope: float) -> float:
    """Where to look next, of a score that falls with Q_g: between the nearest files on either side, or along the slope
    where all lie on one. `seen` are Q_g and score of files, latest last; `slope` is lost per Q_g.
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
