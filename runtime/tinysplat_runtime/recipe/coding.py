"""Gaussians to bytes: what codes them at any Q_g, what a target asks of it, and how faithful the file is."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..codec.job import EncodeStats, Job, PhotoScene
from ..codec.search import Coder, Once, code_to_psnr, code_to_size
from ..container.exact import Exact
from ..container.limits import Limits
from ..errors import warn
from ..gaussian.gaussians import Gaussians
from ..modes import PHOTOS
from ..modes.decoder import decode_gaussians
from ..modes.list import encoder as list_encoder
from ..modes.list import rounding_of
from ..modes.mode import find_mode
from ..modes.recode import encode_like
from ..render import Renderer
from ..scene.cameras import Camera
from ..system import disk
from ..system.decibels import decibels, mean_decibels
from ..system.evenly import evenly
from ..system.threads import Crew
from ..system.told import NOBODY, Told
from .forecast import prune_forecast
from .request import Coding
from .steps import Fidelity, Kind, Ready, Tools

if TYPE_CHECKING:
    from ..list.views import Views

MEASURED_VIEWS, MOST_JUDGED = 8, 16
"""Views in which the error of a list is measured; most views for Gaussians per pixel."""


def code(
    gaussians: Gaussians,
    coding: Coding,
    tools: Tools,
    kind: Kind,
    *,
    qp: float | None = None,
    photos: PhotoScene | None = None,
    stats: EncodeStats | None = None,
    told: Told = NOBODY,
) -> bytes:
    """Gaussians as a `.tsplat` file's bytes.

    Args:
        gaussians, coding: see `Runtime.compress`, whose errors these are.
        tools: to do it with.
        kind: what they become.
        qp: Q_g in place of `coding`'s.
        photos: what a network made them of, for files that carry it.
        stats: filled with what was measured; None to measure nothing that is only for people.
        told: who is told how far that is.
    """
    own, qp = stats or EncodeStats(), coding.step_qp if qp is None else qp
    own.mode = kind.mode
    job = Job(
        gaussians, coding.planes, qp, tools.store, tools.threads, own, coding.drop_invalid, photos=photos, told=told
    )
    ready = kind.ready(job, coding, tools.limits)
    if coding.target_size is not None:
        data = code_to_size(ready.coder(), coding.target_size)
    elif coding.target_psnr is not None:
        data = code_to_psnr(ready.coder(), coding.target_psnr, ready.fidelity())
    else:
        data = ready.coder().code(qp)
    if stats is not None and ready.views:
        disk.let_go()  # what coding took
        told.say("step", "measuring")
        with stats.watch.stage("measure"):
            stats.psnr = ready.fidelity()(data)
        stats.views = ready.views
    return data


def as_planes(job: Job, coding: Coding, limits: Limits) -> Ready:
    """Planes as HEVC, bit for bit, or like those of another file."""
    like = coding.example()
    if coding.lossless:
        job.stats.mode = Exact.mode

    def coder() -> Coder:
        mode = find_mode(job.stats.mode)
        found = Once(job.profile, lambda: encode_like(job, like, limits)) if like else mode.coder_of(job)
        job.told.say("step", "planning")
        return found

    cameras = job.gaussians.cameras
    return Ready(coder, lambda: _fidelity(job, limits, [cameras[at] for at in evenly(len(cameras), MOST_JUDGED)]))


def as_photos(job: Job, coding: Coding, limits: Limits) -> Ready:
    """The photos that a network made the Gaussians of."""
    cameras = job.gaussians.cameras
    return Ready(lambda: find_mode(PHOTOS).coder_of(job), lambda: _fidelity(job, limits, cameras))


def as_list(job: Job, coding: Coding, limits: Limits, coder: Callable[[Job, Views], Coder]) -> Ready:
    """Those Gaussians of a list that show, looked at from where people stand."""
    from ..list.views import from_anywhere, some, views_of
    from ..list.visible import visible

    job.told.say("step", "looking at views")
    shown = visible(job.gaussians)
    views = views_of(shown)
    looking = views if coding.target_psnr is None else from_anywhere(views, shown)
    judging = some(looking.judging, MEASURED_VIEWS)
    return Ready(
        coder=lambda: coder(replace(job, gaussians=shown), views),
        fidelity=lru_cache(lambda: _list_fidelity(job, limits, judging)),
        views=f"{len(judging)} views {looking.text}" if judging else "",
    )


def kept(job: Job, views: Views) -> Coder:
    """Codes all of a list."""
    return list_encoder(job, rounding_of(job, views))


def ranked(job: Job, views: Views) -> Coder:
    """Codes all of a list, in tiers: training has pruned it."""
    from ..list.pruning.tiers import ranked as in_tiers

    return list_encoder(job, rounding_of(job, views), in_tiers(job.gaussians, views, Crew(job.threads).map))


def pruned(job: Job, views: Views, *, seconds: float, is_searched: bool) -> Coder:
    """Codes what is worth its bytes, or all of it, with a warning, without numba or known viewpoints.

    Args:
        job: the list.
        views: where it is looked at from.
        seconds: time limit.
        is_searched: whether the file is to meet a target.
    """
    try:
        from ..list.pruning.encoder import PruningEncoder
    except ImportError as error:
        fault = f'all Gaussians are kept: to leave some out needs {error.name}; pip install "tinysplat[fast]" brings it'
        warn(fault)
        return kept(job, views)
    if not views.doubt:
        forecast = prune_forecast(job.gaussians, views, is_searched=is_searched)
        if forecast and seconds == math.inf:
            job.told.say("notice", forecast)
        return PruningEncoder(job, views, rounding_of(job, views), seconds=seconds)
    warn(f"all Gaussians are kept: {views.doubt}")
    if not job.gaussians.viewpoints:
        return kept(job, views)
    # looked at as if there were none
    return list_encoder(replace(job, gaussians=replace(job.gaussians, viewpoints=())))


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
