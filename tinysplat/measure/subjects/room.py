"""Scenes that need no data, as scene folders: a ray-traced room from any number of places, and the stereo pair that
comes with scikit-image, real photos.

The room has walls, boxes and balls with solid textures (sums of waves with hard edges drawn into them), so that
photo-consistency has something to hold on to, and depth has steps. Everything is a function of its arguments.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.intake.cameras_json import write_photos
from tinysplat_runtime.scene.resampling import resize_cover

# Calibration of scikit-image's motorcycle pair at 741×500, from the Middlebury 2014 data set, and its depths.
FOCAL_PX, BASELINE_M, CX_PX, CY_PX = 994.978, 0.193001, (311.193, 342.279), 254.877
NEAR_M, FAR_M = 2.0, 5.1

NEAR, FAR = 1.8, 9.0
"""Of the room."""

SPACING = 0.2
"""Scene units between neighbouring cameras: 4 % of the middle depth."""

_WALLS = ((-3.2, -1.6, -3.0), (3.2, 1.5, 8.0))
_BOXES = (
    ((0.9, 0.2, 4.6), (1.9, 1.5, 5.4)),
    ((-2.2, 0.5, 3.2), (-1.5, 1.5, 4.0)),
    ((-0.3, -0.7, 6.3), (0.7, 1.5, 6.7)),
)
_BALLS = (((-1.0, 0.7, 4.4), 0.7), ((1.3, 1.0, 3.5), 0.45), ((0.2, 1.0, 5.6), 0.5), ((-0.3, 1.1, 3.1), 0.25))
_LIGHT = np.array([0.45, -0.8, -0.4])
_SUPERSAMPLE = 2


def write_room(folder: Path, views: int, height: int, width: int) -> None:
    """Photos of the room from cameras on an arc, `SPACING` apart and turned towards its middle, as a scene folder."""
    cameras = [_camera(v - (views - 1) / 2, height, width) for v in range(views)]
    folder.mkdir(parents=True, exist_ok=True)
    write_photos(folder, map(_photograph, cameras), cameras, (NEAR, FAR))


def write_motorcycle(folder: Path, height: int, width: int) -> None:
    """The stereo pair as a scene folder; InputError where scikit-image is not installed."""
    try:
        from skimage.data import stereo_motorcycle
    except ImportError:
        raise InputError(
            "needs the package 'scikit-image'; pip install \"tinysplat[demo]\" brings it", where="motorcycle"
        ) from None
    photos, cameras = stereo_motorcycle()[:2], []
    for photo, cx, x in zip(photos, CX_PX, (0.0, BASELINE_M), strict=True):
        K, c2w = np.array([[FOCAL_PX, 0, cx], [0, FOCAL_PX, CY_PX], [0, 0, 1]]), np.eye(4)
        c2w[0, 3] = x
        cameras.append(Camera(K, c2w, photo.shape[1], photo.shape[0]).resized(height, width))
    folder.mkdir(parents=True, exist_ok=True)
    write_photos(folder, (resize_cover(photo, height, width) for photo in photos), cameras, (NEAR_M, FAR_M))


def _photograph(camera: Camera) -> NDArray:
    """A photo (H, W, 3) float32 in [0, 1], antialiased."""
    s, height, width = _SUPERSAMPLE, camera.height, camera.width
    colour = _trace(camera, camera.K * np.array([[s], [s], [1]]), height * s, width * s)
    return colour.reshape(height, s, width, s, 3).mean(axis=(1, 3)).astype(np.float32)


def _camera(position: float, height: int, width: int) -> Camera:
    x = SPACING * position
    angle = -x / 5  # the middle of the room lies at z = 5
    c2w = np.eye(4)
    c2w[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    c2w[:3, 3] = x, -0.1 + 0.05 * np.sin(3 * position), 0.02 * x * x
    focal = 0.9 * max(height, width)
    K = [[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]
    return Camera(np.array(K), c2w, width, height)


def _trace(camera: Camera, K: NDArray, height: int, width: int) -> NDArray:
    """Colours (H, W, 3) along the rays through pixel centres, which have z = 1 in the camera frame."""
    y, x = np.mgrid[:height, :width] + 0.5
    pixels = np.stack([x, y, np.ones_like(x)]).reshape(3, -1)
    rays = (camera.c2w[:3, :3] @ np.linalg.inv(K) @ pixels).reshape(3, height, width)
    eye = camera.centre
    hits = []  # of every thing its z and normal · light, (H, W) each
    with np.errstate(divide="ignore", invalid="ignore"):
        _, leave, _, axis_out = _slabs(eye, rays, *_WALLS)
        hits.append((leave, np.choose(axis_out, [0.8, 0.95, 0.7])))
        for box in _BOXES:
            enter, leave, axis_in, _ = _slabs(eye, rays, *box)
            hits.append((np.where(enter <= leave, enter, np.inf), np.choose(axis_in, [0.7, 0.95, 0.85])))
        hits += [_sphere(eye, rays, np.array(centre), radius) for centre, radius in _BALLS]
        depths, lights = map(np.stack, zip(*hits, strict=True))
        thing = np.where(np.isfinite(depths) & (depths > 1e-3), depths, np.inf).argmin(axis=0)[None]
    depth, light = (np.take_along_axis(values, thing, 0)[0] for values in (depths, lights))
    points = np.moveaxis(eye[:, None, None] + rays * depth, 0, -1)
    return _texture(points, thing[0]) * light[..., None]


def _slabs(eye: NDArray, rays: NDArray, low: tuple, high: tuple) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Where rays (3, H, W) enter and leave a box, and through faces of which axis."""
    a, b = ((np.array(corner) - eye)[:, None, None] / rays for corner in (low, high))
    near, far = np.minimum(a, b), np.maximum(a, b)
    return near.max(axis=0), far.min(axis=0), near.argmax(axis=0), far.argmin(axis=0)


def _sphere(eye: NDArray, rays: NDArray, centre: NDArray, radius: float) -> tuple[NDArray, NDArray]:
    """Depth (H, W) of the first hit, NaN where there is none, and how brightly it is lit (H, W)."""
    from_centre = eye - centre
    a, b = (rays * rays).sum(axis=0), np.tensordot(from_centre, rays, 1)
    depth = (-b - np.sqrt(b * b - a * (from_centre @ from_centre - radius**2))) / a
    lit = (_LIGHT @ from_centre + np.tensordot(_LIGHT, rays, 1) * depth) / radius
    return depth, np.clip(0.55 + 0.45 * lit, 0.1, 1)


def _texture(points: NDArray, thing: NDArray) -> NDArray:
    """Solid colours (H, W, 3): waves of falling amplitude, and where their sum crosses a level the colour jumps."""
    rng = np.random.default_rng(7)
    things = 1 + len(_BOXES) + len(_BALLS)
    out = np.empty(points.shape)
    frequency = 0.5 * 1.4 ** np.arange(9)  # cycles per scene unit
    directions = rng.standard_normal((9, 3))
    waves = frequency[:, None] * (directions / np.linalg.norm(directions, axis=-1, keepdims=True))
    phase = rng.uniform(0, 2 * np.pi, (things, 9))
    base, jump = rng.uniform(0.3, 0.6, (things, 3)), rng.uniform(-0.15, 0.15, (things, 3))
    swing = rng.uniform(0.06, 0.12, (things, 1)) + rng.uniform(0, 0.05, (things, 3))
    for i in range(things):
        at = thing == i
        turns = 2 * np.pi * (points[at] @ waves.T) + phase[i]
        rough = (np.sin(turns) * (frequency / frequency[0]) ** -0.7).sum(axis=-1)
        edge = np.sign(np.sin(2.2 * np.pi * points[at] @ waves[0] + phase[i, 0])) * (rough > 0.2)
        out[at] = base[i] + swing[i] * rough[:, None] + jump[i] * edge[:, None]
    return out.clip(0.02, 0.98)
