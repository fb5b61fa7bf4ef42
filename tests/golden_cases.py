"""The golden cases: integer planes for the encoder, tiny scenes for whole files; test and regenerator read them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scenes import free_in_tiers, make_free_gaussians, make_smooth_gaussians

from tinysplat_runtime import compress
from tinysplat_runtime.gaussian.gaussians import Gaussians

DATA = Path(__file__).parent / "golden" / "data"


def _all(gaussians: Gaussians, profile: str, qp: float) -> bytes:
    return compress(gaussians, profile, qp, keep_all=True)


@dataclass(frozen=True)
class FileCase:
    """A scene, and how it is coded."""

    name: str
    make: Callable[[], Gaussians]
    profile: str
    qp: float
    code: Callable[[Gaussians, str, float], bytes] = _all


def _view_dependent() -> Gaussians:
    """Two layers whose views disagree about colours, so that SH coefficients stay."""
    scene = make_smooth_gaussians(2, 24, 40, 1, seed=5, layers=2)
    return replace(scene, sh=scene.sh * np.array([1, 8, 8, 8], np.float32)[:, None])


def _in_tiers(gaussians: Gaussians, _: str, qp: float) -> bytes:
    return free_in_tiers(gaussians, qp)


FILES = [
    FileCase("tiny_paper", lambda: make_smooth_gaussians(1, 5, 7, 0, seed=3), "paper", 0),
    FileCase("degree2_paper", lambda: make_smooth_gaussians(2, 24, 40, 2, seed=4), "paper", 3),
    FileCase("degree1_balanced", _view_dependent, "balanced", 0),
    FileCase("views_balanced", lambda: make_smooth_gaussians(8, 12, 16, 1, seed=7, layers=2), "balanced", 0),
    FileCase("tiers_balanced", lambda: make_free_gaussians(400, 1, np.random.default_rng(8)), "balanced", 6, _in_tiers),
    FileCase("free_balanced", lambda: make_free_gaussians(300, 1, np.random.default_rng(6)), "balanced", 0),
]


def golden_planes() -> dict[str, tuple[NDArray, int]]:
    """Integer planes and their QP: made of integers alone, so that every machine has the same."""
    v, u = np.mgrid[:40, :56]
    ramp = (u * 61 + v * 17) % 4096
    steps = np.where((u // 9 + v // 7) % 2 == 0, 700, 3100)
    hashed = (u * 2654435761 + v * 40503) % 977 + 1500
    return {
        "ramp": (ramp.astype(np.uint16), 8),
        "steps": (steps.astype(np.uint16), 20),
        "noise": (hashed.astype(np.uint16), 24),
    }
