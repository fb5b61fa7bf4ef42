"""A coarse look at how well photos agree about depths: what a scene's cameras and depth range are checked with.

A plane sweep on thumbnails: for each pixel of one photo and each depth, how far its colour is from what another photo
shows there. Cameras that belong to the photos find one depth that fits nearly everywhere; others do not.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..system.told import NOBODY, Told
from .cameras import Camera

LOOK_WIDTH = 96
"""Pixels of a thumbnail's longer side."""

PLANES = 48

UNSEEN = 0.25
"""Cost of a pixel that the other photo does not show: about the distance of two colours that have nothing to do with
each other."""

_CONVERGING = 0.01  # least spread of viewing directions, as sin², whose common point means something

_WINDOW = 2  # pixels to each side that are averaged

REACH = (1.4, 150.0)
"""Depths looked for where none are known, in distances between the two cameras that are compared."""

PARTNERS, AMONG = 3, 8
"""Photos that each is compared with for its depths, of so many nearest ones."""

ALONGSIDE = 0.8
"""Cosine between the directions in which two photos look that are compared for their depths."""

DISTANT = 40.0
"""Depths beyond so many distances between two cameras are found from others, which stand farther apart, ..."""

BARELY = 90.0
"""Where most depths lie beyond so many distances between the cameras, however far apart, they are no depths."""

_FARTHER = 4.0  # ... by this factor

_MARGINS = (1.3, 1.6)  # near is divided by the first and far multiplied by the second: too wide costs less
_PERCENTILES = (2, 95)
_ANOTHER_WAY = 0.3  # cosine between the directions of photos that hardly show the same
_TWICE = 0.001  # of the extent of all cameras: nearer ones stand at one place
_SAME = 1.5  # planes between two photos' depths of one place
_CONFIDENT = 0.45  # the best depth's cost over the mean cost of all depths, below which a pixel tells its depth


@dataclass(frozen=True, eq=False)
class BestDepths:
    """At which depths a photo's thumbnail shows what another one does.

    Attributes:
        best: (H, W) int, which of `depths` fits each pixel best.
        confident: (H, W) bool, which pixels tell their depth.
        depths: (P,) scene units.
    """

    best: NDArray
    confident: NDArray
    depths: NDArray


def thumbnail_size(camera: Camera, side: int = LOOK_WIDTH) -> tuple[int, int]:
    """(height, width) of a thumbnail of a camera's photo, the longer one at most `side`."""
    scale = min(1.0, side / max(camera.width, camera.height))
    return max(8, round(camera.height * scale)), max(8, round(camera.width * scale))


def all_best_depths(images: NDArray, cameras: Sequence[Camera], depths: NDArray) -> list[BestDepths]:
    """Photos compared with the ones nearest to them.

    Args:
        images: thumbnails (V, H, W, 3) float in [0, 1], of their cameras' sizes.
        cameras: two or more.
        depths: (P,) scene units, > 0.
    """
    others = neighbours(cameras)[:, 0]
    return [
        best_depths(image, camera, images[other], cameras[other], depths)
        for image, camera, other in zip(images, cameras, others, strict=True)
    ]


def neighbours(cameras: Sequence[Camera]) -> NDArray:
    """(V, V - 1) int indices of the cameras beside each of two or more, the nearest first.

    Those that look another way or stand at one place with it, as the cameras of a rig do, come last.
    """
    apart, axes = _apart(cameras), np.stack([camera.rotation[2] for camera in cameras])
    extent = float(apart[np.isfinite(apart)].max(initial=0))
    rank = ((axes @ axes.T < _ANOTHER_WAY) | (apart <= _TWICE * extent)).astype(int)
    np.fill_diagonal(rank, 2)  # itself
    order: NDArray = np.lexsort((apart, rank), axis=1)[:, :-1]
    return order


def best_depths(image: NDArray, camera: Camera, other: NDArray, other_camera: Camera, depths: NDArray) -> BestDepths:
    """A photo (H, W, 3) compared with another, both float in [0, 1] of their cameras' sizes, at depths (P,) > 0."""
    costs = _costs(image, camera, other, other_camera, depths)
    return BestDepths(costs.argmin(axis=0), costs.min(axis=0) < _CONFIDENT * costs.mean(axis=0), depths)


def consistency(own: BestDepths, camera: Camera, other: BestDepths, other_camera: Camera) -> float:
    """Share of a photo's pixels in another's frame at whose best depth the other's own best depth lies, 0 to 1.

    Photos of different things often find colours that fit, but not at the same places from both sides.

    Args:
        own, camera: of the photo.
        other, other_camera: of the other, looked at over the same depths.
    """
    inside, same = _consistent(own, camera, other, other_camera)
    return float(same.sum() / max(inside.sum(), 1))


def _both_ways(
    images: NDArray, cameras: Sequence[Camera], pair: tuple[int, int], depths: NDArray
) -> list[tuple[BestDepths, NDArray]]:
    """Of either of two photos what it shows of the other, and (H, W) which pixels tell a depth that the other has."""
    v, u = pair
    here = best_depths(images[v], cameras[v], images[u], cameras[u], depths)
    there = best_depths(images[u], cameras[u], images[v], cameras[v], depths)
    both = ((here, cameras[v], there, cameras[u]), (there, cameras[u], here, cameras[v]))
    return [(one[0], one[0].confident & _consistent(*one)[1]) for one in both]


def range_seen(images: NDArray, cameras: Sequence[Camera], told: Told = NOBODY) -> tuple[float, float]:
    """(near, far) that photos agree about, scene units, for scenes that state none.

    Each photo is compared with some that stand near it, but not so near that they show no depth, and look the same way.
    Depths are sought in units of the distance of the two: what the whole capture spans says nothing about them. There
    are as many as a thumbnail has pixels along its longer side.

    Args:
        images, cameras: as for `all_best_depths`.
        told: is told of each pair of photos.

    Raises:
        InputError: the cameras stand at one place or only turn, or the photos agree about no depth.
    """
    apart = _apart(cameras)
    extent = float(apart[np.isfinite(apart)].max(initial=0))
    if not extent > 0:
        raise InputError("all cameras stand at one place, which shows no depth")
    least = float(np.median(np.where(apart > _TWICE * extent, apart, np.inf).min(axis=1))) / 2
    while True:
        pairs = _pairs(cameras, least)
        depths = [
            _sure_depths(images, cameras, pair, float(apart[pair]))
            for pair in told.progress("looking for near and far", pairs)
        ]
        agreed = np.concatenate([of_one for both in depths for of_one in both])
        apart_most = float(np.median([apart[pair] for pair in pairs]))
        least *= _FARTHER
        if not agreed.size or np.median(agreed) < DISTANT * apart_most or least > extent:
            break
    if agreed.size < 0.02 * 2 * len(pairs) * images.shape[1] * images.shape[2]:
        raise InputError("the photos agree about no depth; --near and --far state it")
    if np.median(agreed) > BARELY * apart_most:
        raise InputError("the photos show no depth: the cameras only turn, or hardly move for what they look at")
    low, high = np.percentile(agreed, _PERCENTILES)
    return float(low / _MARGINS[0]), float(high * _MARGINS[1])


def _apart(cameras: Sequence[Camera]) -> NDArray:
    """(V, V) distances between cameras, infinite from each to itself."""
    centres = np.stack([camera.centre for camera in cameras])
    apart = np.linalg.norm(centres[:, None] - centres, axis=-1)
    np.fill_diagonal(apart, np.inf)
    return apart


def _pairs(cameras: Sequence[Camera], least: float) -> list[tuple[int, int]]:
    """Pairs to find depths by, at least so far apart; where none look the same way, those that do most."""
    apart, axes = _apart(cameras), np.stack([camera.rotation[2] for camera in cameras])
    alike = axes @ axes.T
    pairs = set()
    for v in range(len(cameras)):
        others = [u for u in np.argsort(apart[v], kind="stable").tolist() if least <= apart[v, u] < np.inf]
        alongside = [u for u in others[:AMONG] if alike[v, u] > ALONGSIDE]
        beside = alongside or sorted(others, key=lambda u: -alike[v, u])[:1]
        pairs |= {(min(u, v), max(u, v)) for u in beside[:PARTNERS]}
    return sorted(pairs)


def _sure_depths(images: NDArray, cameras: Sequence[Camera], pair: tuple[int, int], apart: float) -> list[NDArray]:
    """Depths of the pixels of each of two photos that tell it and that the other has at about the same depth."""
    inverse = np.linspace(1 / (apart * REACH[0]), 1 / (apart * REACH[1]), max(images.shape[1:3]))
    both = _both_ways(images, cameras, pair, 1 / inverse)
    return [found.depths[found.best[is_told]] for found, is_told in both]


def _consistent(own: BestDepths, camera: Camera, other: BestDepths, other_camera: Camera) -> tuple[NDArray, NDArray]:
    """Which pixels (H, W) lie in another photo's frame, and at which of these it has that depth, too."""
    inverse = 1 / own.depths
    best = own.depths[own.best]
    (point,) = _points(camera, other_camera, best.shape, best[None, :, :, None])
    row, column, inside = _places(point, other_camera)
    step = abs(inverse[-1] - inverse[0]) / (len(inverse) - 1)
    there = inverse[other.best][row, column]
    with np.errstate(divide="ignore"):
        return inside, inside & (np.abs(1 / point[..., 2] - there) <= _SAME * step)


def range_guessed(cameras: Sequence[Camera]) -> tuple[float, float]:
    """(near, far) from where cameras stand and look alone: about the point that all look at, or far ahead of them all.

    Good enough to choose views by.
    """
    point = looked_at(cameras)
    if point is not None:
        depths = np.array([(point - camera.centre) @ camera.rotation[2] for camera in cameras])
        depth = float(np.median(depths[depths > 0]))
        return depth / 2, depth * 2
    apart = float(np.linalg.norm(np.ptp([camera.centre for camera in cameras], axis=0))) or 1.0
    return apart * 1.5, apart * 30


def looked_at(cameras: Sequence[Camera]) -> NDArray | None:
    """The point (3,) nearest to the axes of all cameras, where they converge and most have it in front of them."""
    centres = np.stack([camera.centre for camera in cameras])
    axes = np.stack([camera.rotation[2] for camera in cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]  # (V, 3, 3), what lies beside each axis
    if np.linalg.eigvalsh(across.mean(axis=0))[0] <= _CONVERGING:
        return None
    point: NDArray = np.linalg.solve(across.mean(axis=0), (across @ centres[:, :, None]).mean(axis=0)[:, 0])
    return point if (((point - centres) * axes).sum(axis=1) > 0).mean() > 0.5 else None


def _costs(image: NDArray, camera: Camera, other: NDArray, other_camera: Camera, depths: NDArray) -> NDArray:
    """(P, H, W) distances of an image's colours to those of another where it shows a pixel at each depth."""
    height, width = image.shape[:2]
    costs = np.empty((len(depths), height, width), np.float32)
    for p, point in enumerate(_points(camera, other_camera, (height, width), depths[:, None, None, None])):
        row, column, inside = _places(point, other_camera)
        red, green, blue = np.moveaxis(np.abs(other[row, column] - image), -1, 0)
        costs[p] = np.where(inside, (red + green + blue) / 3, UNSEEN)
    return _smoothed(costs)


def _points(camera: Camera, other_camera: Camera, size: tuple[int, int], depths: NDArray) -> Iterator[NDArray]:
    """Where another camera has the pixels of one at each of depths (P, …): (H, W, 3) homogeneous, z last."""
    v, u = np.mgrid[0 : size[0], 0 : size[1]] + 0.5
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ (camera.rotation.T @ np.linalg.inv(camera.K)).T  # (H, W, 3)
    turned = rays @ (other_camera.K @ other_camera.rotation).T
    shift = (camera.centre - other_camera.centre) @ (other_camera.K @ other_camera.rotation).T
    return (depth * turned + shift for depth in depths)


def _places(point: NDArray, camera: Camera) -> tuple[NDArray, NDArray, NDArray]:
    """Row, column and whether inside the frame, (H, W) each, of homogeneous points; 0 for those that are not."""
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = point[..., 0] / point[..., 2], point[..., 1] / point[..., 2]
        inside = (point[..., 2] > 0) & (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
    row, column = (np.where(inside, at, 0).astype(np.int64) for at in (y, x))
    return row, column, inside


def _smoothed(costs: NDArray) -> NDArray:
    """Means over windows of 2·_WINDOW + 1 pixels, the last two axes."""
    for axis in (1, 2):
        padding = [(0, 0)] * 3
        padding[axis] = (_WINDOW, _WINDOW)
        padded = np.pad(costs, padding, mode="edge")
        length, width = costs.shape[axis], 2 * _WINDOW + 1
        shifted = (padded.take(range(n, n + length), axis) for n in range(width))
        costs = np.add.reduce(list(shifted)) / np.float32(width)
    return costs
