"""The file of a wanted size, or of a wanted fidelity: Q_g is tried until one fits."""

from __future__ import annotations

import math
from collections.abc import Callable

from ...errors import InputError
from ..encoder import MAX_GLOBAL_QP
from ..rate import PSNR_TOLERANCE, SIZE_TOLERANCE, next_qp
from .encoder import FreeEncoder

_TRIALS = 14
_OCTAVES_PER_QP, _DB_PER_QP = 0.1, 0.95
"""Typical falls, for the first guesses."""


def code_to_size(encoder: FreeEncoder, target: int) -> bytes:
    """A file of at most `target` bytes and at least 97 % of it; InputError where there is none."""
    low, high = math.log2((1 - SIZE_TOLERANCE) * target), math.log2(target)
    data, is_hit = _seek(encoder.code, lambda data: math.log2(len(data)), low, high, _OCTAVES_PER_QP)
    if is_hit:
        return data
    message = f"{target} bytes; profile {encoder.profile.name} has {len(data)} here as the nearest"
    raise InputError(message, where="target_size")


def code_to_psnr(encoder: FreeEncoder, target: float, measure: Callable[[bytes], float]) -> bytes:
    """A file of at least `target` dB and at most 0.2 more; InputError where there is none."""
    data, is_hit = _seek(encoder.code, measure, target, target + PSNR_TOLERANCE, _DB_PER_QP)
    if is_hit:
        return data
    message = f"{target:g} dB; profile {encoder.profile.name} reaches {measure(data):.2f} dB here as the nearest"
    raise InputError(message, where="target_psnr")


def _seek(
    code: Callable[[float], bytes], score: Callable[[bytes], float], low: float, high: float, slope: float
) -> tuple[bytes, bool]:
    """A file whose score, which falls with Q_g by about `slope`, lies from low to high; else the nearest one tried."""
    aim, qp = (low + high) / 2, 0.0
    seen: list[tuple[float, float]] = []
    best, nearest = b"", math.inf
    for _ in range(_TRIALS):
        data = code(qp)
        found = score(data)
        if low <= found <= high:
            return data, True
        if abs(found - aim) < nearest:
            best, nearest = data, abs(found - aim)
        seen.append((qp, found))
        following = min(max(next_qp(seen, aim, slope), -MAX_GLOBAL_QP), MAX_GLOBAL_QP)
        if following == qp:
            break
        qp = following
    return best, False
