"""A length that somebody measured, from which follows how long a scene's unit is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import Gaussians
from ..render import Renderer
from ..scene.cameras import Camera
from .words import Length

UNIT = "metre"
"""What scenes are scaled to."""

_SIDE = 3  # pixels of the window about an end
_SEEN = 0.5  # least alpha of a surface


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


def measured(gaussians: Gaussians, length: Length, threads: int | None) -> Measured:
    """Find a length in a scene.

    Args:
        gaussians: with the cameras of the views, where the length is between pixels of one.
        length: what was measured.
        threads: of the renderer.

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
        renderer = Renderer(gaussians, threads=threads, compiled=False, keep=False)
        one, other = (_surface(renderer, cameras[length.view], end, length.view) for end in length.ends)
    apart = np.linalg.norm(one[:, None] - other, axis=-1)
    middle = float(np.linalg.norm(one[len(one) // 2] - other[len(other) // 2]))
    if not middle > 0:
        raise InputError("both ends are one point", where="length")
    return Measured(length.metres, middle, float(apart.std()))


def _surface(renderer: Renderer, camera: Camera, end: tuple[float, ...], view: int) -> NDArray:
    """Points (9, 3) that show at a pixel, which is the middle one, and about it; world."""
    u, v = end
    if not (0 <= u <= camera.width and 0 <= v <= camera.height):
        fault = f"pixel {u:g},{v:g} of view {view}, which has {camera.width}x{camera.height}"
        raise InputError(fault, where="length")
    K = camera.K.copy()
    K[:2, 2] += _SIDE / 2 - np.array(end)
    window = Camera(K, camera.c2w, _SIDE, _SIDE)
    pictures = renderer.render(window, outputs=("depth", "alpha"))
    depth, alpha = pictures["depth"], pictures["alpha"]
    if alpha[_SIDE // 2, _SIDE // 2] < _SEEN:
        raise InputError(f"nothing is seen at pixel {u:g},{v:g} of view {view}", where="length")
    depth = np.where(alpha < _SEEN, depth[_SIDE // 2, _SIDE // 2], depth).reshape(-1, 1).astype(np.float64)
    y, x = np.mgrid[:_SIDE, :_SIDE].reshape(2, -1) + 0.5
    rays = np.linalg.solve(K, np.stack([x, y, np.ones_like(x)])).T
    return rays * depth @ camera.rotation + camera.centre
