"""Near views first: how much of each view covers everything else, from where a picture is taken, and which are drawn.

Photos agree about a scene only so far. From a place between two of them, their surfaces are the best there are, and
those of photos taken farther away stand a little before or behind them. Drawn by depth alone every further photo
therefore costs quality: what is wrong in it covers what is right. So the surfaces (layer 0) of near views are drawn
first, with a share of their opacity, and then all Gaussians, which show where the first left transmittance.

The distance of view v from a camera counts places and directions alike,

    d_v² = |c − c_v|² / D² + |a − a_v|²,

c the centres, a the viewing directions (unit vectors), D the views' depth, the harmonic mean of z over layer 0 in their
own frames. With d₁ the least of these distances and R a distance that depends on how many views there are,

    w_v = clamp((R − d_v) / (R − d₁), 0, 1):

1 for the nearest view, less for the others the farther they are, and 0 beyond R. It is continuous in the camera's place
and direction, so that nothing pops along a path.

- Of up to `FEW` views, R is 1.5 times the second least distance, and Gaussians of all views are drawn behind, as they
  are: where one of them sees nothing, any other may.
- Of more, a capture, R is the fifth least distance, and what is drawn behind has its opacity times w_v: the four
  nearest views alone are drawn whole, whose errors are small from here. Of views at one place that look one way, which
  no camera can tell apart, the first counts alone. What these four see nothing of would be a hole, so behind them all
  come coarse copies of surfaces, of one Gaussian in `EVERY`² (`prepare.coarse_parts`), with their opacity times

      b_v = clamp((B − d_v) / (B − R), 0, 1),

  B the distance of the nearest view beyond `AROUND`; of fewer views, all have 1. They show in pixels of which all else
  left more transmittance than `OPEN`, and nowhere else, so that their errors hide nothing.

Surfaces are drawn in front with w_v² of what they are, as a surface of many Gaussians that overlap covers more than its
share: with 0.2 each, six of them cover 0.7.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import Gaussians
from ..scene.cameras import Camera

REACH = 1.5
"""Of the second nearest view's distance, where shares reach 0: at 1, two views that swap places there would pop."""

FEW = 6
"""Views of which all are drawn, from wherever."""

DRAWN = 4
"""Views of a capture that are drawn whole; fewer leave holes, more bring surfaces that are wrong from here."""

AROUND = 12
"""Views of a capture whose coarse surfaces are drawn behind these."""

OPEN = 1 / 64
"""Transmittance that everything else has to leave of a pixel for coarse surfaces to be drawn there: drawing them
everywhere takes as long as all else, and from more on one sees where they end."""

BEHIND = -1.0
"""In place of a share that comes first: drawn behind everything that has none such."""


@dataclass(frozen=True, eq=False)
class Shares:
    """What of each view a picture is drawn with.

    Attributes:
        front: (V,) float64 in [0, 1], the share of its surface that comes before everything else; nowhere more than
        whole: (V,) float64 in [0, 1], the share of their opacity that all its Gaussians are drawn with.
        behind: (V,) float64 in [0, 1], that of its coarse surface, which comes after everything else.
    """

    front: NDArray
    whole: NDArray
    behind: NDArray

    @classmethod
    def by_depth(cls, whole: NDArray) -> Shares:
        """Everything by depth, and nothing before or behind it; `whole` is (V,) float64."""
        return cls(np.zeros(len(whole)), whole, np.zeros(len(whole)))

    @property
    def has_front(self) -> bool:
        """Whether anything is drawn before everything else."""
        return bool(self.front.any())

    def shows(self, view: int, is_coarse: bool) -> bool:
        """Whether anything is drawn of a view, or of its coarse surface."""
        return bool((self.behind if is_coarse else self.whole)[view] > 0)

    def of(self, view: int, is_surface: bool, is_coarse: bool = False) -> tuple[float, float]:
        """For a view's Gaussians, of which something is drawn: the logarithm of that share of their opacity, and the
        share of their alphas, as these are then, that comes first, or `BEHIND`.
        """
        if is_coarse:
            return math.log(self.behind[view]), BEHIND
        whole = float(self.whole[view])
        return math.log(whole), float(self.front[view]) / whole if is_surface else 0.0


@dataclass(frozen=True, eq=False)
class NearViews:
    """Where views were taken.

    Attributes:
        centres: (V, 3) float64, world.
        directions: (V, 3) float64 unit vectors.
        depth: D, scene units.
    """

    centres: NDArray
    directions: NDArray
    depth: float

    @classmethod
    def of(cls, gaussians: Gaussians) -> NearViews | None:
        """The views of per-pixel Gaussians; None where there are fewer than two."""
        cameras = gaussians.cameras
        if len(cameras) < 2:
            return None
        centres = np.stack([camera.centre for camera in cameras])
        directions = np.stack([camera.rotation[2] for camera in cameras])
        count, inverse = 0, 0.0
        for means, centre, direction in zip(gaussians.means, gaussians.origin - centres, directions, strict=True):
            z = (means @ direction) + centre @ direction
            count, inverse = count + int(np.count_nonzero(z > 0)), inverse + float((1 / z[z > 0]).sum())
        return cls(centres, directions, count / inverse if count else 1.0)

    @property
    def most(self) -> int:
        """How many views are drawn whole at most."""
        return min(len(self.centres), FEW)

    @property
    def around(self) -> int:
        """Of how many views coarse surfaces are drawn at most."""
        return min(len(self.centres), AROUND)

    @cached_property
    def is_capture(self) -> bool:
        """Whether coarse surfaces are ever drawn."""
        return int(self._poses.max()) >= FEW

    def shares(self, camera: Camera, without: Iterable[int] = ()) -> Shares:
        """What a camera's picture is drawn with, of all views but some; where one alone is left, all is by depth."""
        gone = set(without)  # numpy's functions of sets load all of `numpy.ma` (12 ms)
        left = np.array([view for view in range(len(self.centres)) if view not in gone], np.intp)
        shares = np.zeros((3, len(self.centres)))
        if left.size < 2:
            shares[1, left] = 1
        else:
            shares[:, left] = self._of_some(camera, left)
        return Shares(*shares)

    def _of_some(self, camera: Camera, views: NDArray) -> NDArray:
        """(3, n) front, whole and behind, as `Shares` has them, of (n,) views alone."""
        places = np.square(self.centres[views] - camera.centre).sum(axis=1) / self.depth**2
        distances = np.sqrt(places + np.square(self.directions[views] - camera.rotation[2]).sum(axis=1))
        front, whole, behind = shares = np.zeros((3, views.size))
        counted = np.arange(views.size) if views.size <= FEW else np.unique(self._poses[views], return_index=True)[1]
        near = counted[np.lexsort((counted, distances[counted]))]
        if near.size <= FEW:
            whole[near] = 1
            front[near] = np.square(_ramp(distances[near], REACH * distances[near[min(1, near.size - 1)]]))
        else:
            reach, around = distances[near[DRAWN]], near[:AROUND]
            whole[near[:DRAWN]] = _ramp(distances[near[:DRAWN]], reach)
            front[:] = np.square(whole)
            behind[around] = 1
            if near.size > AROUND:
                behind[around] = _ramp(distances[around].clip(min=reach), distances[near[AROUND]])
        return shares

    @cached_property
    def _poses(self) -> NDArray:
        """(V,) the number of each view's place and direction among all that there are."""
        poses = np.concatenate([self.centres, self.directions], axis=1)
        return np.unique(poses, axis=0, return_inverse=True)[1].reshape(-1)


def _ramp(distances: NDArray, reach: float) -> NDArray:
    """Of rising distances: from 1 at the first to 0 at `reach`; where these are one, 1 there and 0 beyond."""
    if reach <= distances[0]:
        return (distances <= reach).astype(np.float64)
    return ((reach - distances) / (reach - distances[0])).clip(0, 1)
