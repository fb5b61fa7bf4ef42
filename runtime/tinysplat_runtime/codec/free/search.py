"""The file of a wanted size, or of a wanted fidelity: Q_g is tried until one fits."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from ...errors import InputError
from ..profiles import Profile
from ..rate import PSNR_TOLERANCE, SIZE_TOLERANCE, tries

_OCTAVES_PER_QP, _DB_PER_QP = 0.1, 0.95
"""Typical falls, for the first guesses."""


class Coder(Protocol):
    """What codes the same Gaussians at any Q_g."""

    profile: Profile

    def code(self, qp: float) -> bytes:
        """The file."""
        ...


def code_to_size(encoder: Coder, target: int) -> bytes:
    """The largest file found of at most `target` bytes; InputError where there is none."""
    low, high = math.log2((1 - SIZE_TOLERANCE) * target), math.log2(target)
    files = [file.data for file in tries(encoder.code, lambda data: math.log2(len(data)), low, high, _OCTAVES_PER_QP)]
    within = [data for data in files if len(data) <= target]
    if within:
        return max(within, key=len)
    message = f"{target} bytes; profile {encoder.profile.name} codes this scene to {min(map(len, files))} at least"
    raise InputError(message, where="target_size")


def code_to_psnr(encoder: Coder, target: float, measure: Callable[[bytes], float]) -> bytes:
    """The smallest file found of at least `target` dB; InputError where there is none."""
    found = list(tries(encoder.code, measure, target, target + PSNR_TOLERANCE, _DB_PER_QP))
    met = [file.data for file in found if file.score >= target]
    if met:
        return min(met, key=len)
    most = max(file.score for file in found)
    message = f"{target:g} dB; profile {encoder.profile.name} reaches {most:.2f} dB here at most"
    raise InputError(message, where="target_psnr")
