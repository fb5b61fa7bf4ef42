"""What photos are made into where nobody said: one trained list from three photos on, planes of two."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec

from ..errors import InputError
from ..graphs import DEFAULT_MODEL
from ..modes import DEFAULT_MODE, LIST
from ..network.ways import LEAST_EACH
from ..scene.scenes import Scene
from ..system.told import Told
from .request import EncodeRequest


def chosen(request: EncodeRequest, photos: Scene, told: Told) -> EncodeRequest:
    """The request with a mode: a list where it was asked for, or can be trained and nothing is asked for that planes
    alone have.

    Args:
        request: what was asked for.
        photos: what it is made of.
        told: is told what was chosen, or what it would take.

    Raises:
        InputError: a list is asked for without numba.
    """
    lacks = find_spec("numba") is None
    is_asked = request.mode == LIST or request.train is not None or request.at_most is not None
    if is_asked and lacks:
        raise InputError('needs numba; pip install "tinysplat[fast]" brings it', where="mode")
    if is_asked:
        return replace(request, mode=LIST)
    if request.mode is not None or request.fast or not _fits(request, photos):
        return replace(request, mode=request.mode or DEFAULT_MODE, fast=False)
    if lacks:
        brings = 'pip install "tinysplat[fast]" brings what one trained list needs, sharper and smaller'
        told.say("notice", f"as planes of the network alone; {brings}", photos.path)
        return replace(request, mode=DEFAULT_MODE)
    told.say("notice", "as one trained list; --fast leaves the network's Gaussians, one a pixel", photos.path)
    return replace(request, mode=LIST)


def _fits(request: EncodeRequest, photos: Scene) -> bool:
    """Whether a list of so many photos has all that is asked for."""
    is_plain = request.model == DEFAULT_MODEL and request.joint and request.profile != "paper"
    return is_plain and not request.lossless and request.like is None and len(photos.frames) >= LEAST_EACH
