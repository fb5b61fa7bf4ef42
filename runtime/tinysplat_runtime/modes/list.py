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


def encode(job: Job) -> bytes:
    """The file at the job's Q_g; InputError where no Gaussian shows, or for a Q_g beyond ±60."""
    return encoder(job).code(job.qp)


def encoder(job: Job, rounding: Rounding | None = None, tiers: Tiers | None = None) -> ListEncoder:
    """What codes the job's Gaussians at any Q_g; rounding and tiers as for `ListEncoder`."""
    from ..list.coding.encoder import ListEncoder

    job.told.say("step", "coding")
    return ListEncoder(job, rounding, tiers=tiers)


def decode(file: OpenFile, body: List) -> Gaussians:
    """The file's Gaussians, as one list; FormatError where what sorts them is not at hand."""
    with file.watch.stage("libavcodec"):
        found = decode_list(file, body.scene)
    return replace(found, viewpoints=body.viewpoints)


LIST = Mode(List.mode, encode, decode, encoder)
