"""Photos to a file: the steps in order, the same whoever asks."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace

from ..codec.job import EncodeStats, PhotoScene
from ..codec.modes import DEFAULT_MODE
from ..gaussian.gaussians import FIELDS, Gaussians
from ..refine.stats import RefineStats
from ..scene.scenes import Scene
from ..system.progress import Show, plain
from .request import Coding, EncodeRequest
from .stages import Tools, Way, code, predict, refine


@dataclass(frozen=True)
class Listener:
    """Who is told what goes on.

    Attributes:
        notice: gets a line for each thing that was found rather than given.
        doubt: gets the scene and a line for each thing that is likely wrong with it; None to look for none.
        working: gives what is entered while the named step is at work.
        predicted: gets the network's Gaussians.
        predicting: passes on photos that are given to the network in groups.
        refining: passes on the steps of refinement.
        refined: gets what refinement did.
        counting: gives what passes on the photos of a step by its name: reading, depths, checking.
    """

    notice: Callable[[str], object] = str
    doubt: Callable[[Scene, str], object] | None = None
    working: Callable[[str], AbstractContextManager[None]] = lambda _: nullcontext()
    predicting: Show = plain
    predicted: Callable[[Gaussians], object] | None = None
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

    listener, stats, refined, coding = listener or Listener(), stats or EncodeStats(), RefineStats(), request.coding
    coding = replace(coding, like=coding.example())
    scene = prepared(request, listener.notice, listener.counting)
    model, whole = request.model, coding.mode != DEFAULT_MODE
    way = Way.of(scene, model, tools, whole=whole)
    refinement = chosen(request, scene, way, listener.notice)
    plan = planned(scene, is_refined=bool(refinement), is_usual=request.coding == Coding())
    if is_worth_saying(plan, len(scene.frames)):
        listener.notice(f"{scene.path}: {plan}")
    doubted = []
    if listener.doubt is not None:
        doubted = doubts(scene, listener.counting("checking"))
        for text in doubted:
            listener.doubt(scene, text)
    with listener.working("network"):
        gaussians = predict(scene, model, tools, way, watch=stats.watch, show=listener.predicting)
    gaussians = gaussians.with_notes(replace(gaussians.notes, **request.notes.given()))
    if listener.predicted:
        listener.predicted(gaussians)
    if refinement:
        with stats.watch.stage("refine"):
            gaussians = refine(gaussians, scene, refinement, coding, tools, stats=refined, show=listener.refining)
        if listener.refined:
            listener.refined(refined)
    with listener.working("coding"):
        photos = PhotoScene.of(scene, model, tools.store) if whole else None
        data = code(gaussians, coding, tools, photos=photos, stats=stats)
    kept, done = gaussians if keep else None, refined if refinement else None
    return Encoded(data, kept, raw_bytes(gaussians), stats, done, scene, tuple(doubted))


def encode_predicted(
    request: EncodeRequest, gaussians: Gaussians, tools: Tools, *, stats: EncodeStats | None = None
) -> bytes:
    """The last step alone, of a scene that Gaussians were predicted of as it stands; see `encode`."""
    from .prepare import named_scene

    scene, has_photos = named_scene(request), request.coding.mode != DEFAULT_MODE
    photos = PhotoScene.of(scene, request.model, tools.store) if has_photos else None
    return code(gaussians, request.coding, tools, photos=photos, stats=stats)


def raw_bytes(gaussians: Gaussians) -> int:
    """Of the arrays of all layers."""
    return sum(getattr(layer, name).nbytes for layer in gaussians.layers for name in FIELDS)
