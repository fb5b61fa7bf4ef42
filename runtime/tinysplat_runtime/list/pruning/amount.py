"""How much of a scene is left out for other formats: a share, or as much as a quality or a number bears."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...errors import InputError


@dataclass(frozen=True)
class Amount:
    """One of three.

    Attributes:
        share: of the Gaussians that is left out, 0 to 1 exclusive.
        psnr: dB of pictures of what is left against those of all, at least.
        count: Gaussians that are left, at most.
    """

    share: float | None = None
    psnr: float | None = None
    count: int | None = None

    @classmethod
    def of(cls, text: str) -> Amount:
        """`0.5`, `45dB` or `200000`.

        Raises:
            InputError: none of these.
        """
        number, is_psnr = (text[:-2], True) if text.lower().endswith("db") else (text, False)
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if is_psnr and 10 <= value <= 100:
            return cls(psnr=value)
        if not is_psnr and 0 < value < 1:
            return cls(share=value)
        if not is_psnr and math.isfinite(value) and value >= 1 and value == int(value):
            return cls(count=int(value))
        raise InputError(f"'{text}', expected a share such as 0.5, a quality such as 45dB, or a number", where="prune")
