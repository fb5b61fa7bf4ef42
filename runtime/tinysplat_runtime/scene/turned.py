"""Photos that Exif turns, though their cameras were found for them as stored: where sizes do not tell, corners do."""

from collections.abc import Iterable
from dataclasses import replace

from ..errors import InputError
from ..system.evenly import evenly
from .images import is_turned
from .look import neighbours, thumbnail_size
from .matches import corners, inliers, matched
from .scenes import Frame, Scene

FEW, SIDE = 4, 384
"""Photos whose corners are looked at, each beside its nearest, and their longer side in pixels then."""

CHANCE, BETTER = 30, 2.0
"""Corners that fit by chance, and times as many as fit the photos upright."""


def as_cameras_have_them(scene: Scene) -> Scene:
    """The scene, its photos that Exif turns taken as stored where corners fit their cameras far better so."""
    turned = [v for v, frame in enumerate(scene.frames) if _is_turned(frame)]
    if not turned or len(scene.frames) < 2:
        return scene
    frames = tuple(replace(frame, is_stored=v in turned) for v, frame in enumerate(scene.frames))
    stored = replace(scene, frames=frames)
    looked = [turned[i] for i in evenly(len(turned), FEW)]
    pairs = [(v, int(beside)) for v, beside in zip(looked, neighbours(scene.cameras)[looked, 0], strict=True)]
    try:
        return stored if _fitting(stored, pairs) > max(CHANCE, BETTER * _fitting(scene, pairs)) else scene
    except InputError:  # a photo that cannot be read, which need not be among those that are taken
        return scene


def _is_turned(frame: Frame) -> bool:
    try:
        return frame.video is None and is_turned(frame.path)
    except InputError:
        return False


def _fitting(scene: Scene, pairs: Iterable[tuple[int, int]]) -> float:
    """How many corners that pairs of photos have in common lie where their cameras allow."""
    pairs = list(pairs)
    small = {v: scene.frames[v] for pair in pairs for v in pair}
    small = {v: frame.resized(*thumbnail_size(frame.camera, SIDE)) for v, frame in small.items()}
    found = {v: corners(frame.image()) for v, frame in small.items()}
    return sum(inliers(matched(found[v], found[u]), small[v].camera, small[u].camera) for v, u in pairs)
