"""Photos to a file, and Gaussians to a file: the steps in order, the same whoever asks."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace

from ..codec.job import EncodeStats, PhotoScene
from ..codec.modes import DEFAULT_MODE
from ..formats.table import save_gaussians
from ..formats.viewpoints import pixels_of
from ..gaussian.gaussians import FIELDS, Gaussians
from ..refine.stats import RefineStats
from ..scene.intake.layouts import load_scene
from ..scene.scenes import Scene
from ..system.progress import Show, plain
from .request import Coding, CompressRequest, EncodeRequest
from .stages import Tools, Way, code, code_photos, predict, refine
from .words import Refinement


@dataclass(frozen=True)
class Listener:
    """Who is told what goes on.

    Attributes:
        notice: gets a line for each thing that was found rather than given.
        doubt: gets the scene and a line for each thing that is likely wrong with it; None to look for none.
        working: gives what is entered while the named step is at work.
        predicting: passes on photos that are given to the network in groups.
        refining: passes on the steps of refinement.
        refined: gets what refinement did.
        counting: gives what passes on the photos of a step by its name: reading, depths, checking.
    """

    notice: Callable[[str], object] = str
    doubt: Callable[[Scene, str], object] | None = None
    working: Callable[[str], AbstractContextManager[None]] = lambda _: nullcontext()
    predicting: Show = plain
    refining: Show | None = None
    refined: Callable[[RefineStats], object] | None = None
    counting: Callable[[str], Show] = lambda _: plain


@dataclass(frozen=True)
class Encoded:
    """What came of a request.

    Attributes:
        data: the file's bytes.
        gaussians: what was coded, where they were to be kept: of large photos they take gigabytes.
        raw_bytes: of their arrays.
        stats: what coding measured, the seconds of all steps among it.
        refinement: what refinement did, if there was any.
        scene: the photos as the network had them, where there were some.
        doubts: what is likely wrong with the scene, a line each.
    """

    data: bytes
    gaussians: Gaussians | None
    raw_bytes: int
    stats: EncodeStats
    refinement: RefineStats | None = None
    scene: Scene | None = None
    doubts: tuple[str, ...] = ()

    @property
    def seconds(self) -> float:
        """Of all steps."""
        return sum(self.stats.watch.seconds.values())

    @property
    def photos(self) -> Scene:
        """The scene of Gaussians that came from photos."""
        assert self.scene is not None
        return self.scene


def encode(
    request: EncodeRequest,
    tools: Tools,
    listener: Listener | None = None,
    *,
    stats: EncodeStats | None = None,
    keep: bool = False,
) -> Encoded:
    """Photos to a `.tsplat` file's bytes.

    Args:
        request: which photos, and how.
        tools: to do it with, such as a `Runtime`.
        listener: who is told what goes on; None for nobody.
        stats: filled with what coding measured.
        keep: hand on the Gaussians too.

    Raises:
        InputError: the scene or an option cannot be used, or memory does not suffice.
        ModelError, NumericError: see `Runtime.predict` and `Runtime.compress`.
    """
    from .doubts import doubts  # here, so that who codes Gaussians loads no layouts of photos
    from .plan import is_worth_saying, planned
    from .prepare import prepared
    from .refinement import chosen

    listener, stats, refined = listener or Listener(), stats or EncodeStats(), RefineStats()
    request = replace(request, like=request.example())
    scene = prepared(request, listener.notice, listener.counting)
    model, whole = request.model, request.mode != DEFAULT_MODE
    way = Way.of(scene, model, tools, whole=whole)
    refinement = chosen(request, scene, way, listener.notice)
    plan = planned(scene, is_refined=bool(refinement), is_usual=request.is_usual and not whole)
    if is_worth_saying(plan, len(scene.frames)):
        listener.notice(f"{scene.path}: {plan}")
    doubted = []
    if listener.doubt is not None:
        doubted = doubts(scene, listener.counting("checking"))
        for text in doubted:
            listener.doubt(scene, text)
    with listener.working("network"):
        gaussians = predict(scene, model, tools, way, watch=stats.watch, show=listener.predicting)
    gaussians = gaussians.with_notes(replace(gaussians.notes, **request.notes))
    if request.save_gaussians is not None:
        for loss in save_gaussians(request.save_gaussians, gaussians):
            listener.notice(f"{request.save_gaussians}: {loss}")
    if refinement:
        gaussians = _refined(gaussians, scene, refinement, request, tools, listener, stats, refined)
    with listener.working("coding"):
        data = _coded(gaussians, request, scene, tools, stats)
    kept, done = gaussians if keep else None, refined if refinement else None
    return Encoded(data, kept, raw_bytes(gaussians), stats, done, scene, tuple(doubted))


def compress(
    request: CompressRequest,
    tools: Tools,
    listener: Listener | None = None,
    *,
    stats: EncodeStats | None = None,
    keep: bool = False,
) -> Encoded:
    """Gaussians of any network, or of a trained scene, to a `.tsplat` file's bytes.

    Args:
        request: which Gaussians, and how.
        tools, listener, stats, keep: see `encode`.

    Raises:
        FormatError, InputError, NumericError: see `Runtime.compress`.
    """
    listener, stats, refined = listener or Listener(), stats or EncodeStats(), RefineStats()
    gaussians = request.gaussians
    if request.cameras is not None:
        gaussians = pixels_of(gaussians, request.cameras)
    gaussians = gaussians.with_notes(replace(gaussians.notes, **request.notes))
    if request.photos is not None:
        scene = request.photos if isinstance(request.photos, Scene) else load_scene(request.photos)
        gaussians = _refined(gaussians, scene, request.refine, request, tools, listener, stats, refined)
    with listener.working("coding"):
        data = code(gaussians, request, tools, keep_all=request.keep_all, stats=stats)
    return Encoded(data, gaussians if keep else None, raw_bytes(gaussians), stats, refined if request.refine else None)


def _refined(
    gaussians: Gaussians,
    scene: Scene,
    refinement: Refinement | None,
    coding: Coding,
    tools: Tools,
    listener: Listener,
    stats: EncodeStats,
    refined: RefineStats,
) -> Gaussians:
    with stats.watch.stage("refine"):
        gaussians = refine(gaussians, scene, refinement, coding, tools, stats=refined, show=listener.refining)
    if listener.refined:
        listener.refined(refined)
    return gaussians


def encode_predicted(
    request: EncodeRequest, gaussians: Gaussians, tools: Tools, *, stats: EncodeStats | None = None
) -> bytes:
    """The last step alone, of a scene that Gaussians were predicted of as it stands; see `encode`."""
    from .prepare import named_scene

    return _coded(gaussians, request, named_scene(request), tools, stats or EncodeStats())


def _coded(gaussians: Gaussians, request: EncodeRequest, scene: Scene, tools: Tools, stats: EncodeStats) -> bytes:
    """The file of what a network made of a scene, or where that is asked for, of its photos."""
    if request.mode == DEFAULT_MODE:
        return code(gaussians, request, tools, stats=stats)
    photos = PhotoScene.of(scene, request.model, tools.store)
    return code_photos(gaussians, request, photos, tools, stats=stats)


def raw_bytes(gaussians: Gaussians) -> int:
    """Of the arrays of all layers."""
    return sum(getattr(layer, name).nbytes for layer in gaussians.layers for name in FIELDS)
