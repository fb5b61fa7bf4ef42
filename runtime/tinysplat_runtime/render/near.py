"""Near views first: how much of each view covers everything else, from where a picture is taken.

Photos agree about a scene only so far. From a place between two of them, their surfaces are the best there are, and
those of photos taken farther away stand a little before or behind them. Drawn by depth alone every further photo
therefore costs quality: what is wrong in it covers what is right. So the surfaces (layer 0) of near views are drawn
first, with a share of their opacity, and then all Gaussians of all views, which show where the first left
transmittance: where one view sees nothing, any other may.

The distance of view v from a camera counts places and directions alike,

    d_v² = |c − c_v|² / D² + |a − a_v|²,

c the centres, a the viewing directions (unit vectors), D the views' depth, the harmonic mean of z over layer 0 in their
own frames. With d₁ the least of these distances and R 1.5 times the second least,

    w_v = clamp((R − d_v) / (R − d₁), 0, 1):

1 for the nearest view, less for the others the farther they are, and 0 beyond R. It is continuous in the camera's place
and direction, so that nothing pops along a path.

Surfaces are drawn in front with w_v² of what they are, as a surface of many Gaussians that overlap covers more than its
share: with 0.2 each, six of them cover 0.7.

Of more than six views, those that are far away show next to nothing that near ones do not, and cover much of what these
have right. So everything of a view is drawn with a share of its opacity,

    f_v = clamp((d₇ − d_v) / (d₇ − d₂), 0, 1),

d₂ and d₇ the second and seventh least distance: the two nearest views as they are, and six at most.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import Gaussians
from ..scene.cameras import Camera

REACH = 1.5
"""Of the second nearest view's distance, where shares reach 0: at 1, two views that swap places there would pop."""

MOST_VIEWS = 6
"""Drawn in a picture."""


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

    def shares(self, camera: Camera) -> tuple[NDArray, NDArray]:
        """(V,) float64 in [0, 1] each: the share of every view's surface that comes before everything else, and of the
        opacity that everything of it has.
        """
        places = np.square(self.centres - camera.centre).sum(axis=1) / self.depth**2
        distances = np.sqrt(places + np.square(self.directions - camera.rotation[2]).sum(axis=1))
        ranked = np.sort(distances)
        opaque = np.ones(len(ranked))
        if len(ranked) > MOST_VIEWS:
            opaque = _ramp(distances, ranked[1], ranked[MOST_VIEWS])
        return np.square(_ramp(distances, ranked[0], REACH * ranked[1])), opaque


def _ramp(distances: NDArray, nearest: float, reach: float) -> NDArray:
    """From 1 at the nearest to 0 at `reach`; where these are one, 1 there and 0 beyond."""
    if reach <= nearest:
        return (distances <= reach).astype(np.float64)
    return ((reach - distances) / (reach - nearest)).clip(0, 1)
