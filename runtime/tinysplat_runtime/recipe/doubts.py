"""Whether photos, cameras and depths belong together: a look before the network runs."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..scene.cameras import Camera
from ..scene.intake.nerfstudio import BLENDER_FILE, FILE
from ..scene.look import (
    LOOK_WIDTH,
    PLANES,
    UNSEEN,
    Look,
    agreed,
    look,
    look_at,
    neighbours,
    range_seen,
    thumbnail_size,
    told,
)
from ..scene.matches import Corners, corners, depths_told, fit, matched
from ..scene.resampling import resize_cover
from ..scene.scenes import Frame, Scene
from ..system.told import NOBODY, Told

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

EMPTY = (0.72, 4.0)
"""A range is far too wide where most pixels lie beyond this share of its inverse depths, and this many times as far
away as near: nothing is near `near`. Pairs of nine scenes begin at 0.6 at most, with a tenth of near nearly all at 0.8
and more; from the air some begin at 0.75, at 2.5 times near, and one room of a range stated for its whole capture at
3.1 times, where a fitting range gains nothing."""

AS_GOOD, MOST_NAMED = 1.1, 3
"""Readings that so many times as few corners fit as the best one are named beside it, up to so many: of cameras in a
row, pictures swapped, turned upside down and with inverted poses say the same."""

CLOSER = 4
"""Times the side of a thumbnail in which corners are looked for: focal lengths show in a pixel of it."""

MORE, LEAST = 1.25, 8.0
"""A reading is named that so many times as many corners fit as the cameras given, and so many more: of right cameras
of ten scenes the best has 0.92 times, of focal lengths 1.3 times too long at least 1.3."""

CONFIRMED, CONFIRMED_ALONE, MOSTLY = 100.0, 30.0, 1 / 3
"""Where so many corners fit, of all photos or of one, and this share of those in common, cameras are right, however
few pixels tell their depth. Of right ones of ten scenes 0.4 to 0.97 fit, by chance one or two of a hundred."""

TELLING, INSIDE = 30, 0.5
"""So many corners that tell their depth say whether a range is right: it holds this share of their depths or more."""

MANY, ASTRAY = 120, 0.15
"""Cameras are wrong of which photos have so many corners in common, of which less than this share fits. Of right ones
of 24 scenes at least 0.39 of 100 and more fit; up to 59 are found that are none, where photos share nothing."""

ROLLS = (-20, -10, -5, 5, 10, 20, 90, 180, 270)
"""Degrees by which one pose may be rolled."""

STEP, STEPS = 1.15, 8
"""Focal lengths are tried in such steps, so many up and down."""

TOLD = 0.27
"""Share of pixels that two photos tell one depth for, below which a photo may be alone: see `look.told`. Right cameras
have 0.1 to 0.6 of them."""

ALONE = (0.2, 0.32)
"""A photo is named where pairs of others have at least the first, and its own at most the second times as many."""

APART = 0.5
"""The second for a photo whose colours are suspected already, the first being the median of those nearest to it: half
of its own depths are found by them at most."""

READ = 4
"""Photos that are looked at for each reading of the cameras."""

FEW = 12
"""Photos whose corners are looked at, and of which each pair of near ones is for one that is alone."""

STRAIGHT = 0.01
"""Skew over focal length that pixels of no camera have."""

SHRUNK = 0.4
"""Of a photo's width and height: without distortion no less is left of one that a lens took."""

CENTRAL = (0.1, 0.9)
"""Where in a photo's width and height its principal point lies, even of one that was cut out of another."""

UNITS = (1000.0, 100.0, 10.0, 0.1, 0.01, 0.001)


@dataclass(frozen=True, eq=False)
class _Thumbnails:
    """A scene in small: photos (V, H, W, 3), their cameras and names, depths (P,), and how photos agree about them.

    An estimated range is in units of the poses and as wide as photos agree about, so nothing is said against it.
    """

    frames: tuple[Frame, ...]
    images: NDArray
    cameras: Sequence[Camera]
    names: tuple[str, ...]
    depths: NDArray
    looks: list[Look]
    corners: dict[int, Corners]
    is_estimated: bool
    are_opengl: bool = False

    @classmethod
    def of(cls, scene: Scene, told: Told) -> _Thumbnails:
        first = scene.cameras[0]
        small = scene.resized(*thumbnail_size(first))
        height, width = thumbnail_size(first, CLOSER * LOOK_WIDTH)
        closer = tuple(frame.resized(height, width) for frame in scene.frames)  # read once, and not kept
        scene.check_one_size()
        count = len(closer)
        looked = set(np.linspace(0, count - 1, min(count, FEW)).round().astype(int).tolist())
        images, corners_of = [], {}
        frames = list(zip(scene.frames, closer, small.cameras, strict=True))
        for v, (frame, close, target) in enumerate(told.progress("checking", frames)):
            photo, camera = None, frame.camera
            if frame.kept == [] and camera.height >= height and camera.width >= width:
                photo = frame.photo((camera.height, camera.width))
                frame.image(photo)  # is kept: the network will have it
            image = close.image(photo)
            images.append(resize_cover(image, target.height, target.width))
            if v in looked:
                corners_of[v] = corners(image)
        near, far = scene.depth_range()
        depths = 1 / np.linspace(1 / near, 1 / far, PLANES)
        names = tuple(f"photo {v + 1} ({frame.path.name})" for v, frame in enumerate(scene.frames))
        are_opengl = any((scene.path / name).is_file() for name in (FILE, BLENDER_FILE))
        looks = look(np.stack(images), small.cameras, depths)
        cameras = small.cameras
        return cls(closer, np.stack(images), cameras, names, depths, looks, corners_of, scene.is_estimated, are_opengl)

    @cached_property
    def closer(self) -> dict[int, Camera]:
        """The cameras of photos whose corners are known, in pixels of these."""
        return {v: self.frames[v].camera for v in sorted(self.corners)}

    @cached_property
    def places(self) -> dict[tuple[int, int], NDArray]:
        """What pairs of near photos have in common; see `matched`."""
        views = list(self.closer)
        beside = neighbours([*self.closer.values()])[:, :3].tolist()
        pairs = {(min(v, views[u]), max(v, views[u])) for v, us in zip(views, beside, strict=True) for u in us}
        return {(v, u): matched(self.corners[v], self.corners[u]) for v, u in sorted(pairs)}

    @cached_property
    def shares(self) -> dict[tuple[int, int], float]:
        """How many of these fit the cameras as given."""
        return {(v, u): fit(places, self.closer[v], self.closer[u]) for (v, u), places in self.places.items()}

    @cached_property
    def confirmed(self) -> bool:
        """Whether corners of the photos agree with the cameras as given."""
        return self.confirms(list(self.places), CONFIRMED)

    def confirm(self, view: int) -> bool:
        """Whether those that a photo has in common with others do."""
        return self.confirms([pair for pair in self.places if view in pair], CONFIRMED_ALONE)

    def confirms(self, pairs: Sequence[tuple[int, int]], least: float) -> bool:
        """Whether those of some pairs do."""
        fits = sum(self.shares[pair] for pair in pairs)
        return fits > max(least, MOSTLY * sum(len(self.places[pair]) for pair in pairs))

    @cached_property
    def corner_depths(self) -> NDArray:
        """Depths (N,) that corners tell, where these agree with the cameras."""
        if not self.confirmed:
            return np.empty(0)
        cameras = self.closer
        return np.concatenate([depths_told(places, cameras[v], cameras[u]) for (v, u), places in self.places.items()])


def doubts(scene: Scene, told: Told = NOBODY) -> list[str]:
    """What is likely wrong with a scene, a line each: its cameras, a photo, its depth range; the likeliest first.

    Args:
        scene: the photos as the network will have them.
        told: is told of each photo.
    """
    seen = _Thumbnails.of(scene, told)
    return (
        _useless(seen)
        or _impossible(seen)
        or _misread(seen)
        or _misplaced(seen)
        or _alone(seen)
        or _range_of_corners(seen)
        or _units(seen)
        or _odd(seen)
        or _range_doubts(seen)
    )


def _impossible(seen: _Thumbnails) -> list[str]:
    """Intrinsics that no photo has."""
    for name, camera, frame in zip(seen.names, seen.cameras, seen.frames, strict=True):
        if frame.lens is not None:
            pinhole = frame.lens.camera(np.eye(4))
            if pinhole.width < SHRUNK * frame.lens.width or pinhole.height < SHRUNK * frame.lens.height:
                sizes = f"{frame.lens.width}x{frame.lens.height} to {pinhole.width}x{pinhole.height}"
                return [f"{name}: its distortion (k1, k2, …) shrinks it from {sizes} pixels, as that of no lens does"]
        skew = camera.K[0, 1] / camera.K[0, 0]
        if text := _off_centre(camera):
            return [f"{name}: {text}"]
        if abs(skew) > STRAIGHT:
            fault = f"K has a skew of {skew:.0%} of the focal length, which photos do not have: K[0][1] is 0"
            return [f"{name}: {fault}"]
    return []


def _range_of_corners(seen: _Thumbnails) -> list[str]:
    """A range that most corners lie outside of."""
    if seen.is_estimated or len(seen.corner_depths) < TELLING:
        return []
    near, far = seen.depths[0], seen.depths[-1]

    def inside(unit: float) -> float:
        return float(((near <= unit * seen.corner_depths) & (unit * seen.corner_depths <= far)).mean())

    if inside(1.0) >= INSIDE:
        return []
    if len(better := [unit for unit in UNITS if inside(unit) >= INSIDE]) == 1:
        return [_other_units(better[0])]
    return [_other_range(near, far, *np.percentile(seen.corner_depths, (2, 98)))]


def _other_units(unit: float) -> str:
    return f"translations are in other units than near and far: times {unit:g}, photos agree far better"


def _other_range(near: float, far: float, low: float, high: float) -> str:
    range_ = f"near {near:g} and far {far:g} are not where the cameras say that things are"
    return f"{range_}: photos agree about depths from {low:.3g} to {high:.3g}; --near and --far say so"


def _units(seen: _Thumbnails) -> list[str]:
    """Poses whose thumbnails agree much better in other units, or that have nothing in common."""
    if seen.confirmed:
        return []
    views = np.linspace(0, len(seen.cameras) - 1, min(len(seen.cameras), READ)).round().astype(int).tolist()
    given = float(np.mean([seen.looks[v].cost for v in views]))
    if given < SUSPICIOUS:
        return []
    costs = {}
    for unit in () if seen.is_estimated else UNITS:
        cameras = [_scaled(camera, unit) for camera in seen.cameras]
        costs[unit] = float(np.mean([one.cost for one in look(seen.images, cameras, seen.depths, views)]))
    better = sorted((unit for unit in costs if costs[unit] < BETTER * given), key=lambda unit: costs[unit])
    if better:
        with contextlib.suppress(InputError):  # photos that agree about no depths at all
            low, high = range_seen(seen.images, seen.cameras)
            near, far = seen.depths[0], seen.depths[-1]
            if low < far and high > near:
                return []
            if len(better) > 1:
                return [_other_range(near, far, low, high)]
        return [_other_units(better[0])]
    if given > 0.97 * UNSEEN:
        fault = f"no photo shows what another does between near {seen.depths[0]:g} and far {seen.depths[-1]:g}"
        return [f"{fault}: the cameras look different ways, or the poses are wrong; --views takes photos that overlap"]
    return []


def _alone(seen: _Thumbnails) -> list[str]:
    """Of three photos to `FEW`, the one that has hardly anything in common with any, where the others have much."""
    count = len(seen.cameras)
    if not 3 <= count <= FEW or min(look.clear.mean() for look in seen.looks) >= TOLD:
        return []
    beside = neighbours(seen.cameras)[:, :2].tolist()
    pairs = sorted({(min(v, u), max(v, u)) for v in range(count) for u in beside[v]})
    images = _even(seen.images)
    shares = dict(zip(pairs, told(images, seen.cameras, pairs, seen.depths), strict=True))

    def most(v: int, without: int = -1) -> float:
        return max((share for pair, share in shares.items() if v in pair and without not in pair), default=0.0)

    rest = [min(most(u, v) for u in range(count) if u != v) for v in range(count)]
    v = min(range(count), key=lambda v: most(v) / max(rest[v], 1e-6))
    if rest[v] < ALONE[0] or most(v) > ALONE[1] * rest[v] or seen.confirm(v):
        return []
    for step in (1, -1):  # where each photo is its neighbour's, most match still
        rolled = dict(zip(pairs, told(np.roll(images, step, axis=0), seen.cameras, pairs, seen.depths), strict=True))
        if min(max(share for pair, share in rolled.items() if u in pair) for u in range(count)) > ALONE[1] * rest[v]:
            return []
    cause = "turned, mirrored, of another scene or moment, or its pose is wrong"
    return [f"{seen.names[v]} hardly matches the others, which match each other well: {cause}; --views leaves it out"]


def _misread(seen: _Thumbnails) -> list[str]:
    """A reading of cameras, or of one photo, that far more of the photos' common corners fit."""
    cameras, places, shares = seen.closer, seen.places, seen.shares
    given = sum(shares.values())

    def share(v: int) -> float:
        own = [pair for pair in places if v in pair]
        return sum(shares[pair] for pair in own) / max(1, sum(len(places[pair]) for pair in own))

    odd = min(cameras, key=share) if len(cameras) > 2 else -1
    around, beside = ([pair for pair in places if (odd in pair) is with_it] for with_it in (True, False))
    rest = sum(shares[pair] for pair in beside)
    scores: dict[str, float] = {}
    for text, read in _readings(seen, cameras):
        kept = sum(fit(places[v, u], read(v), read(u)) for v, u in beside)
        if kept >= rest:  # else it goes with one photo, at the others' cost
            scores[text] = kept + sum(fit(places[v, u], read(v), read(u)) for v, u in around)
    if len(cameras) > 2:
        for text, its, camera in _single(seen, odd):
            known, read_as = {**seen.corners, odd: its}, {**cameras, odd: camera}
            both = places if its is seen.corners[odd] else {(v, u): matched(known[v], known[u]) for v, u in around}
            scores[text] = rest + sum(fit(both[v, u], read_as[v], read_as[u]) for v, u in around)
    most = max(scores.values(), default=0.0)
    if most < max(MORE * given, given + LEAST):
        return []
    best: dict[str, str] = {}  # of each cause the reading that fits best
    for text in sorted(scores, key=lambda text: -scores[text]):
        if AS_GOOD * scores[text] > most:
            best.setdefault(text.split(": ")[0], text)
    return [f"{'; or '.join([*best.values()][:MOST_NAMED])}, photos agree far better"]


def _misplaced(seen: _Thumbnails) -> list[str]:
    """Photos that have much in common, of which hardly anything lies where cameras allow; one of them, if others fit.

    Where a camera moved along the lines that others' corners lie on, this is seen in some of its pairs alone.
    """

    def share(pairs: Sequence[tuple[int, int]]) -> float:
        return sum(seen.shares[pair] for pair in pairs) / max(1, sum(len(seen.places[pair]) for pair in pairs))

    rich = [pair for pair, places in seen.places.items() if len(places) >= MANY]
    astray = [pair for pair in rich if share([pair]) < ASTRAY]
    if not astray:
        return []
    v = min({v for pair in astray for v in pair}, key=lambda v: share([pair for pair in rich if v in pair]))
    if seen.confirms([pair for pair in seen.places if v not in pair], CONFIRMED_ALONE):
        fault = "has much in common with others, but not where the cameras say"
        return [f"{seen.names[v]} {fault}: its pose or focal length is wrong; --views leaves it out"]
    one, other = (seen.names[v] for v in astray[0])
    return [f"{one} and {other} have much in common, but not where the cameras say: poses or focal lengths are wrong"]


def _readings(seen: _Thumbnails, cameras: dict[int, Camera]) -> Iterator[tuple[str, Callable[[int], Camera]]]:
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
    for step in (*range(-STEPS, 0), *range(1, STEPS + 1)):
        factor = STEP**step
        yield f"focal lengths are off, or of another size of photo: times {factor:.2g}", each(_zoomed, factor, factor)
        yield f"fx does not go with fy: fx times {factor:.2g}", each(_zoomed, factor, 1.0)
    if any(abs(c.K[0, 2] - c.K[1, 2]) > 0.02 * c.width for c in cameras.values()):
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


def _single(seen: _Thumbnails, view: int) -> Iterator[tuple[str, Corners, Camera]]:
    """Other ways to read one photo, with its corners and camera."""
    name, camera, own = seen.names[view], seen.frames[view].camera, seen.corners[view]
    image = seen.frames[view].image()
    yield f"{name} is mirrored: with left for right", corners(image[:, ::-1]), camera
    yield f"{name} is upside down: turned by 180 degrees", corners(image[::-1, ::-1]), camera
    yield f"{name} is a negative: with its colours inverted", Corners(own.places, -own.looks), camera
    for degrees in ROLLS:
        yield f"the pose of {name} is rolled: by {-degrees} degrees", own, _rolled(camera, degrees)


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
    lines = [f"{seen.names[v]} is of one colour, which shows nothing to find depth by" for v in plain]
    for v, image in enumerate(seen.images):
        twin = next((u for u in range(v) if np.array_equal(seen.images[u], image)), None)
        if twin is not None and v not in plain:
            lines.append(f"{seen.names[v]} is the same picture as {seen.names[twin]}, from another place")
    return lines


def _odd(seen: _Thumbnails) -> list[str]:
    """Of three photos and more, those that match none of the others as these match each other."""
    if len(seen.cameras) < 3 or max(look.cost for look in seen.looks) < ODD[0]:
        return []
    costs = np.array([look.cost for look in seen.looks])
    looked = [v for v in costs.argsort()[::-1][:ODD_LOOKED].tolist() if costs[v] >= ODD[0]]
    for v in looked:
        costs[v] = _least_cost(seen, v)
    return [
        f"{seen.names[v]} hardly matches the others: too little overlap, a wrong pose, another scene or moment"
        for v in sorted(looked)
        if costs[v] >= max(ODD[0], ODD[1] * float(np.median(np.delete(costs, v))))
        and not seen.confirm(v)
        and _is_apart(seen, v)
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
        if seen.confirmed:
            return []  # most overlap too little for a depth, but what they have in common is where cameras say
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
    nearest = enumerate(neighbours(cameras)[:, 0])
    alike = max(agreed(looks[v], cameras[v], looks[u], cameras[u]) for v, u in nearest)
    return alike >= ALIKE and max(look.clear.mean() for look in looks) >= HARDLY


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


def _scaled(camera: Camera, factor: float) -> Camera:
    c2w = camera.c2w.copy()
    c2w[:3, 3] *= factor
    try:
        return replace(camera, c2w=c2w)
    except InputError:  # beyond what a camera may have
        return camera
