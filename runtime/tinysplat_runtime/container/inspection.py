"""What a `.tsplat` file holds, from its metadata alone: the object behind `info` and `--report`."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from ..gaussian.planes import CODING_ORDER, PlaneClass, hevc_step
from .layout import PART, PLANES
from .notes import NOTE_NAMES
from .reader import read_container
from .records import ChannelRecord, Container, LayerHeader, Limits
from .writer import pass_of


def inspect_bytes(data: bytes, limits: Limits | None = None, *, is_prefix: bool = False) -> dict[str, Any]:
    """Describe a file.

    Args:
        data: the whole file; with `is_prefix`, at least its metadata. What is described is always the whole file.
        limits: what to accept; None for the defaults.
        is_prefix: accept bytes that end before the file does.

    Returns:
        A JSON-ready object: version, mode, network, photos, notes, refined, profile, qp, views, height, width,
        gaussians, sh_degree, k, bytes, bytes_by_class, bytes_by_view, metadata_bytes, origin, cameras, layers, planes,
        prefixes, left_out.
        In mode photos, what only the network knows (gaussians, sh_degree, k) is None; without photos, network and
        photos are; in mode free, height and width.

    Raises:
        FormatError: damaged, cut short, foreign, or beyond the limits.
    """
    container = read_container(data, limits, is_prefix=is_prefix)
    camera = container.cameras[0] if container.cameras else None
    by_class, by_view = _bytes_by_class(container), _bytes_by_view(container)
    return {
        "version": ".".join(map(str, container.version)),
        "mode": container.mode,
        "network": asdict(container.network) if container.network else None,
        "photos": _photos(container),
        "notes": {name: getattr(container.notes, name) for name in NOTE_NAMES},
        "refined": container.notes.refined or None,
        "antialiased": bool(container.notes.antialiased),
        "profile": container.profile,
        "qp": container.qp,
        "views": len(container.cameras),
        "height": camera.height if camera else None,
        "width": camera.width if camera else None,
        **_sizes(container),
        "bytes": container.total_bytes,
        "bytes_by_class": by_class,
        "bytes_by_view": by_view,
        "metadata_bytes": container.total_bytes - sum(by_class.values()),
        "origin": container.origin.tolist(),
        "cameras": [{"K": c.K.tolist(), "c2w": c.c2w.tolist()} for c in container.cameras],
        "layers": [_layer(layer) for layer in container.layers],
        "planes": [_plane(index, channel) for index, channels in enumerate(container.channels) for channel in channels],
        "prefixes": _prefixes(container),
        "left_out": [entry for index, layer in enumerate(container.layers) for entry in _left_out(index, layer)],
    }


def _sizes(container: Container) -> dict[str, Any]:
    """Gaussians, degree and colour planes of the first layer, as far as the file says."""
    if container.free is not None:
        free = container.free
        return {"gaussians": free.count, "sh_degree": free.degree, "k": free.basis.shape[1]}
    layers = container.exact or container.layers
    return {
        "gaussians": sum(layer.gaussians for layer in layers) if layers else None,
        "sh_degree": layers[0].degree if layers else None,
        "k": _k(container.layers[0]) if container.layers else None,
    }


def _k(layer: LayerHeader) -> int:
    return 0 if layer.basis is None else layer.basis.shape[1]


def _streams(container: Container) -> list[tuple[PlaneClass, int, int]]:
    """(class, view, bytes) of every picture."""
    return [
        (channel.plane_class, view, stream.length)
        for channels in container.channels
        for channel in channels
        for view, stream in enumerate(channel.streams)
    ]


def _bytes_by_class(container: Container) -> dict[str, int]:
    totals = {plane_class.label: 0 for plane_class in CODING_ORDER}
    for plane_class, _, length in _streams(container):
        totals[plane_class.label] += length
    if container.photos is not None:
        totals["photos"] = len(container.photos.data)
    if container.exact:
        totals["exact"] = sum(len(layer.data) for layer in container.exact)
    if container.free is not None:
        totals["position"] = sum(map(len, container.free.grid.streams))
    return totals


def _bytes_by_view(container: Container) -> list[int]:
    totals = [0] * len(container.cameras)
    if not totals:
        return totals
    for _, view, length in _streams(container):
        totals[view] += length
    for view, stream in enumerate(container.photos.streams if container.photos else ()):
        totals[view] += stream.length
    for layer in container.exact:
        for number, stream in enumerate(layer.streams):
            totals[number // layer.planes] += stream.length
    return totals


def _photos(container: Container) -> dict[str, Any] | None:
    photos = container.photos
    if photos is None:
        return None
    size = {"height": photos.height, "width": photos.width, "qp": photos.qp}
    return {**size, "bytes": len(photos.data), "bytes_by_view": [stream.length for stream in photos.streams]}


def _layer(layer: LayerHeader) -> dict[str, Any]:
    return {
        "height": layer.height,
        "width": layer.width,
        "gaussians": layer.gaussians,
        "sh_degree": layer.degree,
        "k": _k(layer),
        "depth_limits": list(layer.depth_limits),
        "inverse_depth": layer.inverse_depth,
        "relative_rotation": layer.reference_quats is not None,
        "condition": layer.condition,
        "energy_lost": layer.energy_lost,
    }


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


def _prefixes(container: Container) -> list[dict[str, Any]]:
    """Useful numbers for `--max-bytes`: where a pass over a layer ends, and what it adds to those before it.

    Between a pass's sections a prefix decodes as well, but can show less than it does without the first of them.
    """
    class_of = {kind: plane_class for plane_class, kind in PLANES.items()}
    counts: dict[tuple[int, PlaneClass], int] = {}
    prefixes: list[dict[str, Any]] = []
    ending: tuple[int, int] | None = None
    for section in container.plane_sections:
        layer, plane_class = section.index % PART, class_of[section.kind]
        if layer >= len(container.channels):
            continue
        records = [c for c in container.channels[layer] if c.plane_class == plane_class and c.streams]
        first, left = counts.get((layer, plane_class), 0), section.length
        last = first
        while last < len(records) and left > 0:
            left -= sum(stream.length for stream in records[last].streams)
            last += 1
        counts[layer, plane_class] = last
        names, of_pass = [c.name for c in records[first:last]], (layer, pass_of(plane_class, first))
        if of_pass == ending:
            prefixes[-1]["adds"] += names
            prefixes[-1]["bytes"] = section.end
        else:
            prefixes.append({"bytes": section.end, "layer": layer, "adds": names})
        ending = of_pass
    return prefixes


def _left_out(index: int, layer: LayerHeader) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = []
    d, k = 3 * (layer.degree + 1) ** 2, _k(layer)
    if layer.degree < layer.source_degree:
        saved = 2 * k * (3 * (layer.source_degree + 1) ** 2 - d)  # of the basis, and its time and memory in a decoder
        entries.append(
            {
                "layer": index, "what": "sh degree", "kept": layer.degree, "of": layer.source_degree,
                "bytes_saved": saved,
            }
        )  # fmt: skip
    if 0 < k < d:
        entries.append(
            {"layer": index, "what": "color components", "kept": k, "of": d, "energy_lost": layer.energy_lost}
        )
    if layer.basis is None:
        entries.append({"layer": index, "what": "basis", "why": "SH degree 0 needs none"})
    entries += [
        {"layer": index, "what": f"plane {channel.name}", "why": "constant", "value": channel.offset}
        for channel in layer.channels
        if not channel.streams
    ]
    return entries
