"""Photos to a file: the steps in order, the same whoever asks."""

from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec

from ..codec.job import EncodeStats, PhotoScene
from ..errors import InputError
from ..formats.table import save_gaussians
from ..gaussian.editing import select_views
from ..gaussian.gaussians import Gaussians
from ..modes import DEFAULT_MODE
from ..network.ways import LEAST_EACH
from ..system import printable
from ..system.told import NOBODY, Told
from .coding import code
from .compress import Encoded
from .doubts import doubts
from .kinds import KINDS, chosen
from .memory import check_memory
from .prepare import name_of, named_scene, prepared
from .request import EncodeRequest
from .steps import Run, Shares, Step, Tools


def encode(
    request: EncodeRequest,
    tools: Tools,
    told: Told = NOBODY,
    *,
    stats: EncodeStats | None = None,
    keep: bool = False,
    is_coded: bool = True,
) -> Encoded:
    """Photos to a `.tsplat` file's bytes.

    Args:
        request: which photos, and how.
        tools: to do it with, such as a `Runtime`.
        told: who is told what goes on; doubts are looked for where somebody listens.
        stats: filled with what coding measured.
        keep: hand on the Gaussians too.
        is_coded: make a file; else only the Gaussians, for files of other formats.

    Raises:
        InputError: the scene or an option cannot be used, memory does not suffice, or numba is missing.
        ModelError, NumericError: see `Runtime.predict` and `Runtime.compress`.
    """
    request, stats = replace(request, like=request.example()), stats or EncodeStats()
    # 1. Photos: which of them, how large, between what depths.
    photos = prepared(request, told)
    # 2. What they become, which decides all that follows.
    kind = chosen(request, photos, told)
    run = Run(request, kind, tools, photos, kind.seen(photos), told, stats)
    # 3. Whether memory suffices, and what is likely to come of it.
    check_memory(run.seen, run.way, is_coded=not kind.keeps_photos, trained_on=photos if kind.making else None)
    if told.listens and (line := kind.foretold(request, photos)):
        told.say("notice", line, photos.path)
    steps = [
        CHECK,  # 4. What is likely wrong with the photos.
        PREDICT,  # 5. The network's Gaussians,
        AGREE,  # 6. without photos that the others contradict: where there are any, again from 5 on.
        SAVE,  # 7. A file of these, where that is asked for.
        *kind.making,  # 8. What they become.
        *([CODE, COMPARE] if is_coded else []),  # 9. The file, and how like its photos it is.
    ]
    run = _taken(steps, run)
    return Encoded(run.data, run.gaussians if keep else None, run.made.nbytes, stats, kind, run.photos, run.doubts)


def encode_predicted(
    request: EncodeRequest, gaussians: Gaussians, tools: Tools, *, stats: EncodeStats | None = None
) -> bytes:
    """Gaussians that were predicted from a scene to a `.tsplat` file's bytes: what `encode` does after the network."""
    scene, kind = named_scene(request), KINDS[request.mode or DEFAULT_MODE]
    run = Run(request, kind, tools, scene, scene, stats=stats or EncodeStats(), gaussians=gaussians)
    return _taken([*kind.making, CODE], run).data


def _taken(steps: Sequence[Step], run: Run) -> Run:
    """A run after all steps; where one leaves photos out, the network looks at the others again."""
    ahead, count = list(steps), None
    while ahead:
        if run.count != count:
            run.told.plan([share for step in ahead for share in step.shares(run)])
        count = run.count
        run = ahead.pop(0).take(run)
        if run.count < count:
            ahead = list(steps[steps.index(PREDICT) :])
    return run


def _checked(run: Run) -> Run:
    """Reports doubts; looks for none if nobody listens."""
    found = doubts(run.seen, run.told) if run.told.listens else []
    for text in found:
        run.told.say("doubt", text, run.photos.path)
    return replace(run, doubts=tuple(found))


def _predicted(run: Run) -> Run:
    run.told.say("step", "opening the network")
    try:
        gaussians = run.way.predicted(run.seen, run.stats.watch, run.told)
    except InputError:
        if not run.left:
            raise
        # a photo that had something in common with those alone that were left out
        return replace(run, gaussians=select_views(run.made, run.left), left=())
    gaussians = gaussians.with_notes(replace(gaussians.notes, **run.request.notes))
    return replace(run, gaussians=gaussians, left=())


def _agreeing(run: Run) -> Run:
    """Leaves out photos that the others contradict; what they show has misled the network about their neighbours."""
    if not _are_compared(run):
        return run
    from .strangers import strangers  # which needs numba

    with run.stats.watch.stage("agree"):
        out = strangers(run.made, run.seen, run.tools.threads, run.told)
    if not out:
        return run
    names = printable.enumerated([name_of(run.seen.frames[view]) for view in out])
    run.told.say("doubt", f"left out {names}: the other photos contradict what it shows", run.photos.path)
    left = [view for view in range(run.count) if view not in out]
    return replace(run, photos=run.photos.views(left), seen=run.seen.views(left), left=left, looks=run.looks - 1)


def _are_compared(run: Run) -> bool:
    """Whether photos that the others contradict are looked for: of two, nobody can tell which of them is wrong."""
    is_asked = run.looks > 0 and not run.kind.keeps_photos and run.request.like is None
    return is_asked and run.count >= LEAST_EACH and find_spec("numba") is not None


def _saved(run: Run) -> Run:
    if (path := run.request.save_gaussians) is not None:
        for loss in save_gaussians(path, run.made):
            run.told.say("notice", loss, path)
    return run


def _coded(run: Run) -> Run:
    request, tools, kind = run.request, run.tools, run.kind
    photos = PhotoScene.of(run.seen, request.model, tools.store) if kind.keeps_photos else None
    qp = None if request.rates else kind.qp(run.count)
    data = code(run.made, request, tools, kind, qp=qp, photos=photos, stats=run.stats, told=run.told)
    return replace(run, data=data)


CHECKS: Shares = [("checking photos", 1), ("checking cameras", 2)]
AGREED: Shares = [("comparing neighbours", 3)]
COMPARED: Shares = [("comparing photos", 3)]

CHECK = Step(_checked, lambda run: CHECKS)
PREDICT = Step(_predicted, lambda run: run.way.steps)
AGREE = Step(_agreeing, lambda run: AGREED if _are_compared(run) else [])
SAVE = Step(_saved)
CODE = Step(_coded, lambda run: run.kind.shares)
COMPARE = Step(lambda run: run, lambda run: COMPARED)
"""Which commands do once the file is written: `own.compared`."""
