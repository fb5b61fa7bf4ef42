"""Gaussians that are left, moved, scaled, faded and coloured until pictures are again what they were with all of them.

`list.training.free` gives the gradient of a picture's error (L1), which Adam follows, a view at a time.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ...gaussian.gaussians import Gaussians
from ...render.gradient import Target
from ...render.prepare import ALPHA_MIN
from ...scene.cameras import Camera
from ...system.told import NOBODY, Told
from ..training.descent import LIMITS, Descent, Pace, units
from ..training.free import FreeGaussians
from ..training.kernels_free import LOGIT

ROUNDS = 4
"""Steps for each view."""

PACE = Pace(move=0.05, log_scale=0.01, logit=0.03, sh=0.004, last=0.05)

_LEAST_LOGIT = math.log(ALPHA_MIN / (1 - ALPHA_MIN)) + 1e-4  # what shows nowhere could not come back
_LIMITS = (*LIMITS[:LOGIT], (_LEAST_LOGIT, LIMITS[LOGIT][1]))


def corrected(
    gaussians: Gaussians, cameras: Sequence[Camera], wanted: Sequence[NDArray], run_jobs: Callable, told: Told = NOBODY
) -> Gaussians:
    """Gaussians whose pictures are nearer to those wanted.

    Args:
        gaussians: (n,), of opacity 1/255 or more, as they stay.
        cameras: of the pictures.
        wanted: by camera, (H, W, 3) float32 as 3DGS defines drawing, before black; what is above 1 counts as 1.
        run_jobs: maps a function over a list, on any number of threads; the result is the same on all.
        told: is told of each step.

    Returns:
        (n,) Gaussians of the same quats and SH above degree 0.
    """
    field = FreeGaussians(gaussians, units(gaussians, cameras), run_jobs)
    targets = [Target(camera, np.minimum(one, np.float32(1))) for camera, one in zip(cameras, wanted, strict=True)]
    descent, order = Descent(field, PACE, run_jobs, _LIMITS), np.random.default_rng(0)
    turns = np.concatenate([order.permutation(len(targets)) for _ in range(ROUNDS)])
    for number in told.progress("correcting", turns.tolist()):
        descent.step(targets[number], descent.count / len(turns))
    return field.gaussians()
