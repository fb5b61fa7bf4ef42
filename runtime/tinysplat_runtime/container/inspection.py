"""What a `.tsplat` file holds, from its metadata alone: the object behind `info` and `--report`."""

from __future__ import annotations

from typing import Any

from ..gaussian.planes import CODING_ORDER, hevc_step
from .body import Container, Description, Piece
from .notes import NOTE_NAMES
from .reader import read_container
from .records import ChannelRecord, Limits


def inspect_bytes(data: bytes, limits: Limits | None = None, *, is_prefix: bool = False) -> dict[str, Any]:
    """Describe a file.

    Args:
        data: the whole file; with `is_prefix`, at least its metadata. What is described is always the whole file.
        limits: what to accept; None for files of any size, as their metadata alone is read.
        is_prefix: accept bytes that end before the file does.

    Returns:
        A JSON-ready object: version, mode, network, photos, notes, refined, antialiased, thinned, profile, qp, views,
        height, width, gaussians, sh_degree, k, bytes, bytes_by_class, bytes_by_view, metadata_bytes, origin, cameras,
        layers, planes, prefixes, left_out, tiers (Gaussians of each, in mode free; their `layer` elsewhere),
        viewpoints (cameras of photos, in mode free).
        In mode photos, what only the network knows (gaussians, sh_degree, k) is None; without photos, network and
        photos are; in mode free, height and width.

    Raises:
        FormatError: damaged, cut short, foreign, or beyond the limits.
    """
    container = read_container(data, limits or Limits.for_describing(), is_prefix=is_prefix)
    camera = container.cameras[0] if container.cameras else None
    own = container.body.describe()
    by_class, by_view = _bytes(container, own)
    return {
        "version": ".".join(map(str, container.version)),
        "mode": container.mode,
        "network": own.network,
        "photos": own.photos,
        "notes": {name: getattr(container.notes, name) for name in NOTE_NAMES},
        "refined": container.notes.refined or None,
        "antialiased": bool(container.notes.antialiased),
        "thinned": container.notes.thinned or None,
        "profile": container.profile,
        "qp": container.qp,
        "views": len(container.cameras),
        "height": camera.height if camera else None,
        "width": camera.width if camera else None,
        "gaussians": own.gaussians,
        "sh_degree": own.sh_degree,
        "k": own.k,
        "bytes": container.total_bytes,
        "bytes_by_class": by_class,
        "bytes_by_view": by_view,
        "metadata_bytes": container.total_bytes - sum(by_class.values()),
        "origin": container.origin.tolist(),
        "cameras": [{"K": c.K.tolist(), "c2w": c.c2w.tolist()} for c in container.cameras],
        "layers": list(own.layers),
        "planes": [
            _plane(index, channel) for index, channels in enumerate(container.pictures.channels) for channel in channels
        ],
        "prefixes": container.pictures.prefixes(),
        "left_out": list(own.left_out),
        "tiers": list(own.tiers),
        "viewpoints": [
            {"K": c.K.tolist(), "c2w": c.c2w.tolist(), "width": c.width, "height": c.height} for c in own.viewpoints
        ],
    }


def _bytes(container: Container, own: Description) -> tuple[dict[str, int], list[int]]:
    """Bytes by class of pictures or label of pieces, and by view; none of these without cameras."""
    by_class, by_view = {plane_class.label: 0 for plane_class in CODING_ORDER}, [0] * len(container.cameras)
    pictures = [
        Piece(channel.plane_class.label, view, stream.length)
        for channels in container.pictures.channels
        for channel in channels
        for view, stream in enumerate(channel.streams)
    ]
    for piece in (*pictures, *own.pieces):
        by_class[piece.label] = by_class.get(piece.label, 0) + piece.bytes
        if by_view and piece.view is not None:
            by_view[piece.view] += piece.bytes
    return by_class, by_view


def _plane(index: int, channel: ChannelRecord) -> dict[str, Any]:
    lengths = [stream.length for stream in channel.streams]
    entry: dict[str, Any] = {
        "layer": index,
        "name": channel.name,
        "class": channel.plane_class.label,
        "coding": "intra" if lengths else "constant",
        "bytes": sum(lengths),
    }
    if not lengths:
        return {**entry, "value": channel.offset}
    step = hevc_step(channel.qp) * channel.scale
    return {**entry, "bytes_by_view": lengths, "qp": channel.qp, "step": step}
