"""Mode `lossless`: planes as float16, bit for bit; `exact` has what is guaranteed."""

from functools import partial
from hashlib import sha256

import numpy as np

from ..codec.exact import decode_exact, exact_planes, pack
from ..codec.job import Job
from ..codec.layers import OpenFile
from ..codec.synthesis import LayerSynthesis
from ..container.exact import Exact, ExactLayer, exact_rows, exact_section
from ..container.layers import LayerMaps
from ..container.records import Picture
from ..container.sections import NewSection
from ..container.table import Row
from ..container.writer import Head, write_container
from ..errors import FormatError
from ..gaussian.gaussians import FIELDS, Gaussians
from ..system.threads import Crew
from .mode import Mode


def encode(job: Job) -> bytes:
    """The file; profile and Q_g play no part.

    Raises:
        InputError: a list.
        NumericError: Gaussians at or behind their own camera, or planes beyond float16.
    """
    gaussians = job.gaussians
    gaussians.check_pixels()
    cameras, sections, rows = gaussians.cameras, list[NewSection](), list[Row]()
    crew = Crew(job.threads)
    with job.stats.watch.stage("zlib"):
        for index, layer in enumerate(gaussians.layers):
            planes, limits = exact_planes(job.store, layer, job.drop_invalid, f"layer {index}")
            packed = crew.map(pack, planes.swapaxes(0, 1).reshape(-1, *planes.shape[2:]))
            per_plane = (packed[at : at + len(cameras)] for at in range(0, len(packed), len(cameras)))
            pictures, digest = tuple(map(Picture.each_of, per_plane)), sha256(planes.tobytes()).digest()
            coded = ExactLayer(layer.cameras, layer.degree, limits, digest, pictures)
            sections.append(exact_section(coded, index, cameras))
            rows += exact_rows(coded, index)
        head = Head(cameras, gaussians.origin, LOSSLESS.name, 0.0, gaussians.notes)
        return write_container(head, sections, rows, len(gaussians.layers))


def decode(file: OpenFile, body: Exact) -> Gaussians:
    """The file's Gaussians; FormatError where they are not those that were written."""
    crew = Crew(file.threads)
    layers = [_decode_layer(file, exact, f"layer {n}", crew) for n, exact in enumerate(body.layers)]
    return Gaussians.stacked(layers).changed(cameras=file.container.cameras)


def _decode_layer(file: OpenFile, exact: ExactLayer, where: str, crew: Crew) -> Gaussians:
    origin = file.container.origin
    with file.watch.stage("zlib"):
        geometry, sh = decode_exact(exact, crew)
    # A layer without channels: all that it is stands in the base.
    maps = LayerMaps(cameras=exact.cameras, depth_limits=exact.depth_limits)
    with file.watch.stage("synthesis"):
        synthesis = LayerSynthesis(maps, origin, file.store, geometry)
        no_codes = np.ones((1, exact.height, exact.width), np.uint16)
        crew.map(partial(synthesis.run, geometry=no_codes), range(len(exact.cameras)))
        layer = synthesis.gaussians()
    fields = {name: getattr(layer, name) for name in FIELDS} | {"sh": sh}
    if not all(np.isfinite(array).all() for array in fields.values()):
        raise FormatError("decodes to numbers beyond float32", where=where)
    return Gaussians.unchecked(**fields, cameras=exact.cameras, origin=origin)


LOSSLESS = Mode(Exact.mode, encode, decode)
