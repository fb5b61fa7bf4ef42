"""What photos become: planes of the network's Gaussians, one trained list, or a file of the photos themselves."""

import math
from dataclasses import replace
from functools import partial
from importlib.util import find_spec

import numpy as np

from .. import modes
from ..errors import InputError, fast_for
from ..gaussian.gaussians import Gaussians
from ..graphs import DEFAULT_MODEL
from ..list.training import FEW_PHOTOS, for_network, usual_steps
from ..network.ways import LEAST_EACH
from ..scene.scenes import Scene
from ..system import disk, printable
from ..system.told import Told
from .coding import as_list, as_photos, as_planes, kept, pruned, ranked
from .forecast import list_forecast, planes_forecast
from .prepare import name_of
from .request import Coding, EncodeRequest
from .steps import Kind, Run, Shares, Step
from .words import Training

LIST_QP, FEW_LIST_QP = -5.0, -6.0
"""Default Q_g of a capture as one list, and of one of few photos, which has few bytes to save: training brings it
nearer to its photos than most inputs of `compress` are, so that the same steps would lose more."""

TRAINED = 2.2
"""Share of time of a step of training, times the photos."""


def _trained(run: Run) -> Run:
    """A list that shows the photos; see `list.training.train.trained`."""
    with fast_for("at_most"):
        from ..list.training.photos import targets_of
        from ..list.training.settings import Budget
        from ..list.training.train import TrainStats, trained
    request, training, stats = run.request, run.request.train or Training(), TrainStats()
    budget = Budget(request.at_most, training.steps, training.seconds, request.target_size)
    with run.stats.watch.stage("train"):
        targets = targets_of(run.photos.cameras, run.photos.frames)
        for frame in (*run.photos.frames, *run.seen.frames):
            frame.forget()  # for training's sake: a few alone are looked at behind it
        disk.let_go()
        found = trained(run.made, targets, budget, threads=run.tools.threads, stats=stats, told=run.told)
    run.told.say("doubt" if stats.is_cut_short else "notice", stats.text)
    if moved := [name_of(run.photos.frames[view]) for view, share in enumerate(stats.contradicted) if share]:
        what = f"{max(stats.contradicted):.0%} of a photo at most that the others contradict"
        run.told.say("notice", f"left out of {printable.enumerated(moved)}: {what}; something moved", run.photos.path)
    note = f"{stats.steps} steps on {len(targets)} photos: {np.nanmean(stats.psnr):.1f} dB"
    return replace(run, gaussians=found.with_notes(replace(found.notes, refined=note)))


def _training_shares(run: Run) -> Shares:
    steps = run.request.train and run.request.train.steps
    return [("training", TRAINED * (steps or usual_steps(run.count)) / run.count)]


TRAIN = Step(_trained, _training_shares)

CODED: Shares = [("planning", 2), ("coding planes", 9)]

LISTED: Shares = [
    ("looking at views", 8),
    ("pruning", 12),
    ("correcting", 13),
    ("ranking", 6),
    ("coding", 4),
    ("measuring", 2),
]

AGAIN: Shares = [("pruning", 6), ("correcting", 13), ("coding", 8), ("measuring", 2)]
"""Behind all of these but the last for a target, for which most lists are pruned twice."""

PLANES = Kind(modes.DEFAULT_MODE, CODED, as_planes, foretold=planes_forecast)

LIST = Kind(
    modes.LIST,
    [("looking at views", 6), ("coding", 4), ("measuring", 2)],
    partial(as_list, coder=ranked),
    has_views=False,
    foretold=list_forecast,
    seen=for_network,
    making=(TRAIN,),
    qp=lambda photos: FEW_LIST_QP if photos <= FEW_PHOTOS else LIST_QP,
)

PHOTOS = Kind(modes.PHOTOS, CODED, as_photos, keeps_photos=True)

KINDS = {kind.mode: kind for kind in (PLANES, LIST, PHOTOS)}
"""By the modes that can be asked for."""


def kind_of(gaussians: Gaussians, coding: Coding, *, keep_all: bool = False, seconds: float = math.inf) -> Kind:
    """What Gaussians become that nobody here has made.

    Args:
        gaussians: per pixel, which become planes, or a list.
        coding: what may ask for planes.
        keep_all: keep every visible Gaussian of a list, not only those worth their bytes.
        seconds: time limit of pruning; Gaussians not examined by then are kept.
    """
    if gaussians.is_per_pixel or coding.lossless or coding.like is not None:
        return PLANES
    is_searched = coding.target_size is not None or coding.target_psnr is not None
    coder = kept if keep_all else partial(pruned, seconds=seconds, is_searched=is_searched)
    shares = LISTED[:-1] + AGAIN if is_searched and not keep_all else LISTED
    return Kind(modes.LIST, shares, partial(as_list, coder=coder), has_views=False)


def chosen(request: EncodeRequest, photos: Scene, told: Told) -> Kind:
    """What photos become: a list where it is asked for, or can be trained and nothing is asked for that planes alone
    have.

    Args:
        request: what is asked for.
        photos: what it is made of.
        told: is told what was chosen, or what it would take.

    Raises:
        InputError: a list is asked for without numba.
    """
    lacks = find_spec("numba") is None
    if request.mode == modes.LIST or request.train is not None or request.at_most is not None:
        if lacks:
            raise InputError('needs numba; pip install "tinysplat[fast]" brings it', where="mode")
        return LIST
    if request.mode is not None or request.fast or not _fits(request, photos):
        return KINDS[request.mode or modes.DEFAULT_MODE]
    if lacks:
        brings = 'pip install "tinysplat[fast]" brings what one trained list needs, sharper and smaller'
        told.say("notice", f"as planes of the network alone; {brings}", photos.path)
        return PLANES
    told.say("notice", "as one trained list; --fast leaves the network's Gaussians, one a pixel", photos.path)
    return LIST


def _fits(request: EncodeRequest, photos: Scene) -> bool:
    """Whether a list of so many photos has all that is asked for."""
    is_plain = request.model == DEFAULT_MODEL and request.joint and request.profile != "paper"
    return is_plain and not request.lossless and request.like is None and len(photos.frames) >= LEAST_EACH
