"""Whether photos refine what a network made of them, where nobody said."""

from __future__ import annotations

from importlib.util import find_spec

from ..codec.modes import DEFAULT_MODE
from ..errors import InputError
from ..graphs.ways import Way
from ..render.near import FEW
from ..scene.scenes import Scene
from ..system.told import Told
from .memory import check_memory
from .request import EncodeRequest
from .words import Refinement


def chosen(request: EncodeRequest, scene: Scene, way: Way, told: Told) -> Refinement | None:
    """What was asked for; else the usual steps for a capture, if there are numba and memory for it.

    Args:
        request: what was asked for.
        scene: the photos as the network will have them.
        way: how they go through it.
        told: is told what was chosen, or what it would take.

    Raises:
        InputError: photos that take more memory than is free, with what was asked for.
    """
    asked, mode = request.refine, request.mode
    is_usual = asked is None and len(scene.frames) > FEW and mode == DEFAULT_MODE and request.like is None
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
    told.say("notice", "then refined by its photos, worth about half a dB; --no-refine leaves that out", scene.path)
    told.say("notice", "--mode list makes few Gaussians of it that show all photos, for any viewer", scene.path)
    return Refinement()
