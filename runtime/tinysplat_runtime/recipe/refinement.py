"""Whether photos refine what a network made of them, where nobody said."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

from ..codec.modes import DEFAULT_MODE
from ..errors import InputError
from ..render.near import FEW
from ..scene.scenes import Scene
from .memory import check_memory
from .request import EncodeRequest
from .stages import Way
from .words import Refinement

CPU_SECONDS = 13e-6
"""Seconds of one core per pixel of a capture's photos, in as many steps as are usual; as measured on 45 of 415×738."""


def chosen(request: EncodeRequest, scene: Scene, way: Way, notice: Callable[[str], object]) -> Refinement | None:
    """What was asked for; else the usual steps for a capture, if there are numba and memory for it.

    Args:
        request: what was asked for.
        scene: the photos as the network will have them.
        way: how they go through it.
        notice: gets a line that says what was chosen, or what it would take.

    Raises:
        InputError: photos that take more memory than is free, with what was asked for.
    """
    asked, mode = request.refine, request.mode
    is_usual = asked is None and len(scene.frames) > FEW and mode == DEFAULT_MODE and request.like is None
    if not is_usual:
        check_memory(scene, way.enlarger, mode=mode, refined=bool(asked), each=way.is_each)
        return asked or None
    if find_spec("numba") is None:
        notice(f'{scene.path}: not refined by its photos (about half a dB): pip install "tinysplat[fast]" brings it')
        check_memory(scene, way.enlarger, each=way.is_each)
        return None
    try:
        check_memory(scene, way.enlarger, refined=True, each=way.is_each)
    except InputError as error:
        check_memory(scene, way.enlarger, each=way.is_each)
        notice(f"{scene.path}: not refined by its photos: {error.message}")
        return None
    notice(f"{scene.path}: then refined by its photos, worth about half a dB; --no-refine leaves that out")
    return Refinement()
