"""The modes there are, by name."""

from __future__ import annotations

from .gaussians import GAUSSIANS
from .hybrid import HYBRID
from .lossless import LOSSLESS
from .mode import Mode
from .photos import PHOTOS

MODES: dict[str, Mode] = {mode.name: mode for mode in (GAUSSIANS, PHOTOS, HYBRID, LOSSLESS)}
