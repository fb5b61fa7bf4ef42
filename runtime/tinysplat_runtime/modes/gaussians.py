"""Mode `gaussians`: planes of what a network made, which any receiver decodes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..codec.job import Job
from ..codec.layers import OpenFile, decode_layers, first_picture_end, hidden_views
from ..container.planes import Planes
from ..errors import FormatError
from ..gaussian.gaussians import Gaussians
from .mode import Mode

if TYPE_CHECKING:  # who decodes loads no encoder
    from ..codec.rate import PlanesCoder


def encode(job: Job) -> bytes:
    """The file at the job's Q_g; errors of `SceneEncoder`."""
    from ..codec.encoder import SceneEncoder

    return SceneEncoder(job).encode(job.qp)


def coder(job: Job) -> PlanesCoder:
    """What codes the job's Gaussians at any Q_g."""
    from ..codec.encoder import SceneEncoder
    from ..codec.rate import PlanesCoder

    return PlanesCoder(SceneEncoder(job))


def decode(file: OpenFile, body: Planes) -> Gaussians:
    """The file's Gaussians; FormatError where no depth picture of the first layer is at hand."""
    first = body.layers[0]
    if len(hidden_views(first)) == len(first.cameras):
        end = first_picture_end(body)
        raise FormatError(f"holds no intact depth picture; the first of them ends at byte {end}", where="file")
    return decode_layers(file, body)


GAUSSIANS = Mode(Planes.mode, encode, decode, coder)
