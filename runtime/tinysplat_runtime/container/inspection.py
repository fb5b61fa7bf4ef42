"""What a `.tsplat` file holds, from its metadata alone: the object behind `info` and `--report`."""

from __future__ import annotations

from ..gaussian.notes import OPTIONS
from ..gaussian.planes import CODING_ORDER, hevc_step
from ..system.jsonfields import JsonObject
from .body import Body, Container
from .limits import Limits
from .reader import read_container
from .records import ChannelRecord


def inspect_bytes(data: bytes, limits: Limits | None = None, *, is_prefix: bool = False) -> JsonObject:
    """Describe a file.

    Args:
        data: the whole file; with `is_prefix`, at least its metadata. What is described is always the whole file.
        limits: what to accept; None for files of any size, as their metadata alone is read.
        is_prefix: accept bytes that end before the file does.

    Returns:
        A JSON-ready object: version, mode, network, photos, notes, refined, antialiased, pruned, profile, qp, views,
        height, width, gaussians, sh_degree, k, bytes, bytes_by_class, bytes_by_view, metadata_bytes, origin, cameras,
        layers, planes, prefixes, left_out, tiers (Gaussians of each, in mode list; their `layer` elsewhere),
        viewpoints (cameras of photos, in mode list).
        In mode photos, what only the network knows (gaussians, sh_degree, k) is None; without photos, network and
        photos are; in mode list, height and width.

    Raises:
        FormatError: damaged, cut short, foreign, or beyond the limits.
    """
    container = read_container(data, limits or Limits.for_describing(), is_prefix=is_prefix)
    camera = container.cameras[0] if container.cameras else None
    own = container.body.describe()
    table, kind = container.table, type(container.body)
    by_class, by_view = _bytes(container)
    planes = [(layer, record) for layer in sorted(table.layers) for record in table.layers[layer]]
    return {
        "version": ".".join(map(str, container.version)),
        "mode": container.mode,
        "network": own.network,
        "photos": own.photos,
        "notes": {name: getattr(container.notes, name) for name in OPTIONS},
        "refined": container.notes.refined or None,
        "antialiased": bool(container.notes.antialiased),
        "pruned": container.notes.pruned or None,
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
        "planes": [_plane(layer, record) for layer, record in planes if record.plane_class in CODING_ORDER],
        "prefixes": table.prefixes(kind.step) if kind.step is not Body.step else [],
        "left_out": list(own.left_out),
        "tiers": list(own.tiers),
        "viewpoints": [
            {"K": c.K.tolist(), "c2w": c.c2w.tolist(), "width": c.width, "height": c.height} for c in own.viewpoints
        ],
    }


def _bytes(container: Container) -> tuple[dict[str, int], list[int]]:
    """Bytes by class, and by view; none of these without cameras."""
    by_class, by_view = {plane_class.label: 0 for plane_class in CODING_ORDER}, [0] * len(container.cameras)
    for _, record in container.table.rows:
        for view, picture in enumerate(record.pictures):
            label = record.plane_class.label
            by_class[label] = by_class.get(label, 0) + picture.length
            if by_view:
                by_view[view] += picture.length
    return by_class, by_view


def _plane(index: int, channel: ChannelRecord) -> JsonObject:
    lengths = [picture.length for picture in channel.pictures]
    entry: JsonObject = {
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
