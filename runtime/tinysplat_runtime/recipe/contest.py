"""A capture as views or as one list: photos that neither has seen say which shows them better.

A few photos are held back, with the Gaussians of their pixels; both are made of the others, a list in fewer steps than
one that is kept, and then show them. Each photo is compared with a picture as bright as it is, so that how it was
exposed decides nothing. Both begin from the depths that the network found with all photos.
Needs numba (`tinysplat[fast]`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..codec.modes import DEFAULT_MODE, LIST
from ..gaussian.editing import select_views
from ..gaussian.gaussians import Gaussians
from ..refine.descent import units
from ..refine.exposed import log_gain
from ..refine.free import FreeGaussians
from ..render.gradient import MovableGaussians, PhotoError, Target
from ..scene.scenes import Scene
from ..sparse import BYTES_EACH
from ..sparse.pictures import photos_of
from ..sparse.settings import Budget
from ..sparse.train import trained
from ..system.evenly import evenly
from ..system.threads import Crew
from ..system.told import NOBODY, Told
from .forecast import list_count
from .prepare import expected_bytes
from .request import EncodeRequest
from .stages import Tools, refine

HELD, STEPS = 3, 500
"""Photos that are held back; and steps of the list."""

SLACK, WORST_SLACK, ALIKE_SLACK = 0.0, 0.5, 0.003
"""dB, of all and of the worst photo, and SSIM by which a list may be below views: it takes a third of their bytes, and
has fewer steps here than it will have."""


@dataclass(frozen=True)
class Shown:
    """How photos that were held back are shown, by pictures as bright as they are: mean and worst dB, mean SSIM."""

    psnr: float
    worst: float
    ssim: float

    @classmethod
    def of(cls, errors: Sequence[PhotoError]) -> Shown:
        """Of what each photo lacks."""
        each = [error.psnr for error in errors]
        return cls(float(np.mean(each)), min(each), float(np.mean([error.ssim for error in errors])))

    def __str__(self) -> str:
        return f"{self.psnr:.2f} dB, the worst {self.worst:.2f}, SSIM {self.ssim:.3f}"


@dataclass(frozen=True)
class Contest:
    """How views and a list show photos that neither has seen."""

    views: Shown
    list: Shown

    @property
    def winner(self) -> str:
        """The mode."""
        is_as_good = (
            self.list.psnr >= self.views.psnr - SLACK
            and self.list.worst >= self.views.worst - WORST_SLACK
            and self.list.ssim >= self.views.ssim - ALIKE_SLACK
        )
        return LIST if is_as_good else DEFAULT_MODE

    def text(self, scene: Scene, at_most: int | None) -> str:
        """What was found, of a scene whose list may have so many Gaussians, in a line."""
        sizes = expected_bytes(scene) / 1000, BYTES_EACH * list_count(scene, at_most) / 1000
        views, one = (
            f"{shown}, about {size:.0f} KB" for shown, size in zip((self.views, self.list), sizes, strict=True)
        )
        won = "one list" if self.winner == LIST else "views"
        return f"as {won}; {HELD} photos held back, as views: {views}; as one list: {one}"


def contest(gaussians: Gaussians, scene: Scene, request: EncodeRequest, tools: Tools, told: Told = NOBODY) -> Contest:
    """Let views and a list of a capture show photos that neither has seen.

    Args:
        gaussians: the capture, as a network made it.
        scene: its photos.
        request: how views are coded, and how many Gaussians a list may have.
        tools: to do it with.
        told: is told of each step.

    Raises:
        InputError: as `stages.refine`.
    """
    photos, run_jobs = photos_of(gaussians, scene), Crew(tools.threads).map
    held = evenly(len(photos), HELD + 2)[1:-1]
    others = [view for view in range(len(photos)) if view not in held]
    apart, sought = select_views(gaussians, others), [photos[view] for view in held]
    refined = MovableGaussians(refine(apart, scene, None, request, tools, told=told), run_jobs)
    views = []
    for photo in sought:
        shares, shown = refined.shares(photo.camera), np.zeros((*photo.photo.shape[:2], 4), np.float32)
        refined.measure(photo, shares=shares, shown=shown)
        views.append(refined.measure(_as_bright(photo, shown), shares=shares))
    given, budget = [photos[view] for view in others], Budget(request.at_most, STEPS)
    made = trained(apart, given, budget, threads=tools.threads, told=told)
    one = FreeGaussians(made, units(made, made.viewpoints), run_jobs)
    return Contest(
        Shown.of(views), Shown.of([one.measure(_as_bright(photo, one.draw(photo.camera))) for photo in sought])
    )


def _as_bright(photo: Target, shown: NDArray) -> Target:
    """A photo whose picture, (H, W, 4) before its gain, is held against it with the gain that fits best."""
    known = np.isfinite(photo.photo)
    return replace(photo, gain=math.exp(log_gain(shown[..., :3][known], photo.photo[known])))
