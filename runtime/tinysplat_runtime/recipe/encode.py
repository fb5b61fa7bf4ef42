"""Photos to a file, and Gaussians to a file: the steps in order, the same whoever asks."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from importlib.util import find_spec

from ..codec.job import EncodeStats, PhotoScene
from ..errors import InputError
from ..formats.table import save_gaussians
from ..formats.viewpoints import pixels_of
from ..gaussian.editing import select_views
from ..gaussian.gaussians import Gaussians
from ..list.training import FEW_PHOTOS
from ..modes import DEFAULT_MODE, LIST, PHOTOS
from ..network.ways import LEAST_EACH, Way
from ..scene.scenes import Scene
from ..system import printable
from ..system.told import NOBODY, Told
from .request import CompressRequest, EncodeRequest
from .stages import Pruning, Tools, code, code_photos, sparse

LIST_QP, FEW_LIST_QP = -5.0, -6.0
"""Default Q_g of a capture as one list, and of one of few photos, which has few bytes to save: training brings it
nearer to its photos than most inputs of `compress` are, so that the same steps would lose more."""

LOOKS = 2
"""Passes that look for foreign photos: two of one other scene support each other until one is left out."""


@dataclass(frozen=True)
class Encoded:
    """The result of a request.

    Attributes:
        data: the file's bytes.
        gaussians: what was coded, if `keep` asked for it: those of large photos take gigabytes.
        raw_bytes: size of their arrays.
        stats: what coding measured, including the seconds of each step.
        scene: the photos as the network saw them, if there were any.
        doubts: what is likely wrong with the scene, a line each.
    """

    data: bytes
    gaussians: Gaussians | None
    raw_bytes: int
    stats: EncodeStats
    scene: Scene | None = None
    doubts: tuple[str, ...] = ()

    @property
    def seconds(self) -> float:
        """Seconds of all steps."""
        return sum(self.stats.watch.seconds.values())

    @property
    def photos(self) -> Scene:
        """The scene of Gaussians that came from photos."""
        assert self.scene is not None
        return self.scene


def encode(
    request: EncodeRequest, tools: Tools, told: Told = NOBODY, *, stats: EncodeStats | None = None, keep: bool = False
) -> Encoded:
    """Photos to a `.tsplat` file's bytes.

    Args:
        request: which photos, and how.
        tools: to do it with, such as a `Runtime`.
        told: who is told what goes on; doubts are looked for where somebody listens.
        stats: filled with what coding measured.
        keep: hand on the Gaussians too.

    Raises:
        InputError: the scene or an option cannot be used, or memory does not suffice.
        ModelError, NumericError: see `Runtime.predict` and `Runtime.compress`.
    """
    stats = stats or EncodeStats()
    made = _made(replace(request, like=request.example()), tools, told, stats, is_coded=True)
    data = _coded(made.gaussians, made.request, made.scene, tools, stats, told)
    kept = made.gaussians if keep else None
    return Encoded(data, kept, made.gaussians.nbytes, stats, made.scene, made.doubts)


def listed(
    request: EncodeRequest, tools: Tools, told: Told = NOBODY, *, stats: EncodeStats | None = None
) -> tuple[Gaussians, Scene, tuple[str, ...]]:
    """A capture as one list of few Gaussians that any viewer draws, corrected until they show its photos.

    Args:
        request: which photos, and how; of mode list.
        tools: to do it with, such as a `Runtime`.
        told: who is told what goes on; doubts are looked for where somebody listens.
        stats: filled with the seconds of each step.

    Returns:
        The list, the photos as the network had them, and doubts.

    Raises:
        InputError: the scene or an option cannot be used, memory does not suffice, or numba is missing.
        ModelError, NumericError: see `Runtime.predict`.
    """
    made = _made(request, tools, told, stats or EncodeStats(), is_coded=False)
    return made.gaussians, made.scene, made.doubts


@dataclass(frozen=True)
class _Made:
    """Gaussians made of photos, before coding, and the request with the chosen mode."""

    gaussians: Gaussians
    request: EncodeRequest
    scene: Scene
    doubts: tuple[str, ...]


def _made(request: EncodeRequest, tools: Tools, told: Told, stats: EncodeStats, *, is_coded: bool) -> _Made:
    """Gaussians per pixel, or one list; `is_coded` if they are then coded to a file."""
    from .ahead import ahead
    from .choice import chosen
    from .memory import check_memory
    from .prepare import prepared

    whole = scene = prepared(request, told)
    request = chosen(request, whole, told)
    is_list = request.mode == LIST
    if is_list:
        from ..list.training import for_network

        scene = for_network(whole)
    way = _way(request, scene, tools)
    check_memory(scene, way, is_coded=request.mode != PHOTOS, trained_on=whole if is_list else None)
    is_compared = request.mode != PHOTOS and _are_compared(request, scene)
    _foretell(request, whole, told, is_coded=is_coded)
    told.plan(ahead(way, request, len(scene.frames), is_compared=is_compared, is_coded=is_coded))
    doubted = _doubted(scene, told)
    gaussians = _predicted(request, scene, way, told, stats)
    if is_compared:
        gaussians, left = _agreeing(gaussians, scene, request, tools, told, stats, is_coded=is_coded)
        whole = whole.views(left)
    if request.save_gaussians is not None:
        for loss in save_gaussians(request.save_gaussians, gaussians):
            told.say("notice", loss, request.save_gaussians)
    if is_list:
        size = request.target_size if is_coded else None
        with stats.watch.stage("train"):
            gaussians = sparse(gaussians, whole, request.train, request.at_most, tools, told, size=size)
    return _Made(gaussians, request, whole, doubted)


def _are_compared(request: EncodeRequest, scene: Scene) -> bool:
    """Whether photos that the others contradict are looked for: of two, nobody can tell which of them is wrong."""
    return len(scene.frames) >= LEAST_EACH and request.like is None and find_spec("numba") is not None


def _foretell(request: EncodeRequest, scene: Scene, told: Told, *, is_coded: bool) -> None:
    """Say what is likely to come of it."""
    from .prepare import ALL_VIEWS, expected_bytes

    if len(scene.frames) not in ALL_VIEWS and request.is_usual and request.mode == DEFAULT_MODE:
        told.say("notice", f"about {expected_bytes(scene) / 1000:.0f} KB", scene.path)
    if request.mode == LIST and told.listens:
        from .forecast import list_forecast

        told.say("notice", list_forecast(scene, request.at_most, request.target_size if is_coded else None), scene.path)


def _agreeing(
    gaussians: Gaussians,
    scene: Scene,
    request: EncodeRequest,
    tools: Tools,
    told: Told,
    stats: EncodeStats,
    *,
    is_coded: bool,
) -> tuple[Gaussians, list[int]]:
    """The Gaussians of the photos that no others contradict, and which these are; names those that are left out."""
    from .ahead import from_network
    from .prepare import name_of
    from .strangers import strangers

    left = list(range(len(scene.frames)))
    for looks in range(LOOKS, 0, -1):
        with stats.watch.stage("agree"):
            out = strangers(gaussians, scene.views(left), tools.threads, told)
        if not out:
            break
        names = printable.listed([name_of(scene.frames[left[view]]) for view in out])
        told.say("doubt", f"left out {names}: the other photos contradict what it shows", scene.path)
        stay = [view for view in range(len(left)) if view not in out]
        left = [left[view] for view in stay]
        some = scene.views(left)
        way, is_compared = _way(request, some, tools), looks > 1 and _are_compared(request, some)
        told.plan(from_network(way, request, len(left), is_compared=is_compared, is_coded=is_coded))
        try:  # again, as what they show has misled the network about their neighbours
            gaussians = _predicted(request, some, way, told, stats)
        except InputError:  # a photo that had something in common with these alone
            gaussians = select_views(gaussians, stay)
    return gaussians, left


def _doubted(scene: Scene, told: Told) -> tuple[str, ...]:
    """Find and report what is likely wrong with a scene; nothing if nobody listens."""
    from .doubts import doubts  # here, so that who codes Gaussians loads no layouts of photos

    doubted = doubts(scene, told) if told.listens else []
    for text in doubted:
        told.say("doubt", text, scene.path)
    return tuple(doubted)


def _way(request: EncodeRequest, scene: Scene, tools: Tools) -> Way:
    """The way through the requested network."""
    is_whole = request.mode == PHOTOS
    return Way.of(scene, request.model, tools.store, threads=tools.threads, whole=is_whole, joint=request.joint)


def _predicted(request: EncodeRequest, scene: Scene, way: Way, told: Told, stats: EncodeStats) -> Gaussians:
    """The Gaussians that a network predicts from photos, with notes."""
    told.say("step", "opening the network")
    gaussians = way.predicted(scene, stats.watch, told)
    return gaussians.with_notes(replace(gaussians.notes, **request.notes))


def compress(
    request: CompressRequest, tools: Tools, told: Told = NOBODY, *, stats: EncodeStats | None = None, keep: bool = False
) -> Encoded:
    """Gaussians of any network, or of a trained scene, to a `.tsplat` file's bytes.

    Args:
        request: which Gaussians, and how.
        tools, told, stats, keep: see `encode`.

    Raises:
        FormatError, InputError, NumericError: see `Runtime.compress`.
    """
    from .ahead import coded

    stats, gaussians = stats or EncodeStats(), request.gaussians
    if request.cameras is not None:
        gaussians = pixels_of(gaussians, request.cameras)
    gaussians = gaussians.with_notes(replace(gaussians.notes, **request.notes))
    told.plan(coded(gaussians))
    pruning = Pruning(request.keep_all, request.seconds or math.inf)
    data = code(gaussians, request, tools, pruning=pruning, stats=stats, told=told)
    return Encoded(data, gaussians if keep else None, gaussians.nbytes, stats)


def encode_predicted(
    request: EncodeRequest, gaussians: Gaussians, tools: Tools, *, stats: EncodeStats | None = None
) -> bytes:
    """Code Gaussians that were predicted from a scene: the last step of `encode`."""
    from .prepare import named_scene

    return _coded(gaussians, request, named_scene(request), tools, stats or EncodeStats(), NOBODY)


def _coded(
    gaussians: Gaussians, request: EncodeRequest, scene: Scene, tools: Tools, stats: EncodeStats, told: Told
) -> bytes:
    """Code the Gaussians of a scene, or its photos if the mode asks for them."""
    if request.mode != PHOTOS:
        is_list = request.mode == LIST
        qp = FEW_LIST_QP if len(scene.frames) <= FEW_PHOTOS else LIST_QP
        coding = replace(request, qp=qp) if is_list and not request.rates else request
        return code(gaussians, coding, tools, pruning=Pruning(is_done=is_list), stats=stats, told=told)
    photos = PhotoScene.of(scene, request.model, tools.store)
    return code_photos(gaussians, request, photos, tools, stats=stats)
