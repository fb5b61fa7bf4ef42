"""How what a network made of photos goes on, where nobody said: as one list, refined by its photos, or as it is."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec

from ..codec.modes import DEFAULT_MODE, EITHER, LIST
from ..errors import InputError
from ..graphs import DEFAULT_MODEL
from ..graphs.ways import LEAST_EACH, Way
from ..render.near import FEW
from ..scene.scenes import Scene
from ..sparse import MOST_SIDE
from ..system.told import Told
from .memory import check_memory
from .request import EncodeRequest
from .words import Refinement


def usual(request: EncodeRequest, photos: Scene, told: Told) -> EncodeRequest:
    """The request with a mode: photos as people take them become a list, where it can be trained and nothing is asked
    for that planes alone have. Of small ones not every list is as good as refined views (docs/MEASURING.md).
    """
    if request.mode is not None:
        return request
    is_plain = request.model == DEFAULT_MODEL and request.joint and request.refine is None and request.like is None
    is_plain = is_plain and not request.lossless and request.profile != "paper"
    camera = photos.cameras[0]
    is_large = min(camera.width, camera.height) > MOST_SIDE and len(photos.frames) >= LEAST_EACH
    if not (is_plain and is_large and find_spec("numba")):
        return replace(request, mode=DEFAULT_MODE)
    told.say("notice", f"as one trained list; --mode {DEFAULT_MODE} keeps a Gaussian for every pixel", photos.path)
    return replace(request, mode=LIST)


def chosen(request: EncodeRequest, scene: Scene, way: Way, told: Told) -> tuple[EncodeRequest, Refinement | None]:
    """What was asked for, as views where a list cannot be chosen; and the steps that were asked for, or the usual ones
    for three photos or more, if there are numba and memory for them.

    Args:
        request: what was asked for.
        scene: the photos as the network will have them.
        way: how they go through it.
        told: is told what was chosen, or what it would take.

    Raises:
        InputError: photos that take more memory than is free, with what was asked for; a list without numba.
    """
    few, lacks = len(scene.frames) <= FEW, find_spec("numba") is None
    if request.mode == EITHER and (few or lacks):
        why = f"{len(scene.frames)} photos" if few else 'without numba (pip install "tinysplat[fast]" brings it)'
        told.say("notice", f"{why}: not as one list", scene.path)
        request = replace(request, mode=DEFAULT_MODE)
    if request.mode == LIST and lacks:
        raise InputError('needs numba; pip install "tinysplat[fast]" brings it', where="mode")
    if request.mode in (LIST, EITHER):
        check_memory(scene, way, refined=True)
        return request, request.refine or Refinement()
    return request, _steps(request, scene, way, told)


def _steps(request: EncodeRequest, scene: Scene, way: Way, told: Told) -> Refinement | None:
    """Of views."""
    asked, mode = request.refine, request.mode or DEFAULT_MODE
    is_usual = asked is None and len(scene.frames) >= LEAST_EACH and mode == DEFAULT_MODE and request.like is None
    if not is_usual:
        check_memory(scene, way, mode=mode, refined=bool(asked))
        return asked or None
    if find_spec("numba") is None:
        told.say(
            "notice", 'not refined by its photos (about half a dB): pip install "tinysplat[fast]" brings it', scene.path
        )
        check_memory(scene, way)
        return None
    try:
        check_memory(scene, way, refined=True)
    except InputError as error:
        check_memory(scene, way)
        told.say("notice", f"not refined by its photos: {error.message}", scene.path)
        return None
    told.say("notice", "refinement follows (about +0.5 dB); --no-refine skips it", scene.path)
    return Refinement()
