"""Whether photos, cameras and depths belong together: a look before the network runs."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..scene.cameras import Camera
from ..scene.intake.nerfstudio import BLENDER_FILE, FILE
from ..scene.look import (
    PLANES,
    UNSEEN,
    Look,
    agreed,
    look,
    look_at,
    nearest,
    neighbours,
    range_seen,
    thumbnail_size,
    told,
)
from ..scene.scenes import Scene
from ..system.progress import Show, plain

SUSPICIOUS = 0.08
"""Cost of a look from which on other readings of the cameras are tried; real scenes lie at 0.03 to 0.13."""

BETTER = 0.75
"""A reading is named as the likely one where its cost is below this share of the cost as given."""

BLANK = 4 / 255
"""A thumbnail whose brightness spans less shows nothing."""

ODD = (0.1, 1.7)
"""A photo is suspected whose cost, at the best of three others, is at least the first, and the second times the median
of the rest. On ten scenes of four and six photos: 0.03 to 0.14, and 0.1 to 0.25 where one is another scene's or black.
"""

ODD_LOOKED = 4
"""Photos that are held against others for it, those of the highest cost."""

HARDLY = 0.1
"""Share of pixels that tell their depth: of all photos less than this, and they hardly match anywhere. Where two have
less in common, they say nothing against a third."""

ALIKE = 0.25
"""Photos do not match of whose pixels less than this share have one depth from both sides. Pairs of nine scenes have
0.26 to 0.73; where one photo is another scene's, nine of ten have less."""

EMPTY = (0.72, 3.0)
"""A range is far too wide where most pixels lie beyond this share of its inverse depths, and this many times as far
away as near: nothing is near `near`. Pairs of nine scenes begin at 0.6 at most, with a tenth of near nearly all at 0.8
and more; from the air some begin at 0.75, at 2.5 times near."""

NEARLY = 0.8
"""The same of focal lengths, whose faults nearer and farther depths make up for in part."""

AS_GOOD, MOST_NAMED = 1.08, 3
"""Readings whose cost is at most so many times the best one's are named beside it, up to so many: of cameras in a row,
pictures swapped, turned upside down and with inverted poses say the same."""

TOLD, TOLD_TURNED = 0.27, 0.45
"""Share of pixels that two photos tell one depth for, below which other readings are tried: see `look.told`. Right
cameras have 0.1 to 0.6 of them, wrong ones mostly half as many. Below the second photos mirrored or turned are, of
which right cameras find far fewer pixels."""

MORE, MORE_ZOOMED = 1.45, 2.0
"""A reading is named that has so many times as many; of longer focal lengths, which find more, the second, ..."""

LEAST_TOLD = 0.06
"""... and at least so many."""

ALONE = (0.2, 0.32)
"""A photo is named where pairs of others have at least the first, and its own at most the second times as many."""

APART = 0.5
"""The second for a photo whose colours are suspected already, the first being the median of those nearest to it: half
of its own depths are found by them at most."""

READ = 4
"""Photos that are looked at for each reading of the cameras."""

FEW = 12
"""Photos of which each pair of near ones is looked at for one that is alone."""

STRAIGHT = 0.01
"""Skew over focal length that pixels of no camera have."""

FOCAL_FACTORS = (0.5, 2 / 3, 1.5, 2.0)

CENTRAL = (0.1, 0.9)
"""Where in a photo's width and height its principal point lies, even of one that was cut out of another."""

OTHER_UNITS = "translations are in other units"
UNITS = (1000.0, 100.0, 10.0, 0.1, 0.01, 0.001)


@dataclass(frozen=True, eq=False)
class _Thumbnails:
    """A scene in small: photos (V, H, W, 3), their cameras and names, depths (P,), and how photos agree about them.

    An estimated range is in units of the poses and as wide as photos agree about, so nothing is said against it.
    """

    images: NDArray
    cameras: Sequence[Camera]
    names: tuple[str, ...]
    depths: NDArray
    looks: list[Look]
    is_estimated: bool
    are_opengl: bool = False

    @classmethod
    def of(cls, scene: Scene, show: Show) -> _Thumbnails:
        small = scene.resized(*thumbnail_size(scene.cameras[0]))
        near, far = scene.depth_range()
        depths = 1 / np.linspace(1 / near, 1 / far, PLANES)
        images, cameras = small.images(show=show), small.cameras
        names = tuple(f"photo {v + 1} ({frame.path.name})" for v, frame in enumerate(scene.frames))
        are_opengl = any((scene.path / name).is_file() for name in (FILE, BLENDER_FILE))
        return cls(images, cameras, names, depths, look(images, cameras, depths), scene.is_estimated, are_opengl)


def doubts(scene: Scene, show: Show = plain) -> list[str]:
    """What is likely wrong with a scene, a line each: its cameras, a photo, its depth range; the likeliest first.

    Args:
        scene: the photos as the network will have them.
        show: is given a photo at a time.
    """
    seen = _Thumbnails.of(scene, show)
    return _useless(seen) or _alone(seen) or _camera_fault(seen) or _misread(seen) or _odd(seen) or _range_doubts(seen)


def _camera_fault(seen: _Thumbnails) -> list[str]:
    """Photos whose thumbnails agree much better once the cameras are read in another way were given in that way."""
    views = np.linspace(0, len(seen.cameras) - 1, min(len(seen.cameras), READ)).round().astype(int).tolist()
    given = float(np.mean([seen.looks[v].cost for v in views]))
    border = [f"{name}: {text}" for name, text in zip(seen.names, map(_off_centre, seen.cameras), strict=True) if text]
    if border:
        return border[:1]
    if given < SUSPICIOUS:
        return []

    def cost(images: NDArray, cameras: Sequence[Camera], depths: NDArray) -> float:
        return float(np.mean([one.cost for one in look(images, cameras, depths, views)]))

    shares = {}
    for reading in _readings(seen):
        found = cost(reading.images, reading.cameras, seen.depths)
        share = found / (reading.better * given)
        if share < 1 and reading.zoom:  # which depths nearer or farther by as much may explain as well
            share = max(share, found / (reading.better * cost(seen.images, seen.cameras, seen.depths / reading.zoom)))
        shares[reading.text] = share
    best = sorted(
        (text for text in shares if shares[text] < min(1, AS_GOOD * min(shares.values()))),
        key=lambda text: shares[text],
    )
    if len(best) > 1 and best[0].startswith(OTHER_UNITS) and best[1].startswith(OTHER_UNITS):
        with contextlib.suppress(InputError):  # photos that agree about no depths at all
            low, high = range_seen(seen.images, seen.cameras)
            both = f"near {seen.depths[0]:g} and far {seen.depths[-1]:g} are not in units of the poses"
            return [f"{both}: photos agree about depths from {low:.3g} to {high:.3g}; --near and --far say so"]
    if best:
        return [f"{'; or '.join(best[:MOST_NAMED])}, photos agree far better"]
    if given > 0.97 * UNSEEN:
        return ["the cameras stand back to back: no photo shows what another does between near and far"]
    return []


def _alone(seen: _Thumbnails) -> list[str]:
    """Of three photos to `FEW`, the one that has hardly anything in common with any, where the others have much."""
    count = len(seen.cameras)
    if not 3 <= count <= FEW or min(found.clear.mean() for found in seen.looks) >= TOLD:
        return []
    beside = neighbours(seen.cameras)[:, :2].tolist()
    pairs = sorted({(min(v, u), max(v, u)) for v in range(count) for u in beside[v]})
    images = _even(seen.images)
    shares = dict(zip(pairs, told(images, seen.cameras, pairs, seen.depths), strict=True))

    def most(v: int, without: int = -1) -> float:
        return max((share for pair, share in shares.items() if v in pair and without not in pair), default=0.0)

    rest = [min(most(u, v) for u in range(count) if u != v) for v in range(count)]
    v = min(range(count), key=lambda v: most(v) / max(rest[v], 1e-6))
    if rest[v] < ALONE[0] or most(v) > ALONE[1] * rest[v]:
        return []
    for step in (1, -1):  # where each photo is its neighbour's, most match still
        rolled = dict(zip(pairs, told(np.roll(images, step, axis=0), seen.cameras, pairs, seen.depths), strict=True))
        if min(max(share for pair, share in rolled.items() if u in pair) for u in range(count)) > ALONE[1] * rest[v]:
            return []
    cause = "turned, mirrored, of another scene or moment, or its pose is wrong"
    return [f"{seen.names[v]} hardly matches the others, which match each other well: {cause}; --views leaves it out"]


def _misread(seen: _Thumbnails) -> list[str]:
    """A reading of intrinsics, poses or photos with which far more pixels have one depth from both sides."""
    cameras = seen.cameras
    skewed = next((v for v, c in enumerate(cameras) if abs(c.K[0, 1]) > STRAIGHT * c.K[0, 0]), None)
    if skewed is not None:
        K = cameras[skewed].K
        skew = f"K has a skew of {K[0, 1] / K[0, 0]:.0%} of the focal length, which photos do not have: K[0][1] is 0"
        return [f"{seen.names[skewed]}: {skew}"]
    pairs = sorted({(min(v, u), max(v, u)) for v, u in enumerate(nearest(cameras))})
    pairs = pairs[:: max(1, len(pairs) // 2)][:2]

    def share(images: NDArray, cameras: Sequence[Camera], depths: NDArray) -> float:
        return float(np.mean(told(np.ascontiguousarray(images), cameras, pairs, depths)))

    given = share(seen.images, cameras, seen.depths)
    if given >= TOLD_TURNED:
        return []
    readings = [one for one in _turned(seen) if given < TOLD or not one.zoom]
    shares = {one: share(one.images, one.cameras, seen.depths) for one in readings}
    best = max(shares, key=lambda one: shares[one])
    more = MORE_ZOOMED if best.zoom > 1 else MORE
    if best.zoom and shares[best] > more * given:  # which depths nearer or farther by as much may explain as well
        given = max(given, share(seen.images, cameras, seen.depths / best.zoom))
    return [f"{best.text}, photos agree far better"] if shares[best] > max(LEAST_TOLD, more * given) else []


@dataclass(frozen=True, eq=False)
class _Reading:
    """Photos and cameras read in another way.

    Attributes:
        text: what that says.
        images, cameras: as read.
        better: below which share of the cost as given it is taken for the right one.
        zoom: by which focal lengths differ, 0 where they do not.
    """

    text: str
    images: NDArray
    cameras: Sequence[Camera]
    better: float = BETTER
    zoom: float = 0.0


def _readings(seen: _Thumbnails) -> Iterator[_Reading]:
    """Other ways to read poses, intrinsics, and which photo is whose."""
    images, cameras = seen.images, seen.cameras
    yield _Reading("c2w holds world-to-camera matrices (w2c): with their inverses", images, [*map(_inverse, cameras)])
    axes = "c2w has OpenGL axes (y up, z backward) where OpenCV's are expected: with y and z turned"
    if seen.are_opengl:
        axes = "transform_matrix has OpenCV axes (y down, z forward) where OpenGL's are expected: with y and z turned"
    yield _Reading(axes, images, [*map(_flipped, cameras)])
    for unit in () if seen.is_estimated else UNITS:
        text = f"{OTHER_UNITS} than near and far: times {unit:g}"
        yield _Reading(text, images, [_scaled(camera, unit) for camera in cameras])
    for factor in FOCAL_FACTORS:
        text = f"focal lengths are off, or of another size of photo: times {factor:g}"
        yield _Reading(text, images, [_zoomed(camera, factor) for camera in cameras], NEARLY, factor)
    swapped = "swapped (left for right?)" if len(cameras) == 2 else "in the reverse order of their cameras"
    yield _Reading(f"photos are {swapped}: exchanged", images[::-1], cameras)
    if len(cameras) > 2:
        yield _Reading("photos belong to the next camera: each moved by one", np.roll(images, 1, axis=0), cameras)
        yield _Reading("photos belong to the camera before: each moved by one", np.roll(images, -1, axis=0), cameras)
    upside = "photos are upside down, by their Exif orientation or for want of it: turned by 180 degrees"
    yield _Reading(upside, images[:, ::-1, ::-1], cameras)
    if images.shape[1] == images.shape[2]:
        for turns, way in ((1, "left"), (3, "right")):
            text = f"photos lie on their side, by their Exif orientation or for want of it: turned to the {way}"
            yield _Reading(text, np.rot90(images, turns, axes=(1, 2)), cameras)


def _turned(seen: _Thumbnails) -> Iterator[_Reading]:
    """What `_misread` tries."""
    images, cameras = seen.images, seen.cameras
    mirrored = "photos are mirrored, or the world of the cameras is: with left for right"
    yield _Reading(mirrored, np.ascontiguousarray(images[:, :, ::-1]), cameras)
    for degrees, way in ((90, "right"), (-90, "left"), (180, "upside down")):
        text = f"photos are turned against their poses, or poses rolled: with photos turned {way}"
        yield _Reading(text, images, [_rolled(camera, degrees) for camera in cameras])
    for factor in (0.5, 1 / 1.3, 1.3, 2.0):
        text = f"focal lengths are off, or of another size of photo: times {factor:.2g}"
        yield _Reading(text, images, [_zoomed(camera, factor) for camera in cameras], zoom=factor)
    for factor in (2 / 3, 1.5):
        text = f"fx does not go with fy: fx times {factor:.2g}"
        yield _Reading(text, images, [_stretched(camera, factor) for camera in cameras], zoom=factor)
    if any(abs(c.K[0, 2] - c.K[1, 2]) > 0.02 * c.width for c in cameras):
        yield _Reading("cx and cy are swapped: exchanged", images, [_swapped(camera) for camera in cameras])


def _off_centre(camera: Camera) -> str:
    """What to say of a principal point that no photo has, which lies at the border or beyond."""
    x, y = camera.K[0, 2] / camera.width, camera.K[1, 2] / camera.height
    low, high = CENTRAL
    if low <= x <= high and low <= y <= high:
        return ""
    place = f"({100 * x:.0f} %, {100 * y:.0f} %) of width and height"
    return f"K's principal point lies at {place}, where it is near (50 %, 50 %): of another size of photo, or missing"


def _useless(seen: _Thumbnails) -> list[str]:
    """Photos of one colour, and the same photo given twice."""
    plain = [v for v, image in enumerate(seen.images) if np.ptp(image.mean(axis=-1)) < BLANK]
    found = [f"{seen.names[v]} is of one colour, which shows nothing to find depth by" for v in plain]
    for v, image in enumerate(seen.images):
        twin = next((u for u in range(v) if np.array_equal(seen.images[u], image)), None)
        if twin is not None and v not in plain:
            found.append(f"{seen.names[v]} is the same picture as {seen.names[twin]}, from another place")
    return found


def _odd(seen: _Thumbnails) -> list[str]:
    """Of three photos and more, those that match none of the others as these match each other."""
    if len(seen.cameras) < 3 or max(found.cost for found in seen.looks) < ODD[0]:
        return []
    costs = np.array([found.cost for found in seen.looks])
    looked = [v for v in costs.argsort()[::-1][:ODD_LOOKED].tolist() if costs[v] >= ODD[0]]
    for v in looked:
        costs[v] = _least_cost(seen, v)
    return [
        f"{seen.names[v]} hardly matches the others: too little overlap, a wrong pose, another scene or moment"
        for v in sorted(looked)
        if costs[v] >= max(ODD[0], ODD[1] * float(np.median(np.delete(costs, v)))) and _is_apart(seen, v)
    ]


def _least_cost(seen: _Thumbnails, view: int) -> float:
    """Of a photo at the three taken nearest to it, as they are and of one brightness."""
    return min(
        look_at(images[view], seen.cameras[view], images[other], seen.cameras[other], seen.depths).cost
        for images in (seen.images, _even(seen.images))
        for other in neighbours(seen.cameras)[view, :3].tolist()
    )


def _is_apart(seen: _Thumbnails, view: int) -> bool:
    """Whether a photo has far less in common with the three nearest to it than these have with others.

    Where they have little themselves, right cameras look alike.
    """
    images, beside = _even(seen.images), neighbours(seen.cameras).tolist()

    def most(v: int, others: Sequence[int]) -> float:
        return max(told(images, seen.cameras, [(v, u) for u in others], seen.depths))

    rest = [most(u, [w for w in beside[u] if w != view][:2]) for u in beside[view][:3]]
    usual = float(np.median(rest))
    return min(rest) >= HARDLY and usual >= ALONE[0] and most(view, beside[view][:3]) <= APART * usual


def _even(images: NDArray) -> NDArray:
    """Photos (V, H, W, 3) brought to their mean brightness, by factors of two at most."""
    level = images.mean(axis=(1, 2, 3), keepdims=True)
    return images * np.clip(level.mean() / level.clip(1e-3), 0.5, 2)


def _range_doubts(seen: _Thumbnails) -> list[str]:
    """A depth range in which nothing matches, or one that the scene fills a small part of."""
    near, far = seen.depths[0], seen.depths[-1]
    if np.ptp([camera.centre for camera in seen.cameras], axis=0).max() <= 1e-6 * near:
        return []  # no range would do from one place, which the network refuses in words of its own
    looks = seen.looks
    if not _match(seen, looks):
        looks = look(_even(seen.images), seen.cameras, seen.depths)
    if not _match(seen, looks):
        who = " and ".join(seen.names) if len(seen.names) == 2 else "the photos"
        wrong = "the poses or the photos" if seen.is_estimated else "near and far, the poses or the photos"
        range_ = f"at any depth from {near:g} to {far:g}"
        return [f"{who} do not match {range_}: they overlap too little, or {wrong} are wrong"]
    if seen.is_estimated:
        return []
    low, high = np.percentile(np.concatenate([found.costs.argmin(axis=0)[found.clear] for found in looks]), (10, 90))
    shown = seen.depths[round(low)], seen.depths[round(high)]
    if low < EMPTY[0] * (PLANES - 1) or shown[0] < EMPTY[1] * near:
        return []
    extent = f"{shown[0]:.3g} to {shown[1]:.3g}"
    return [f"near {near:g} and far {far:g} reach far beyond what the photos show, most of it from {extent}"]


def _match(seen: _Thumbnails, looks: Sequence[Look]) -> bool:
    """Whether pixels tell their depth, and any photo most often the depth that the one nearest to it has, too."""
    cameras = seen.cameras
    alike = max(agreed(looks[v], cameras[v], looks[u], cameras[u]) for v, u in enumerate(nearest(cameras)))
    return alike >= ALIKE and max(found.clear.mean() for found in looks) >= HARDLY


def _inverse(camera: Camera) -> Camera:
    return Camera(camera.K, camera.w2c, camera.width, camera.height)


def _flipped(camera: Camera) -> Camera:
    return Camera(camera.K, camera.c2w @ np.diag([1.0, -1.0, -1.0, 1.0]), camera.width, camera.height)


def _zoomed(camera: Camera, factor: float) -> Camera:
    K = camera.K.copy()
    K[:2, :2] *= factor
    return Camera(K, camera.c2w, camera.width, camera.height)


def _stretched(camera: Camera, factor: float) -> Camera:
    K = camera.K.copy()
    K[0, 0] *= factor
    return Camera(K, camera.c2w, camera.width, camera.height)


def _swapped(camera: Camera) -> Camera:
    K = camera.K.copy()
    K[0, 2], K[1, 2] = camera.K[1, 2], camera.K[0, 2]
    return Camera(K, camera.c2w, camera.width, camera.height)


def _rolled(camera: Camera, degrees: float) -> Camera:
    turn = np.eye(4)
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn[:2, :2] = [[cos, -sin], [sin, cos]]
    return Camera(camera.K, camera.c2w @ turn, camera.width, camera.height)


def _scaled(camera: Camera, factor: float) -> Camera:
    c2w = camera.c2w.copy()
    c2w[:3, 3] *= factor
    try:
        return Camera(camera.K, c2w, camera.width, camera.height)
    except InputError:  # beyond what a camera may have
        return camera
