"""Camera paths: through given cameras, or around them."""

import math
from collections.abc import Sequence
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import Gaussians
from ..gaussian.quaternions import matrices_to_quats, quats_to_matrices
from ..scene.cameras import Camera, intrinsics, posed
from ..system.blas import product, symmetric_eigen

ORBIT_RADIUS = 0.04
"""Least half axis of an orbit as a share of the depth it looks at: about 2.3° of parallax to either side."""

ORBIT_FLATNESS = 0.5
"""Vertical half axis over horizontal: a picture survives sideways motion better, its views lie side by side."""

RING_SIDE = 384
"""Pixels of the sides of `ring`'s views."""


def between(cameras: Sequence[Camera], frames: int) -> list[Camera]:
    """Cameras on a smooth path through all given ones, in their order, as many from each to the next.

    Between two the centre moves in a straight line and the rotation turns at constant speed about a fixed axis (slerp,
    the shorter way). Of more, both go along cubic curves whose direction at a camera is the mean of those to it and
    from it, so that nothing jerks, and whose speed there is at most the lower of the two, so that nothing overshoots.
    K moves in straight lines.

    Args:
        cameras: at least one, all of one image size.
        frames: how many to return; the first and last are the first and last given camera.

    Raises:
        InputError: no cameras, different sizes, or `frames` is no whole number above 0.
    """
    _check(cameras, frames)
    return _along(cameras, np.linspace(0, len(cameras) - 1, frames))


def halting(cameras: Sequence[Camera], frames: int, staying: float, depth: float) -> list[Camera]:
    """As `between`, with a stop at every given camera, and cuts where the next is farther away than `depth`.

    Args:
        cameras: at least one, all of one image size.
        frames: how many to return.
        staying: share of the time that a camera stands still, 0 to 1.
        depth: of what the cameras look at, scene units: beyond it, a straight way would lead through things.

    Returns:
        Cameras; one that stands still is the same object as the one before.

    Raises:
        InputError: no cameras, different sizes, or `frames` is no whole number above 0.
    """
    _check(cameras, frames)
    leg, share = np.divmod(np.linspace(0, len(cameras), frames, endpoint=False), 1)
    way = np.clip((share - staying) / (1 - staying), 0, 1)
    away = np.linalg.norm(np.diff([camera.centre for camera in cameras], axis=0, append=[cameras[-1].centre]), axis=1)
    way = np.where(away[leg.astype(int)] > depth, np.round(way), way * way * (3 - 2 * way))
    times, of = np.unique(np.minimum(leg + way, len(cameras) - 1), return_inverse=True)
    path = _along(cameras, times)
    return [path[i] for i in of]


def _along(cameras: Sequence[Camera], times: NDArray) -> list[Camera]:
    """Cameras of the path through all given ones, which are at the times 0, 1, …"""
    quats = matrices_to_quats(np.stack([camera.rotation.T for camera in cameras]))
    for i in range(1, len(quats)):
        quats[i] *= 1 if (quats[i] * quats[i - 1]).sum() >= 0 else -1
    centres = np.stack([camera.centre for camera in cameras])
    path = []
    for t in times:
        i = min(int(t), max(len(cameras) - 2, 0))
        j = min(i + 1, len(cameras) - 1)
        a, b, s = cameras[i], cameras[j], t - i
        quat = _slerp(quats[i], quats[j], s) if len(cameras) < 3 else _curve(quats, i, s)
        rotation = quats_to_matrices(quat / np.linalg.norm(quat))
        path.append(Camera((1 - s) * a.K + s * b.K, posed(rotation, _curve(centres, i, s)), a.width, a.height))
    return path


def _curve(points: NDArray, i: int, s: float) -> NDArray:
    """A share s of the way from point i of (V, n) to the next: a cubic Hermite curve, of two points a straight line."""
    if len(points) < 2:
        return points[0]
    steps = np.diff(points, axis=0)

    def speed(at: int) -> NDArray:
        if at in (0, len(points) - 1):
            return steps[min(at, len(steps) - 1)]
        mean = (steps[at - 1] + steps[at]) / 2
        most = min(np.linalg.norm(steps[at - 1]), np.linalg.norm(steps[at]))
        return mean * min(1.0, most / max(float(np.linalg.norm(mean)), 1e-300))

    start, end = speed(i), speed(i + 1)
    bend = s * (1 - s) * ((1 - s) * (start - steps[i]) - s * (end - steps[i]))
    moved: NDArray = points[i] + s * steps[i] + bend
    return moved


def orbit(cameras: Sequence[Camera], frames: int, depth: float) -> list[Camera]:
    """Cameras on an ellipse about the mean camera, all looking at the point `depth` in front of it.

    The half axes, along the mean camera's x and y, are as wide as the given cameras spread, and at least
    `ORBIT_RADIUS`·depth. The first frame lies to the right; the last is one step short of it, so that a film loops.

    Args:
        cameras: at least one, all of one image size.
        frames: how many to return.
        depth: distance of the point looked at, scene units, > 0.

    Raises:
        InputError: no cameras, different sizes, `frames` is no whole number above 0, or `depth` is not positive.
    """
    _check(cameras, frames)
    if not (isinstance(depth, Real) and 0 < depth < math.inf):
        raise InputError(f"{depth!r}, expected a finite number above 0 in scene units", where="depth")
    rotation = _mean_rotation(cameras)
    centre = np.mean([camera.centre for camera in cameras], axis=0)
    target = centre + depth * rotation[:, 2]
    spread = np.abs((np.stack([camera.centre for camera in cameras]) - centre) @ rotation[:, :2]).max(axis=0)
    radius_x, radius_y = np.maximum(spread, ORBIT_RADIUS * depth * np.array([1, ORBIT_FLATNESS]))
    K = np.mean([camera.K for camera in cameras], axis=0)
    path = []
    for angle in 2 * math.pi * np.arange(frames) / frames:
        shift = radius_x * math.cos(angle) * rotation[:, 0] + radius_y * math.sin(angle) * rotation[:, 1]
        turned = looking_along(target - (centre + shift), down=rotation[:, 1])
        path.append(Camera(K, posed(turned, centre + shift), cameras[0].width, cameras[0].height))
    return path


def outside(gaussians: Gaussians) -> Camera:
    """A view of Gaussians that have none, 800×600: in front of all but strays, y down as .ply scenes have it."""
    middle, length = _bulk(gaussians)
    c2w = posed(np.eye(3), middle - (0, 0, 1.5 * length or 1.0))
    return Camera(intrinsics(600, 600, 400, 300), c2w, 800, 600)


def ring(gaussians: Gaussians, frames: int) -> list[Camera]:
    """Views from all sides of Gaussians that have none, 384×384: about the y axis, in turns a little above and below.

    The scene's bulk (`outside`) fills most of a view.
    """
    target, length = _bulk(gaussians)
    distance = 1.2 * length or 1.0
    K = intrinsics(RING_SIDE, RING_SIDE, RING_SIDE / 2, RING_SIDE / 2)
    views = []
    for number in range(frames):
        turn, rise = 2 * math.pi * number / frames + 0.3, 0.25 * (-1) ** number
        towards = np.array([math.sin(turn) * math.cos(rise), math.sin(rise), math.cos(turn) * math.cos(rise)])
        turned = looking_along(-towards, down=np.array([0.0, 1.0, 0.0]))
        views.append(Camera(K, posed(turned, target + distance * towards), RING_SIDE, RING_SIDE))
    return views


def _bulk(gaussians: Gaussians) -> tuple[NDArray, float]:
    """Middle (3,) and diagonal, scene units, of the box about all Gaussians but strays."""
    flat = gaussians.flat()
    low, high = np.percentile(flat.means.astype(np.float64) + flat.origin, (5, 95), axis=0)
    return (low + high) / 2, float(np.linalg.norm(high - low))


def _check(cameras: Sequence[Camera], frames: int) -> None:
    if not cameras:
        raise InputError("none, expected at least one", where="cameras")
    sizes = {(camera.height, camera.width) for camera in cameras}
    if len(sizes) > 1:
        raise InputError(f"images of {sorted(sizes)[:3]} (height, width), expected one size", where="cameras")
    if isinstance(frames, bool) or not isinstance(frames, (int, np.integer)) or frames < 1:
        raise InputError(f"{frames!r}, expected a whole number above 0", where="frames")


def _slerp(a: NDArray, b: NDArray, s: float) -> NDArray:
    """Unit quaternion a share s of the way from a to b."""
    # twice the half chord's arcsine is exact for small angles, where the arccosine of a dot product is not
    angle = 2 * math.asin(min(math.sqrt(np.square(b - a).sum()) / 2, 1.0))
    if angle == 0:
        return a
    return (math.sin((1 - s) * angle) * a + math.sin(s * angle) * b) / math.sin(angle)


def _mean_rotation(cameras: Sequence[Camera]) -> NDArray:
    """(3, 3) camera-to-world rotation least far from all: the dominant eigenvector of Σ q qᵀ (Markley et al. 2007)."""
    quats = matrices_to_quats(np.stack([camera.rotation.T for camera in cameras]))
    return quats_to_matrices(symmetric_eigen(product(quats.T, quats))[1][:, -1])


def looking_along(direction: NDArray, down: NDArray) -> NDArray:
    """(3, 3) float64 camera-to-world rotation with z along `direction` and y as near to `down` as that allows."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(down, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=-1)
