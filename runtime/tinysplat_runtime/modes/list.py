"""Mode `list`: Gaussians that belong to no pixels, such as a trained or an edited scene."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..codec.job import Job
from ..codec.layers import OpenFile
from ..container.list import List
from ..gaussian.gaussians import Gaussians
from ..list.coding.decoder import decode_list
from .mode import Mode

if TYPE_CHECKING:  # who decodes loads no encoder
    from ..list.coding.encoder import ListEncoder
    from ..list.coding.levels import Tiers
    from ..list.coding.rounding import Rounding
    from ..list.views import Views


def encode(job: Job) -> bytes:
    """The file at the job's Q_g; InputError where no Gaussian shows, or for a Q_g beyond ±60."""
    return encoder(job).code(job.qp)


def encoder(job: Job, rounding: Rounding | None = None, tiers: Tiers | None = None) -> ListEncoder:
    """What codes the job's Gaussians at any Q_g; tiers as for `ListEncoder`, and so is rounding, where it is known."""
    from ..list.coding.encoder import ListEncoder
    from ..list.views import views_of
    from ..list.visible import visible

    if rounding is None:
        job = replace(job, gaussians=visible(job.gaussians))
        rounding = rounding_of(job, views_of(job.gaussians))
    job.told.say("step", "coding")
    return ListEncoder(job, rounding, tiers=tiers)


def rounding_of(job: Job, views: Views) -> Rounding:
    """How coarsely the job's Gaussians, each of which shows, are coded for such views."""
    from ..list.coding.rounding import Rounding

    with job.stats.watch.stage("steps"):
        return Rounding.of(job.gaussians, views, job.threads, job.profile.list_steps)


def decode(file: OpenFile, body: List) -> Gaussians:
    """The file's Gaussians, as one list; FormatError where what sorts them is not at hand."""
    with file.watch.stage("libavcodec"):
        found = decode_list(file, body.scene)
    return replace(found, viewpoints=body.viewpoints)


LIST = Mode(List.mode, encode, decode, encoder)
