"""Other ways to read cameras, or one photo, that would fit the corners that photos have in common."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...scene.cameras import Camera
from ...scene.matches import Corners, corners
from .seen import CLOSER, Seen

ROLLS = (-20, -10, -5, 5, 10, 20, 90, 180, 270)
"""Degrees by which one pose may be rolled."""

FACTORS = tuple(1.15**n for n in range(-8, 9) if n)
"""Of focal lengths, from a third to three times."""

ROUNDS = 12
"""Rounds of reweighted least squares that find where a camera stands."""

TOLD = 0.01
"""Of how well lines tell a shift across most of them: along lines that are nearly parallel, they tell none."""


def readings(seen: Seen, cameras: dict[int, Camera]) -> Iterator[tuple[str, Callable[[int], Camera]]]:
    """Other ways to read poses, intrinsics, and which photo is whose: what that says, and the camera of each."""

    def each(change: Callable[..., Camera], *values: float) -> Callable[[int], Camera]:
        return {v: change(camera, *values) for v, camera in cameras.items()}.__getitem__

    yield "c2w holds world-to-camera matrices (w2c): with their inverses", each(lambda c: replace(c, c2w=c.w2c))
    axes = "c2w has OpenGL axes (y up, z backward) where OpenCV's are expected: with y and z turned"
    if seen.are_opengl:
        axes = "transform_matrix has OpenCV axes (y down, z forward) where OpenGL's are expected: with y and z turned"
    yield axes, each(lambda c: replace(c, c2w=c.c2w @ np.diag([1.0, -1.0, -1.0, 1.0])))
    yield "photos are mirrored, or the world of the cameras is: with left for right", each(_mirrored)
    for degrees, way in ((90, "right"), (-90, "left"), (180, "upside down")):
        cause = "photos are turned, by their Exif orientation or for want of it, or poses rolled"
        text = f"{cause}: with photos turned {way}"
        yield text, each(_rolled, degrees)
    for factor in FACTORS:
        yield f"focal lengths are off, or of another size of photo: times {factor:.2g}", each(_zoomed, factor, factor)
        yield f"fx does not go with fy: fx times {factor:.2g}", each(_zoomed, factor, 1.0)
    yield "the principal point is off: with cx and cy exchanged", each(lambda c: _aimed(c, c.K[1, 2], c.K[0, 2]))
    middle = each(lambda c: _aimed(c, c.width / 2, c.height / 2))
    yield "the principal point is off: with cx and cy in the middle of the photo", middle
    order = [frame.camera for frame in seen.frames]
    count = len(order)
    swapped = "swapped (left for right?)" if count == 2 else "in the reverse order of their cameras"
    yield f"photos are {swapped}: exchanged", lambda v: order[count - 1 - v]
    if count > 2:
        yield "photos belong to the next camera: each moved by one", lambda v: order[(v + 1) % count]
        yield "photos belong to the camera before: each moved by one", lambda v: order[v - 1]


def single(seen: Seen, view: int) -> Iterator[tuple[str, Corners, Camera]]:
    """Other ways to read one photo, with its corners and camera."""
    name, camera, own = seen.names[view], seen.frames[view].camera, seen.corners[view]
    image = seen.frames[view].image()
    yield f"{name} is mirrored: with left for right", corners(image[:, ::-1]), camera
    yield f"{name} is upside down: turned by 180 degrees", corners(image[::-1, ::-1]), camera
    yield f"{name} is a negative: with its colours inverted", Corners(own.places, -own.descriptors), camera
    for degrees in ROLLS:
        yield f"the pose of {name} is rolled: by {-degrees} degrees", own, _rolled(camera, degrees)
    shift = _shift(seen, view)
    x, y = np.abs(shift) / (camera.width, camera.height)
    aimed = _aimed(camera, *(camera.K[:2, 2] + shift))
    yield f"{name} is shifted, or its pose turned: by {x:.0%} of its width and {y:.0%} of its height", own, aimed
    if (moved := _moved(seen, view)) is not None:
        yield f"the pose of {name} stands at another place: moved to where its corners meet", own, moved


def _lines(seen: Seen, view: int) -> tuple[NDArray, NDArray]:
    """(M, 2) unit normals of the lines on which a photo's corners should lie, and (M,) how far off they are, pixels."""
    camera, normals, off = seen.closer[view], [], []
    for other, here, there in _beside(seen, view):
        partner = seen.closer[other]
        shift = camera.rotation @ (partner.centre - camera.centre)
        rays = there @ (camera.rotation @ partner.rotation.T @ np.linalg.inv(partner.K)).T
        lines = np.cross(shift, rays) @ np.linalg.inv(camera.K)
        length = np.linalg.norm(lines[:, :2], axis=1).clip(1e-12)
        normals.append(lines[:, :2] / length[:, None])
        off.append((lines * here).sum(axis=1) / length)
    return np.concatenate([np.empty((0, 2)), *normals]), np.concatenate([np.empty(0), *off])


def _beside(seen: Seen, view: int) -> Iterator[tuple[int, NDArray, NDArray]]:
    """Photos that have corners in common with one, with (M, 3) places in that one and in the other."""
    for (v, u), places in seen.places.items():
        if view == v:
            yield u, places[:, :3], places[:, 3:]
        elif view == u:
            yield v, places[:, 3:], places[:, :3]


def _shift(seen: Seen, view: int) -> NDArray:
    """(2,) pixels right and down that most of a photo's corners lie off the lines on which they should be."""
    normals, off = _lines(seen, view)
    camera = seen.closer[view]
    reach = [np.arange(-side / 2, side / 2, CLOSER) for side in (camera.width, camera.height)]
    tried = np.stack(np.meshgrid(*reach, indexing="ij"), axis=-1).reshape(-1, 2)
    best = tried[(np.abs(off[:, None] - normals @ tried.T) < CLOSER / 2).sum(axis=0).argmax()]
    fits = np.abs(off - normals @ best) < CLOSER
    if fits.sum() < 2:
        return np.zeros(2)
    shift: NDArray = np.linalg.lstsq(normals[fits], off[fits], rcond=TOLD)[0]
    return shift


def _moved(seen: Seen, view: int) -> Camera | None:
    """The camera at the place from which its rays meet those of other photos; None where these do not tell it.

    A corner's rays from both cameras lie in a plane with the line between them: each match is one linear equation of
    the centre, solved with ever less weight on what does not fit.
    """
    camera, normals, ends = seen.closer[view], [np.empty((0, 3))], [np.empty(0)]
    for other, here, there in _beside(seen, view):
        partner = seen.closer[other]
        both = (here, camera), (there, partner)
        ray, ray_there = ((places @ np.linalg.inv(c.K).T) @ c.rotation for places, c in both)
        across = np.cross(ray / np.linalg.norm(ray, axis=1, keepdims=True), ray_there)
        across /= np.linalg.norm(ray_there, axis=1, keepdims=True)
        normals.append(across)
        ends.append(across @ (partner.centre - camera.centre))
    rows, ends_of = np.concatenate(normals), np.concatenate(ends)
    if len(rows) < 2 * len(camera.centre):
        return None
    weight, centre = np.ones(len(rows)), np.zeros_like(camera.centre)
    for _ in range(ROUNDS):
        centre, *_ = np.linalg.lstsq(rows * weight[:, None], ends_of * weight, rcond=None)
        off = np.abs(rows @ centre - ends_of)
        weight = 1 / np.sqrt(off + np.median(off).clip(1e-9) / 4)
    c2w = camera.c2w.copy()
    c2w[:3, 3] += centre
    try:
        return replace(camera, c2w=c2w)
    except InputError:  # beyond where a camera may stand
        return None


def _zoomed(camera: Camera, x: float, y: float) -> Camera:
    return replace(camera, K=camera.K * np.array([[x, 1, 1], [1, y, 1], [1, 1, 1]]))


def _aimed(camera: Camera, x: float, y: float) -> Camera:
    """With the principal point there, pixels."""
    K = camera.K.copy()
    K[:2, 2] = x, y
    return replace(camera, K=K)


def _mirrored(camera: Camera) -> Camera:
    flip = np.diag([-1.0, 1.0, 1.0, 1.0])
    x, y = camera.K[:2, 2]
    return replace(_aimed(camera, camera.width - x, y), c2w=flip @ camera.c2w @ flip)


def _rolled(camera: Camera, degrees: float) -> Camera:
    turn = np.eye(4)
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn[:2, :2] = [[cos, -sin], [sin, cos]]
    return replace(camera, c2w=camera.c2w @ turn)
