"""Near views first: how much of each view's surface covers everything else, from where a picture is taken.

Photos agree about a scene only so far. From a place between two of them, their surfaces are the best there are, and
those of photos taken farther away stand a little before or behind them. Drawn by depth alone every further photo
therefore costs quality: what is wrong in it covers what is right. So the surfaces (layer 0) of near views are drawn
first, with a share w of their opacity, and then all Gaussians, which show where the first left transmittance.

The distance of view v from a camera counts places and directions alike,

    d_v² = |c − c_v|² / D² + |a − a_v|²,

c the centres, a the viewing directions (unit vectors), D the views' depth, the harmonic mean of z over layer 0 in their
own frames. With d₁ the least of these distances and R = 1.5 times the second least,

    w_v = clamp((R − d_v) / (R − d₁), 0, 1)²:

1 for the nearest view, less for the second the farther it is, and 0 beyond R. It is continuous in the camera's place
and direction, and smooth where a view comes in, so that nothing pops along a path. (Squared, as a surface of many
Gaussians that overlap covers more than its share: with w = 0.2 each, six of them cover 0.7.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import Gaussians
from ..scene.cameras import Camera

REACH = 1.5
"""Of the second nearest view's distance, where shares reach 0: at 1, two views that swap places there would pop."""


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
        z = np.einsum("vhwc,vc->vhw", gaussians.means, directions)
        z += ((gaussians.origin - centres) * directions).sum(axis=1)[:, None, None]
        seen = z[z > 0]
        return cls(centres, directions, seen.size / float((1 / seen).sum()) if seen.size else 1.0)

    def only(self, views: Sequence[int]) -> NearViews | None:
        """Some of them; None where that is fewer than two."""
        chosen = list(views)
        return NearViews(self.centres[chosen], self.directions[chosen], self.depth) if len(chosen) > 1 else None

    def shares(self, camera: Camera) -> NDArray:
        """(V,) float64: the share of its opacity that each view's surface is drawn first with."""
        places = np.square(self.centres - camera.centre).sum(axis=1) / self.depth**2
        distances = np.sqrt(places + np.square(self.directions - camera.rotation[2]).sum(axis=1))
        nearest, second = np.sort(distances)[:2]
        reach = REACH * second
        if reach <= nearest:  # both are where the camera is
            return (distances <= nearest).astype(np.float64)
        return np.square(((reach - distances) / (reach - nearest)).clip(0, 1))


def log_share(shares: NDArray | None, view: int) -> float:
    """Logarithm of a view's share, −∞ where nothing of it is drawn first."""
    share = 0 if shares is None or view < 0 else float(shares[view])
    return math.log(share) if share > 0 else -math.inf
