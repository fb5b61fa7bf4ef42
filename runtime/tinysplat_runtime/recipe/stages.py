"""The steps from a network's Gaussians to bytes, a function each: training and coding.

Each is given `Tools`, which a `Runtime` is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np

from ..codec.job import EncodeStats, Job, PhotoScene
from ..codec.search import Coder, Once, code_to_psnr, code_to_size
from ..container.exact import Exact
from ..container.limits import Limits
from ..container.list import List
from ..container.planes import Planes
from ..errors import fast_for, warn
from ..gaussian.gaussians import Gaussians
from ..graphs.inference import GraphStore
from ..modes import PHOTOS
from ..modes.decoder import decode_gaussians
from ..modes.mode import find_mode
from ..modes.recode import encode_like
from ..render import Renderer
from ..render.compare import mean_decibels
from ..scene.cameras import Camera
from ..scene.scenes import Scene
from ..system import disk
from ..system.decibels import decibels
from ..system.evenly import evenly
from ..system.threads import Crew
from ..system.told import NOBODY, Told
from .forecast import MANY, prune_forecast
from .request import Coding, EncodeRequest
from .words import Training

if TYPE_CHECKING:
    from ..list.views import Views

MEASURED_VIEWS, MOST_JUDGED = 8, 16
"""Views in which the error of a list is measured; most views for Gaussians per pixel."""

Fidelity: TypeAlias = Callable[[bytes], float]
"""PSNR (dB) of a file's pictures against those of the original Gaussians."""


class Tools(Protocol):
    """What every step works with.

    Attributes:
        store: opens graphs.
        threads: of each step; no result depends on them.
        limits: what a file may ask for when it is decoded.
    """

    store: GraphStore
    threads: int
    limits: Limits


def sparse(
    gaussians: Gaussians,
    scene: Scene,
    training: Training | None,
    count: int | None,
    tools: Tools,
    told: Told,
    *,
    size: int | None = None,
) -> Gaussians:
    """A list of at most so many Gaussians, and for so many bytes, that shows a capture's photos; see
    `list.training.train.trained`.
    """
    with fast_for("at_most"):
        from ..list.training.photos import targets_of
        from ..list.training.settings import Budget
        from ..list.training.train import TrainStats, trained
    stats, training = TrainStats(), training or Training()
    allowed = Budget(count, training.steps, training.seconds, size)
    targets = targets_of(scene.cameras, scene.frames)
    found = trained(gaussians, targets, allowed, threads=tools.threads, stats=stats, told=told)
    told.say("doubt" if stats.is_cut_short else "notice", stats.text)
    trained_on = f"{stats.steps} steps on {len(targets)} photos: {np.nanmean(stats.psnr):.1f} dB"
    return found.with_notes(replace(found.notes, refined=trained_on))


@dataclass(frozen=True)
class Pruning:
    """How a list is pruned.

    Attributes:
        keep_all: keep every visible Gaussian, not only those worth their bytes.
        seconds: time limit; Gaussians not examined by then are kept.
        is_done: training has already pruned the list: only rank it, for prefixes of the file.
    """

    keep_all: bool = False
    seconds: float = math.inf
    is_done: bool = False


def code(
    gaussians: Gaussians,
    coding: Coding,
    tools: Tools,
    *,
    pruning: Pruning | None = None,
    stats: EncodeStats | None = None,
    told: Told = NOBODY,
) -> bytes:
    """Gaussians as a `.tsplat` file's bytes.

    Args:
        gaussians: see `Runtime.compress`.
        coding: how.
        tools: to do it with.
        pruning: of a list; None for the usual.
        stats: filled with what was measured.
        told: who is told how far that is.

    Raises:
        FormatError, InputError, NumericError: as `Runtime.compress`.
    """
    profile, qp, own = coding.planes, coding.step_qp, stats or EncodeStats()
    job = Job(gaussians, profile, qp, tools.store, tools.threads, own, coding.drop_invalid, told=told)
    like = coding.example()
    if like is None and not coding.lossless and not gaussians.is_per_pixel:
        return _code_list(job, coding, tools.limits, pruning or Pruning(), is_measured=stats is not None)
    if like is not None:
        coder: Coder = Once(job.profile, lambda: encode_like(job, like, tools.limits))
    else:
        own.mode = (Exact if coding.lossless else Planes).mode
        coder = find_mode(own.mode).coder_of(job)
    told.say("step", "planning")
    cameras = gaussians.cameras
    judged = [cameras[index] for index in evenly(len(cameras), MOST_JUDGED)]
    return _meeting(coder, coding, job.qp, lambda: _fidelity(job, tools.limits, judged))


def _code_list(job: Job, coding: Coding, limits: Limits, pruning: Pruning, *, is_measured: bool) -> bytes:
    """Code a list; `is_measured` fills the stats with its error in the views that were used."""
    from ..list.views import from_anywhere, some, views_of
    from ..list.visible import visible

    job.stats.mode = List.mode
    job.told.say("step", "looking at views")
    shown = visible(job.gaussians)
    views = views_of(shown)
    looking = views if coding.target_psnr is None else from_anywhere(views, shown)
    fidelity = lru_cache(lambda: _list_fidelity(job, limits, some(looking.judging, MEASURED_VIEWS)))
    data = _meeting(_list_coder(replace(job, gaussians=shown), views, pruning), coding, job.qp, fidelity)
    disk.let_go()  # what coding took
    if is_measured and looking.judging:
        job.told.say("step", "measuring")
        with job.stats.watch.stage("measure"):
            job.stats.psnr = fidelity()(data)
        job.stats.views = f"{len(some(looking.judging, MEASURED_VIEWS))} views {looking.text}"
    return data


def _list_coder(job: Job, views: Views, pruning: Pruning) -> Coder:
    """A coder that prunes, or one that keeps all: if asked to, and with a warning without numba or known viewpoints."""
    from ..modes.list import encoder

    if pruning.keep_all:
        return encoder(job, views)
    if pruning.is_done:
        from ..list.pruning.tiers import ranked

        return encoder(job, views, ranked(job.gaussians, views, Crew(job.threads).map))
    try:
        from ..list.pruning.encoder import PruningEncoder
    except ImportError as error:
        fault = f'all Gaussians are kept: to leave some out needs {error.name}; pip install "tinysplat[fast]" brings it'
        warn(fault)
        return encoder(job, views)
    if not views.doubt:
        if job.gaussians.count >= MANY and pruning.seconds == math.inf:
            job.told.say("notice", prune_forecast(job.gaussians.count))
        return PruningEncoder(job, views, seconds=pruning.seconds)
    warn(f"all Gaussians are kept: {views.doubt}")
    if not job.gaussians.viewpoints:
        return encoder(job, views)
    return encoder(replace(job, gaussians=replace(job.gaussians, viewpoints=())))  # looked at as if there were none


def _meeting(coder: Coder, coding: Coding, qp: float, fidelity: Callable[[], Fidelity]) -> bytes:
    """The file that meets the target size or PSNR (measured by `fidelity`); without a target, the file at Q_g."""
    if coding.target_size is not None:
        return code_to_size(coder, coding.target_size)
    if coding.target_psnr is not None:
        return code_to_psnr(coder, coding.target_psnr, fidelity())
    return coder.code(qp)


def code_photos(
    gaussians: Gaussians, request: EncodeRequest, photos: PhotoScene, tools: Tools, *, stats: EncodeStats
) -> bytes:
    """A file of the mode that is asked for, which carries photos.

    Args:
        gaussians: what the network made of the photos.
        request: how.
        photos: what a network was given.
        tools: to do it with.
        stats: filled with what was measured, and the mode.
    """
    job = Job(gaussians, request.planes, request.step_qp, tools.store, tools.threads, stats, photos=photos)
    stats.mode = PHOTOS
    return find_mode(PHOTOS).encode(job)


def _list_fidelity(job: Job, limits: Limits, cameras: Sequence[Camera]) -> Fidelity:
    """PSNR of the mean squared error of a list over all cameras, drawn as 3DGS defines it."""
    from ..list.views import pictures_of

    wanted = pictures_of(job.gaussians.flat(), cameras, job.threads)

    def measure(data: bytes) -> float:
        found = pictures_of(decode_gaussians(data, job.store, threads=job.threads, limits=limits), cameras, job.threads)
        return decibels(
            float(np.mean([np.square(a - b).mean(dtype=np.float64) for a, b in zip(found, wanted, strict=True)]))
        )

    return measure


def _fidelity(job: Job, limits: Limits, cameras: Sequence[Camera]) -> Fidelity:
    """PSNR of a file's pictures to those of its Gaussians as `render` draws them by default, the mean over cameras."""
    # In numpy, so that no byte depends on whether numba is installed.
    store, threads = job.store, job.threads
    renderer = Renderer(job.gaussians, threads=threads, compiled=False)
    raw = [renderer.render(camera) for camera in cameras]

    def measure(data: bytes) -> float:
        again = decode_gaussians(data, store, threads=threads, limits=limits)
        return mean_decibels(map(Renderer(again, threads=threads, compiled=False).render, cameras), raw)

    return measure
