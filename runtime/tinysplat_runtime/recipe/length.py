"""A length that somebody measured, from which follows how long a scene's unit is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import Gaussians
from ..gaussian.quaternions import normalize_quats, quats_to_matrices
from ..scene.cameras import Camera
from .words import Length

UNIT = "metre"
"""What scenes are scaled to."""

_ABOUT = np.mgrid[-1:2, -1:2].reshape(2, -1).T  # pixels about an end, itself in the middle
_SEEN = 0.5  # of the light that a surface holds back
_PIXEL = 0.3  # variance of a pixel's footprint, pixels²
_REACH = 4.0  # standard deviations


@dataclass(frozen=True)
class Measured:
    """A length in a scene.

    Attributes:
        metres: as it was measured.
        units: the same in the scene's units.
        off: standard deviation of `units` where both ends are off by a pixel or less; 0 for points that are given.
    """

    metres: float
    units: float
    off: float

    @property
    def scale(self) -> float:
        """Metres to a unit."""
        return self.metres / self.units

    def __str__(self) -> str:
        off = f" ± {self.off / self.units:.1%} for a pixel's difference" if self.off else ""
        return f"{self.metres:g} m are {self.units:.4g} units{off}: enlarged {self.scale:.4g} times"


def measured(gaussians: Gaussians, length: Length) -> Measured:
    """Find a length in a scene.

    Args:
        gaussians: with the cameras of the views, where the length is between pixels of one.
        length: what was measured.

    Raises:
        InputError: there is no such view or pixel, nothing is seen there, or both ends are one.
    """
    if length.view is None:
        one, other = (np.array([end]) for end in length.ends)
    else:
        cameras = gaussians.cameras or gaussians.viewpoints
        if not 0 <= length.view < len(cameras):
            known = f"view 0 to {len(cameras) - 1}" if cameras else "X,Y,Z,X,Y,Z=…, as no cameras are known"
            raise InputError(f"view {length.view}, expected {known}", where="length")
        camera = cameras[length.view]
        one, other = (_surface(gaussians, length.view, camera, end) for end in length.ends)
    apart = np.linalg.norm(one[:, None] - other, axis=-1)
    middle = float(apart[len(one) // 2, len(other) // 2])
    if not middle > 0:
        raise InputError("both ends are one point", where="length")
    return Measured(length.metres, middle, float(apart.std()))


def _surface(gaussians: Gaussians, view: int, camera: Camera, end: tuple[float, ...]) -> NDArray:
    """Points (9, 3) that show at a pixel of a view, which is the middle one, and about it; world."""
    place = f"pixel {end[0]:g},{end[1]:g} of view {view}"
    if not (0 <= end[0] <= camera.width and 0 <= end[1] <= camera.height):
        raise InputError(f"{place}, which has {camera.width}x{camera.height}", where="length")
    rays = _rays(camera, np.array(end) + _ABOUT) @ camera.rotation
    depths = np.full(len(rays), np.inf)
    if gaussians.is_per_pixel:  # its own pixels are its surfaces, where other views do not show them better
        own = gaussians.changed(extra_layers=()).taken([view]).changed(cameras=(camera,))
        depths = _depths(own.flat(), camera, rays)
    middle = len(rays) // 2
    if not depths[middle] < np.inf:
        depths = _depths(gaussians.flat(), camera, rays)
    if not depths[middle] < np.inf:
        raise InputError(f"nothing is seen at {place}", where="length")
    return rays * np.where(np.isfinite(depths), depths, depths[middle])[:, None] + camera.centre


def _rays(camera: Camera, pixels: NDArray) -> NDArray:
    return np.linalg.solve(camera.K, np.c_[pixels, np.ones(len(pixels))].T).T


def _depths(gaussians: Gaussians, camera: Camera, rays: NDArray) -> NDArray:
    """(R,) depths of a list along rays (R, 3), the middle one of which all lie about, 1 deep, world; see `_depth`."""
    offsets = gaussians.means + (gaussians.origin - camera.centre)  # (N, 3), from the camera
    z = offsets @ camera.rotation[2]
    away = np.linalg.norm(offsets - z[:, None] * rays[len(rays) // 2], axis=1)
    reach = _REACH * gaussians.scales.max(axis=1) + (_REACH + 2) * z / camera.focal
    near = np.flatnonzero((z > 0) & (away < reach))
    return np.array([_depth(gaussians.taken(near), offsets[near], camera, ray) for ray in rays])


def _depth(gaussians: Gaussians, offsets: NDArray, camera: Camera, ray: NDArray) -> float:
    """Depth at which Gaussians along a ray hold back half of the light; infinite where all of them hold back less."""
    turns = quats_to_matrices(normalize_quats(gaussians.quats.astype(np.float64)))
    pixel = _PIXEL * ((offsets @ camera.rotation[2]) / camera.focal) ** 2
    widths = np.sqrt(gaussians.scales.astype(np.float64) ** 2 + pixel[:, None])
    local, along = (np.einsum("nji,nj->ni", turns, offsets) / widths, np.einsum("nji,j->ni", turns, ray) / widths)
    depths = (local * along).sum(axis=1) / (along**2).sum(axis=1)  # where each is densest
    alphas = gaussians.opacities * np.exp(-0.5 * ((local - depths[:, None] * along) ** 2).sum(axis=1))
    order = np.argsort(depths)
    left = np.cumprod(1 - alphas[order])
    behind = np.flatnonzero(left < _SEEN)
    return float(depths[order[behind[0]]]) if len(behind) else np.inf
