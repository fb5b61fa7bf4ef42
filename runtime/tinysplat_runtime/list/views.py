"""Views that a list is looked at from: where its photos were taken if that is known, else from all sides, far and near,
and from within rooms.

Some views decide what is left out; others, beside them, whether what is left is merged and corrected, and what all of
that costs.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import Gaussians
from ..render import DEFINITION, Renderer
from ..render.paths import between, looking_along, orbit
from ..render.renderer import NEAR_PLANE
from ..scene.cameras import Camera
from ..scene.neighbours import spread, view_places
from ..system.evenly import evenly
from .evenness import is_uneven, sizes_about

SIDE = 384
"""Pixels of a view's sides; views of photos have as many pixels at most."""

FAR, NEAR = 1.2, 2.0
"""Distances of the outer views: far ones from the middle of the bulk, in its diagonals; near ones from the median, in
median distances from it. About a captured place, which thins out towards the distance, the latter are much less."""

NEAR_EVERY = 4
"""One of so many outer views is a near one."""

STEEPEST = 0.7
"""Sine of the largest angle that outer views look up or down by."""

OPEN, CLOSED = 0.2, 0.75
"""A scene is a room where, from its middle, so far (in diagonals) nothing stands in most directions, and something
beyond in this share of them."""

FARTHEST = 1e12
"""Scene units from the origin, and across, that cameras are put at."""

COUNT, JUDGES = 20, 12
"""Views about a scene that decide, and views that judge."""

MOST, MOST_DECIDING = 32, 48
"""Photos' cameras that decide, of more as many that lie far from one another; and with views halfway between them."""

PARTNERS = 2
"""Nearest cameras of each, on the way to which further views lie."""

LONGEST_TAIL = 1.8
"""Of an object, 999 of 1,000 Gaussians lie within so many times the distance of nine in ten from its middle. Trained
objects have 1.2 to 1.5, trained places 2.1 and more, until they are cut.
"""

OUTER, MOST_COVERED = 8, 0.36
"""Views from outside, of which an object covers this share at most: trained ones 0.15 to 0.31, a ball 0.22, a cube up
to 0.4; trained places 0.54 to 0.94, and cut to a box 0.4 and more, but for the emptiest.
"""

LEAST_SEEN = 0.25
"""Share of the Gaussians that lie before cameras: of fewer, these are not the scene's, or too few of them. Captures
whose photos were cut have Gaussians beyond all frames: their own cameras show 0.39 and more.
"""

LEAST_COVERED, LEAST_DEPTH = 0.05, 0.1
"""Cameras whose picture is covered less, or by what is nearer than this share of the depth of what lies before them,
stand outside the scene, or in its walls."""

TOGETHER = 200_000
"""Gaussians that are looked at together: of more, what drawing makes of them is not kept from view to view."""

_GOLDEN = math.pi * (3 - math.sqrt(5))
_SAMPLE, _TRIED = 4096, 6
_DOWN = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class Views:
    """Where a scene is looked at from.

    Attributes:
        deciding: cameras whose pictures are to stay as they are; none where nobody knows where people stand.
        judging: others, some of which tell whether to merge and to correct, and the rest the loss.
        is_object: whether it is surely an object that people see from outside.
        text: what they are, for people.
        doubt: why nobody knows what people see; else empty.
    """

    deciding: list[Camera]
    judging: list[Camera]
    is_object: bool
    text: str
    doubt: str = ""

    def some(self, count: int) -> list[Camera]:
        """At most so many of those that decide, evenly."""
        return some(self.deciding, count)


def views_of(gaussians: Gaussians) -> Views:
    """Views of (N,) Gaussians: those of their viewpoints, or about what is surely an object."""
    is_object = is_surely_an_object(gaussians)
    if gaussians.viewpoints:
        found = _views_through(gaussians)
        count = len(gaussians.viewpoints)
        if found is not None:
            return Views(*found, is_object, f"beside {count} photos" if count > 1 else "about one photo")
        shown = f"{count} cameras show" if count > 1 else "one camera shows"
        doubt = f"{shown} too little of them; are cameras those of this scene?"
    elif is_object:
        return Views(*_views_outside(gaussians, is_room=False), is_object, "about an object")
    else:
        doubt = "which of them pictures need follows from where people stand, and these are not surely an object"
        doubt += " seen from outside; --cameras makes the file smaller"
    return Views([], [], False, "from nowhere", doubt)


def views_of_block(gaussians: Gaussians, whole: Views) -> Views:
    """Views of (N,) Gaussians that are a block of a list which `whole` are those of: of its viewpoints those that see
    some of them, or about them.
    """
    if whole.doubt:
        return whole
    if not gaussians.viewpoints:
        return replace(whole, **_pair(_views_outside(gaussians, is_room=False)))
    points = _sampled(gaussians)
    seeing = tuple(camera for camera in gaussians.viewpoints if _inside(points, camera)[0].any())
    found = _views_through(gaussians.changed(viewpoints=seeing))
    return replace(whole, **_pair(found or ([], [])), doubt="" if found else "cameras show too little of it")


def from_anywhere(views: Views, gaussians: Gaussians) -> Views:
    """The views of (N,) Gaussians, or where nobody knows where people stand, those from outside and from the middle of
    rooms.
    """
    if not views.doubt:
        return views
    deciding, judging = _views_outside(gaussians, is_room=_is_room(gaussians))
    text = "from outside, as nobody knows where photos were taken"
    return replace(views, deciding=deciding, judging=judging, text=text)


def _pair(views: tuple[list[Camera], list[Camera]]) -> dict[str, Any]:
    return dict(zip(("deciding", "judging"), views, strict=True))


def _views_outside(gaussians: Gaussians, *, is_room: bool) -> tuple[list[Camera], list[Camera]]:
    if _lies_too_far(gaussians):
        return [], []
    return _views_about(gaussians, COUNT, 0.0, is_room), _views_about(gaussians, JUDGES, 1.0, is_room)


def pictures_of(gaussians: Gaussians, cameras: Sequence[Camera], threads: int) -> list[NDArray]:
    """What cameras that stand in the scene, whatever its viewpoints' steps, see as 3DGS defines drawing: (H, W, 3)
    float32 of at most 1 each.
    """
    renderer = _renderer(gaussians, threads)
    return [np.minimum(renderer.render(camera), np.float32(1)) for camera in cameras]


def _renderer(gaussians: Gaussians, threads: int | None = None) -> Renderer:
    return Renderer(gaussians.changed(viewpoints=()), threads, **DEFINITION, keep=gaussians.count <= TOGETHER)


def is_surely_an_object(gaussians: Gaussians) -> bool:
    """Whether people can only look at (N,) Gaussians from outside.

    An object's Gaussians are about as large everywhere, end where it ends, and fill little of a view from afar. A place
    has the distance behind it, and walls that hide it from outside or that enclose its middle.
    """
    if _lies_too_far(gaussians):
        return False
    means = gaussians.means.astype(np.float64)
    away = np.linalg.norm(means - np.median(means, axis=0), axis=1)
    most, nearly_all = np.percentile(away, (90, 99.9))
    if nearly_all > LONGEST_TAIL * most or is_uneven(sizes_about(gaussians)):
        return False
    renderer = _renderer(gaussians)
    outer = [camera.resized(64, 64) for camera in _outer_views(gaussians, OUTER, 0.0)]
    covered = [(renderer.render(camera, outputs=("alpha",))["alpha"] > 0.5).mean() for camera in outer]
    return bool(np.median(covered) <= MOST_COVERED) and not _is_room(gaussians)


def _views_through(gaussians: Gaussians) -> tuple[list[Camera], list[Camera]] | None:
    """Views of the photos that Gaussians were made from, and on the way between them."""
    cameras, depth = _showing(gaussians, [_shrunk(camera) for camera in spread(gaussians.viewpoints, MOST)])
    if not cameras:
        return None
    pairs = _pairs(cameras, depth)
    halfway = [between(pair, 3)[1] for pair in pairs]
    beside = [between(pair, 4)[1] for pair in pairs]
    if not pairs:
        around = orbit(cameras[:1], 2 * JUDGES, depth)
        halfway, beside = around[0::2], around[1::2]
    return [*cameras, *some(halfway, MOST_DECIDING - len(cameras))], some(beside, JUDGES)


def some(cameras: Sequence[Camera], count: int) -> list[Camera]:
    """At most so many, evenly."""
    return [cameras[n] for n in evenly(len(cameras), count)]


def _shrunk(camera: Camera) -> Camera:
    """A camera of no more pixels than a view has."""
    factor = min(SIDE / math.sqrt(camera.width * camera.height), 1)
    return camera.resized(max(round(camera.height * factor), 1), max(round(camera.width * factor), 1))


def _showing(gaussians: Gaussians, cameras: Sequence[Camera]) -> tuple[list[Camera], float]:
    """Those of the cameras that have some of (N,) Gaussians before them, in more than a point, and the depth in which
    they see these, scene units; none where that are too few, or they show too little.
    """
    points = _sampled(gaussians)
    seen, showing, depths = np.zeros(len(points), bool), [], []
    for camera in cameras:
        inside, pixels = _inside(points, camera)
        seen |= inside
        places = pixels[inside, :2] / pixels[inside, 2:]
        if len(places) and np.ptp(np.percentile(places, (5, 95), axis=0), axis=0).max() >= LEAST_COVERED:
            showing.append(camera)
            depths.append(float(np.median(pixels[inside, 2])))
    if seen.mean() < LEAST_SEEN or len(showing) <= len(cameras) / 2:
        return [], 0.0
    renderer, shows = _renderer(gaussians), []
    for number in evenly(len(showing), _TRIED):
        drawn = renderer.render(showing[number].resized(32, 32), outputs=("depth", "alpha"))
        covered = drawn["alpha"] > 0.5
        before = float(np.median(drawn["depth"][covered])) if covered.any() else 0.0
        shows.append(covered.mean() >= LEAST_COVERED and before >= LEAST_DEPTH * depths[number])
    return (showing, float(np.median(depths))) if np.mean(shows) >= 0.5 else ([], 0.0)


def _sampled(gaussians: Gaussians) -> NDArray:
    """(n, 3) float64 means of some of (N,) Gaussians, world."""
    return gaussians.means[:: -(-gaussians.count // _SAMPLE)].astype(np.float64) + gaussians.origin


def _inside(points: NDArray, camera: Camera) -> tuple[NDArray, NDArray]:
    """Which of (n, 3) points lie before a camera in its frame, (n,) bool, and (n, 3) float64 their places in it, in
    shares of its sides, times z, and z.
    """
    local = (points - camera.centre) @ camera.rotation.T
    pixels = local @ camera.K.T / (camera.width, camera.height, 1)
    inside = local[:, 2] > NEAR_PLANE
    return inside & ((pixels[:, :2] >= 0) & (pixels[:, :2] <= pixels[:, 2:])).all(axis=1), pixels


def _pairs(cameras: Sequence[Camera], depth: float) -> list[tuple[Camera, Camera]]:
    """Each camera with the nearest ones whose pictures are as large."""
    places, found = view_places(cameras, depth, depth), set()
    for number, camera in enumerate(cameras):
        sizes = [(other.width, other.height) == (camera.width, camera.height) for other in cameras]
        distances = np.where(sizes, np.square(places - places[number]).sum(axis=1), np.inf)
        distances[number] = np.inf
        for other in np.argsort(distances, kind="stable")[:PARTNERS].tolist():
            if np.isfinite(distances[other]):
                found.add((min(number, other), max(number, other)))
    return [(cameras[first], cameras[second]) for first, second in sorted(found)]


def views_about(gaussians: Gaussians, count: int) -> list[Camera]:
    """Cameras that see (N,) Gaussians as those would who walk about them.

    They stand outside, some of them near, evenly on the sphere but for its poles; of a room, a third of all
    stand in its middle and look outwards.
    """
    return _views_about(gaussians, count, 0.0, _is_room(gaussians))


def _views_about(gaussians: Gaussians, count: int, turned: float, is_room: bool) -> list[Camera]:
    """The same; `turned` by so many radians, others."""
    middle, _ = _bulk(gaussians)
    inner = count // 3 if is_room else 0
    within = [_camera(middle, _on_the_sphere(n, inner, 0.5, turned), SIDE / 2, SIDE) for n in range(inner)]
    return _outer_views(gaussians, count - inner, turned) + within


def _lies_too_far(gaussians: Gaussians) -> bool:
    """Whether no camera can stand about (N,) Gaussians."""
    middle, diagonal = _bulk(gaussians)
    return bool(max(np.abs(middle).max(), diagonal) > FARTHEST)


def _bulk(gaussians: Gaussians) -> tuple[NDArray, float]:
    """Middle (3,), world, and diagonal, scene units, of the bulk of (N,) Gaussians."""
    low, high = np.percentile(gaussians.means.astype(np.float64), (5, 95), axis=0)
    return (low + high) / 2 + gaussians.origin, float(np.linalg.norm(high - low)) or 1.0


def _outer_views(gaussians: Gaussians, count: int, turned: float) -> list[Camera]:
    """Those of `views_about` that stand outside."""
    middle, diagonal = _bulk(gaussians)
    means = gaussians.means.astype(np.float64) + gaussians.origin
    centre = np.median(means, axis=0)
    close = NEAR * float(np.median(np.linalg.norm(means - centre, axis=1))) or 1.0
    cameras = []
    for number in range(count):
        towards = _on_the_sphere(number, count, STEEPEST, turned)
        is_near = number % NEAR_EVERY == 2
        place = centre + close * towards if is_near else middle + FAR * diagonal * towards
        cameras.append(_camera(place, -towards, SIDE, SIDE))
    return cameras


def _on_the_sphere(number: int, count: int, steepest: float, turned: float) -> NDArray:
    """Unit vector of a Fibonacci spiral about the y axis."""
    height = steepest * (1 - (2 * number + 1) / count)
    turn, flat = number * _GOLDEN + 0.1 + turned, math.sqrt(1 - height * height)
    return np.array([math.sin(turn) * flat, height, math.cos(turn) * flat])


def _camera(place: NDArray, direction: NDArray, focal: float, side: int) -> Camera:
    c2w = np.eye(4)
    c2w[:3, :3], c2w[:3, 3] = looking_along(direction, down=_DOWN), place
    return Camera(np.array([[focal, 0, side / 2], [0, focal, side / 2], [0, 0, 1]]), c2w, side, side)


def _is_room(gaussians: Gaussians) -> bool:
    """Whether the middle is empty and walled in; not where no camera can stand about (N,) Gaussians."""
    if _lies_too_far(gaussians):
        return False
    middle, diagonal = _bulk(gaussians)
    renderer = _renderer(gaussians, 1)
    depths, alphas = [], []
    for turn in range(4):
        direction = np.array([math.sin(turn * math.pi / 2), 0.0, math.cos(turn * math.pi / 2)])
        seen = renderer.render(_camera(middle, direction, 16, 32), outputs=("depth", "alpha"))
        depths.append(seen["depth"])
        alphas.append(seen["alpha"])
    alpha, depth = np.concatenate(alphas), np.concatenate(depths)
    return bool(np.median(depth) > OPEN * diagonal and (alpha > 0.5).mean() > CLOSED)
