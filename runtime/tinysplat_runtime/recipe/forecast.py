"""What a list is going to be and to take, before anything is made of photos, or left out of Gaussians.

Figures of photos are fitted: bytes to lists of 12 and 24 photos of six scenes of dev and of 4 or 5 of four, all of
256×256; seconds to `bench gate`, `bench walk` and two captures more, of 3 to 48 photos of up to 640×480: all 47 lie
within 1.5, where those of busy machines count three quarters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import Gaussians
from ..list.training import BYTES_EACH, DEFAULT_SECONDS, FEW_PHOTOS, KEPT, MOST_GAUSSIANS, for_network, usual_steps
from ..list.training.contrast import contrast
from ..list.views import TOGETHER, Views
from ..scene.cameras import Camera
from ..scene.scenes import Scene
from ..scene.viewchoice import ALL_VIEWS
from ..system.evenly import evenly
from ..system.threads import available_cores
from .request import EncodeRequest
from .words import Training

PHOTO_BYTES, BYTES_EXPONENT = 26_000, 0.69
"""Bytes of a photo of 256×256 as planes by default, and how they grow with its pixels that count; captures of 16 to 45
photos took 23,000 to 29,000."""

PHOTOS = 8
"""Photos of a capture that are looked at for how much detail all have."""

LIST_BYTES, DETAIL_EXPONENT, PHOTOS_EXPONENT, TURN_EXPONENT = 0.082, 1.26, 0.84, 0.3
"""Bytes of a list, and how they grow with the detail of a photo, the number of photos, and how many degrees each is
turned from the one that is turned most like it, and 1: what others show too takes no Gaussians of its own."""

OF_FEW = 1.4
"""How many times as many bytes few photos take, which lose more by what goes (`Settings.worth_of_few`)."""

PHOTO_SECONDS, FEW_SECONDS, STEP_SECONDS = 1.4, 0.42, 0.01
"""CPU seconds of a photo of 256×256 until all agree on depth; of one of few, which do not seek that; and of a step of
training, by 256×256 pixels of the photos that it is trained on, and of `STEP_GAUSSIANS`."""

STEP_GAUSSIANS, GAUSSIANS_EXPONENT = 20_000, 1.5
"""How many Gaussians cost as much as these pixels, and how what more of them cost grows: caches hold fewer of them."""

PLACE_SECONDS, OBJECT_SECONDS, LIST_SECONDS, KEEP_SECONDS, SEARCHED = 5.8, 3.8, 0.031, 0.025, 1.75
"""CPU seconds of pruning by a million pixels of views, which an object hardly fills, and of a thousand Gaussians that
are pruned or all kept; and how many times as long a target takes, for which most lists are pruned twice."""

LONG_SECONDS = 20.0
"""CPU seconds from which a list is announced."""


def planes_forecast(request: EncodeRequest, scene: Scene) -> str:
    """A line about the file of many photos as planes, where nothing but the default is asked for."""
    if len(scene.frames) in ALL_VIEWS or not request.is_usual:
        return ""
    camera = scene.cameras[0]
    known = (frame.known() for frame in scene.frames)
    counted = (camera.width * camera.height * (1.0 if which is None else float(which.mean())) for which in known)
    return f"about {sum(PHOTO_BYTES * (pixels / 256**2) ** BYTES_EXPONENT for pixels in counted) / 1000:.0f} KB"


def list_forecast(request: EncodeRequest, scene: Scene) -> str:
    """A line about photos as a list: Gaussians, bytes, CPU seconds."""
    count, camera, detail = len(scene.frames), scene.cameras[0], _detail(scene)
    most = min(request.at_most or math.inf, KEPT * MOST_GAUSSIANS)
    size = min(_list_bytes(scene, detail), BYTES_EACH * most, request.target_size or math.inf)
    made = f"about {_rounded(size / BYTES_EACH)} Gaussians and {_rounded(size / 1000)} KB"
    pixels, training = camera.width * camera.height, request.train or Training()
    steps = training.steps or usual_steps(count, detail / pixels)
    trained = steps * STEP_SECONDS * (pixels / 256**2 + (size / BYTES_EACH / STEP_GAUSSIANS) ** GAUSSIANS_EXPONENT)
    each = FEW_SECONDS if count <= FEW_PHOTOS else PHOTO_SECONDS
    seen = for_network(scene).cameras[0]
    before = each * count * seen.width * seen.height / 256**2
    seconds = before + min(trained, available_cores() * (training.seconds or DEFAULT_SECONDS))
    taken = f"(perhaps a third fewer or more), {_rounded(seconds)} CPU seconds"
    return f"{count} photos of {camera.width}x{camera.height}: {made} {taken}"


def prune_forecast(gaussians: Gaussians, views: Views, *, is_searched: bool) -> str:
    """A line about pruning a list from such views, and what shortens it; empty where it takes seconds. `is_searched` of
    one that is to meet a target.
    """
    pixels = sum(camera.width * camera.height for camera in views.deciding) / 1e6
    count, blocks = gaussians.count, -(-gaussians.count // TOGETHER)
    times, by_view = SEARCHED if is_searched else 1.0, OBJECT_SECONDS if views.is_object else PLACE_SECONDS
    seconds = times * (by_view * pixels * blocks + LIST_SECONDS * count / 1000)
    if seconds < LONG_SECONDS:
        return ""
    return (
        f"{count:,} Gaussians: pruning and coding take about {_rounded(seconds)} CPU seconds; --seconds N bounds"
        f" pruning, --keep-all leaves it out (about {_rounded(times * KEEP_SECONDS * count / 1000)})"
    )


def _turns(cameras: Sequence[Camera]) -> NDArray:
    """(V,) degrees between where each camera looks and where the one looks that does so most alike."""
    ahead = np.stack([camera.rotation[2] for camera in cameras])
    alike = ahead @ ahead.T
    np.fill_diagonal(alike, -1)
    return np.degrees(np.arccos(alike.max(axis=1).clip(-1, 1)))


def _list_bytes(scene: Scene, detail: float) -> float:
    count, turns = len(scene.frames), _turns(scene.cameras)
    grown = detail**DETAIL_EXPONENT * count**PHOTOS_EXPONENT * (1 + float(turns.mean())) ** TURN_EXPONENT
    return LIST_BYTES * grown * (OF_FEW if count <= FEW_PHOTOS else 1)


def _detail(scene: Scene) -> float:
    """The sum over a photo's pixels of the root of contrast, as `list.training.start.Surface` has it, on the mean."""
    looked_at = (scene.frames[view].judged() for view in evenly(len(scene.frames), PHOTOS))
    return float(np.mean([np.sqrt(contrast(photo)).sum() for photo in looked_at]))


def _rounded(number: float) -> str:
    return f"{float(f'{number:.2g}'):,.0f}"
