"""Read a container: bytes in, validated metadata and views of the coded pictures out.

Trust boundary: every length is checked against the bytes left and against `Limits` before anything is allocated, every
number against its range. Code past this point may index freely. Layout: docs/FORMAT.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError, InputError
from ..gaussian.planes import CODING_ORDER, GEOMETRY, MAX_QP, PlaneClass
from ..gaussian.sh import MAX_SH_DEGREE
from ..scene.cameras import MAX_POSITION, Camera
from . import layout as L
from .bounds import check_ranges, decoding_bytes
from .extras import (
    EXACT,
    EXACT_PLANES,
    NETWORK,
    PHOTO_PICTURES,
    PHOTOS,
    read_exact_layers,
    read_photo_mode,
)
from .free import FREE, FREE_POINTS, read_free
from .notes import MINOR, read_notes
from .records import ChannelRecord, Container, ExactLayer, LayerHeader, Limits, PhotoHeader, StreamRef
from .sections import Cursor, Section, only, read_table, require, verified


def read_container(data: bytes | memoryview, limits: Limits | None = None, *, is_prefix: bool = False) -> Container:
    """Parse and check a file.

    Args:
        data: the whole file, or its first bytes.
        limits: what to accept.
        is_prefix: accept `data` that ends before the file does, as long as it holds the metadata.

    Raises:
        FormatError: damaged, cut short, foreign, of an unknown version, or beyond the limits.
    """
    limits = limits or Limits()
    view = memoryview(data).cast("B") if not isinstance(data, bytes) else memoryview(data)
    version, total, sections = read_table(view, _KNOWN, _PLANE_KINDS, is_prefix=is_prefix)
    scene = only(sections, L.SCENE)
    cursor = Cursor(scene)
    views, n_layers, qp, *origin, profile = cursor.unpack(L.SCENE_FIXED)
    cursor.finish()
    require(math.isfinite(qp), scene, "Q_g is not finite")
    require(all(abs(x) <= MAX_POSITION for x in origin), scene, f"origin {origin}, at most {MAX_POSITION:g} accepted")
    if FREE in {section.kind for section in sections}:
        require(views == n_layers == 0, scene, f"{views} views and {n_layers} layers of Gaussians without pixels")
        return _free_container(version, _ascii(profile, scene), qp, np.array(origin), sections, total, limits)
    require(1 <= views <= limits.max_views, scene, f"{views} views, accepted are 1 to {limits.max_views}")
    network, photos = read_photo_mode(sections, views)
    fewest = 1 if photos is None else 0
    accepted = f"{n_layers} layers, accepted are {fewest} to {limits.max_layers}"
    require(fewest <= n_layers <= limits.max_layers, scene, accepted)
    poses = _read_cameras(only(sections, L.CAMERAS), views)
    exact = read_exact_layers(sections, n_layers, [c2w for _, c2w in poses], limits)
    layers, pixels, memory = [], 0, 0
    for index in range(0 if exact else n_layers):
        layer = _read_layer(only(sections, L.LAYER, index), index, poses)
        pixels += layer.gaussians
        memory += decoding_bytes(layer)
        where = f"section LAYR[{index}]"
        if pixels > limits.max_pixels:
            raise FormatError(f"{pixels} Gaussians, the limit is {limits.max_pixels} (--max-pixels)", where=where)
        if memory > limits.max_memory_bytes:
            raise FormatError(
                f"{memory} bytes to decode, the limit is {limits.max_memory_bytes} (--max-memory)", where=where
            )
        check_ranges(layer, np.array(origin), where)
        layers.append(layer)
    height, width = _grid(exact or layers, photos, views, limits)
    cameras = tuple(Camera(K, c2w, width, height) for K, c2w in poses)
    streams = {(c, i): _joined(sections, c, i, layer.channels) for i, layer in enumerate(layers) for c in _coded(layer)}
    sets = {s.index: verified(s) for s in sections if s.kind == L.PARAMETER_SETS}
    for index, layer in enumerate(layers):
        if _coded(layer) and layer.parameter_set not in sets:
            raise FormatError(f"parameter set {layer.parameter_set} is missing", where=f"section LAYR[{index}]")
    if photos is not None and photos.parameter_set not in sets:
        raise FormatError(f"parameter set {photos.parameter_set} is missing", where="section PHOT[0]")
    planes = tuple(s for s in sections if s.kind in _PLANE_KINDS)
    return Container(
        version, _ascii(profile, scene), qp, np.array(origin), cameras, tuple(layers), sets, streams, planes, total,
        network, photos, exact, notes=read_notes(sections),
    )  # fmt: skip


def _free_container(
    version: tuple[int, int], profile: str, qp: float, origin: NDArray, sections: list[Section], total: int,
    limits: Limits,
) -> Container:  # fmt: skip
    """A file of mode free: one scene without cameras, whose pictures lie as those of a layer 0 do."""
    scene = read_free(sections, limits)
    records = [channel.record for channel in scene.channels if channel.record.streams]
    streams = {(c, 0): _joined(sections, c, 0, records) for c in {record.plane_class for record in records}}
    sets = {0: verified(only(sections, L.PARAMETER_SETS))} if records else {}
    planes = tuple(s for s in sections if s.kind in _PLANE_KINDS)
    notes = read_notes(sections)
    return Container(version, profile, qp, origin, (), (), sets, streams, planes, total, free=scene, notes=notes)


def _grid(
    layers: Sequence[LayerHeader] | Sequence[ExactLayer], photos: PhotoHeader | None, views: int, limits: Limits
) -> tuple[int, int]:
    """Height and width of layer 0, which the photos share where there are any."""
    if photos is None:
        return layers[0].height, layers[0].width
    size = photos.height, photos.width
    if layers and size != (layers[0].height, layers[0].width):
        found = f"{photos.width}x{photos.height}, layer 0 is {layers[0].width}x{layers[0].height}"
        raise FormatError(found, where="section PHOT[0]")
    pixels = views * photos.height * photos.width
    if pixels > limits.max_pixels:
        found = f"{pixels} pixels of photos, the limit is {limits.max_pixels} (--max-pixels)"
        raise FormatError(found, where="section PHOT[0]")
    return size


_PLANE_KINDS = frozenset(L.PLANES.values())
_MODE_KINDS = frozenset({NETWORK, PHOTOS, PHOTO_PICTURES, EXACT, EXACT_PLANES, FREE, FREE_POINTS})
_KNOWN = {L.SCENE, L.CAMERAS, L.LAYER, L.PARAMETER_SETS, *MINOR, *_MODE_KINDS, *_PLANE_KINDS}


def _joined(
    sections: list[Section], plane_class: PlaneClass, index: int, channels: Sequence[ChannelRecord]
) -> memoryview:
    """The pictures of a class, whose sections have the indices layer, layer + PART, layer + 2·PART, … in this order.

    Pictures have a CRC each, checked when they are decoded.
    """
    kind = L.PLANES[plane_class]
    parts = [s for s in sections if s.kind == kind and s.index % L.PART == index]
    label = f"section {kind.decode('ascii')}[{index}]"
    if not parts:
        raise FormatError("missing", where=label)
    if [s.index // L.PART for s in parts] != list(range(len(parts))):
        raise FormatError("its parts are not each there once and in order", where=label)
    stated = sum(s.length for s in parts)
    last = [c.streams[-1] for c in channels if c.streams and c.plane_class == plane_class][-1]
    if last.offset + last.length != stated:
        raise FormatError(f"{stated} bytes, its pictures need {last.offset + last.length}", where=label)
    # A prefix ends in at most one section and holds nothing of those behind it, so that what is joined has no gap.
    return parts[0].data if len(parts) == 1 else memoryview(b"".join(s.data for s in parts))


def _ascii(raw: bytes, section: Section) -> str:
    try:
        return raw.rstrip(b"\0").decode("ascii")
    except UnicodeDecodeError:
        raise FormatError("profile name is not ASCII", where=section.label) from None


def _matrix(fx: float, fy: float, cx: float, cy: float, skew: float) -> NDArray:
    return np.array([[fx, skew, cx], [0, fy, cy], [0, 0, 1]])


def _read_cameras(section: Section, views: int) -> list[tuple[NDArray, NDArray]]:
    cursor = Cursor(section)
    poses = []
    for view in range(views):
        numbers = cursor.unpack(L.CAMERA)
        c2w = np.eye(4)
        c2w[:3] = np.reshape(numbers[5:], (3, 4))
        K = _matrix(*numbers[:5])
        try:
            Camera(K, c2w, 1, 1)
        except InputError as error:
            raise FormatError(error.message, where=f"{section.label}: view {view}: {error.where}") from None
        poses.append((K, c2w))
    cursor.finish()
    return poses


def _read_layer(section: Section, index: int, poses: list[tuple[NDArray, NDArray]]) -> LayerHeader:
    cursor = Cursor(section)
    height, width, degree, source_degree, flags, sets, n_channels, k, *numbers = cursor.unpack(L.LAYER_FIXED)
    z_min, z_max, lost, condition = numbers
    require(
        1 <= height <= L.MAX_SIDE and 1 <= width <= L.MAX_SIDE,
        section,
        f"grid {width}x{height}, sides are 1 to {L.MAX_SIDE}",
    )
    require(
        degree <= source_degree <= MAX_SH_DEGREE, section, f"SH degree {degree} of {source_degree}, accepted are 0 to 4"
    )
    require(
        0 < z_min <= z_max < math.inf, section, f"depth limits {z_min:g} to {z_max:g}, expected positive and ordered"
    )
    require(math.isfinite(lost) and 0 < condition < math.inf, section, "a number is out of range")
    require(flags < 32, section, f"unknown flags {flags:#x}")
    require(n_channels <= L.MAX_CHANNELS, section, f"{n_channels} channels, at most {L.MAX_CHANNELS}")
    own = [cursor.unpack(L.INTRINSICS) for _ in poses] if flags & L.OWN_INTRINSICS else None
    quats = mix = basis = None
    if flags & L.RELATIVE_ROTATION:
        quats = np.array([cursor.unpack(L.REFERENCE_QUAT) for _ in poses], np.float32)
        require(
            bool((np.abs(np.linalg.norm(quats.astype(np.float64), axis=1) - 1) < 1e-3).all()),
            section,
            "a reference quaternion is not of length 1",
        )
    if flags & L.SCALE_MIX:
        values = np.array(cursor.unpack(L.SCALE_MIX_FIELDS), np.float32)
        mix = (values[:9].reshape(3, 3), values[9:])
        require(bool(np.isfinite(values).all()), section, "the scale mix is not finite")
    d = 3 * (degree + 1) ** 2
    if flags & L.BASIS:
        require(1 <= k <= d, section, f"k = {k}, accepted are 1 to {d}")
        basis = np.frombuffer(cursor.take(d * k * 2), "<f2").reshape(d, k)
        require(bool(np.isfinite(basis).all()), section, "the basis is not finite")
    else:
        require(degree == 0 and k == 0, section, f"degree {degree} without a basis")
    targets = {**{c: s.stop - s.start for c, s in GEOMETRY.items()}, PlaneClass.COLOR: k or 3}
    channels = _read_channels(cursor, n_channels, targets, len(poses))
    cursor.finish()
    cameras = []
    for view, (K, c2w) in enumerate(poses):
        try:
            cameras.append(Camera(_matrix(*own[view]) if own else K, c2w, width, height))
        except InputError as error:
            raise FormatError(error.message, where=f"{section.label}: view {view}: {error.where}") from None
    return LayerHeader(
        height, width, degree, source_degree, (z_min, z_max), lost, condition, bool(flags & L.INVERSE_DEPTH),
        tuple(cameras), quats, mix, basis, sets, channels,
    )  # fmt: skip


def _read_channels(
    cursor: Cursor, count: int, targets: Mapping[PlaneClass, int], views: int
) -> tuple[ChannelRecord, ...]:
    section = cursor.section
    ends = dict.fromkeys(CODING_ORDER, 0)
    channels: list[ChannelRecord] = []
    for _ in range(count):
        number, target, coding, qp, scale, offset = cursor.unpack(L.CHANNEL)
        require(number in CODING_ORDER, section, f"plane class {number}, known are 0 to {CODING_ORDER[-1]:d}")
        plane_class = PlaneClass(number)
        require(target < targets[plane_class], section, f"{plane_class.label} has no channel {target}")
        require(coding in (L.CONSTANT, L.INTRA), section, f"coding {coding} is unknown")
        require(qp <= MAX_QP, section, f"QP {qp}, accepted are 0 to {MAX_QP}")
        require(
            abs(scale) < 1e30 and abs(offset) < 1e30,
            section,
            f"{plane_class.label}{target}: scale or offset out of range",
        )
        require(not channels or plane_class >= channels[-1].plane_class, section, "channels are out of order")
        is_first = all((plane_class, target) != (c.plane_class, c.target) for c in channels)
        require(is_first or plane_class == PlaneClass.DEPTH, section, f"{plane_class.label}{target} stands twice")
        streams = []
        for _ in range(views if coding == L.INTRA else 0):
            length, crc = cursor.unpack(L.STREAM)
            streams.append(StreamRef(ends[plane_class], length, crc))
            ends[plane_class] += length
        channels.append(ChannelRecord(plane_class, target, qp, scale, offset, tuple(streams)))
    return tuple(channels)


def _coded(layer: LayerHeader) -> set[PlaneClass]:
    return {channel.plane_class for channel in layer.channels if channel.streams}
