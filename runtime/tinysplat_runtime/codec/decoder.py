"""A `.tsplat` file's bytes to Gaussians."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import local

import numpy as np
from numpy.typing import NDArray

from ..container.layout import ChannelRecord, Limits
from ..container.reader import Container, LayerHeader, read_container
from ..errors import FormatError
from ..gaussians import FIELDS, Gaussians
from ..inference import GraphStore, as_input
from ..quaternions import matrices_to_quats, multiply_quats
from ..reports import Stopwatch
from .hevc import PlaneDecoder
from .planes import GEOMETRY, GEOMETRY_CHANNELS, PlaneClass


def decode_gaussians(
    data: bytes,
    store: GraphStore,
    *,
    threads: int,
    limits: Limits | None = None,
    watch: Stopwatch | None = None,
) -> Gaussians:
    """Decode a file.

    Args:
        data: the whole file.
        store: opens the synthesis graphs.
        threads: planes decoded at a time.
        limits: what to accept.
        watch: filled with seconds per stage.

    Returns:
        Gaussians with cameras and all layers.

    Raises:
        FormatError: damaged, cut short, foreign, or beyond the limits.
    """
    watch = watch or Stopwatch()
    with watch.stage("parse"):
        container = read_container(data, limits)
    layers = []
    for index, layer in enumerate(container.layers):
        with watch.stage("libavcodec"):
            geometry, colors = _decode_planes(container, index, threads)
        with watch.stage("synthesis"):
            layers.append(_synthesise(container, layer, geometry, colors, store))
    return Gaussians.unchecked(
        **{name: getattr(layers[0], name) for name in FIELDS},
        cameras=container.cameras,
        origin=container.origin,
        extra_layers=tuple(layers[1:]),
    )


def _slots(layer: LayerHeader) -> tuple[dict[ChannelRecord, int], dict[ChannelRecord, int]]:
    """Plane index of every channel that has pictures, in the geometry and in the colour tensor."""
    coded = [c for c in layer.channels if c.streams]
    geometry = [c for c in coded if c.plane_class != PlaneClass.COLOR]
    colors = [c for c in coded if c.plane_class == PlaneClass.COLOR]
    if layer.basis is None:  # the planes are the coefficients themselves
        return {c: i for i, c in enumerate(geometry)}, {c: c.target for c in colors}
    return {c: i for i, c in enumerate(geometry)}, {c: i for i, c in enumerate(colors)}


def _decode_planes(container: Container, index: int, threads: int) -> tuple[NDArray, NDArray]:
    """Codes (V, P, H, W) of the geometry channels and (V, k, H, W) of the colour channels that have pictures."""
    layer = container.layers[index]
    views = len(layer.cameras)
    out, tasks = [], []
    for slots, least in zip(_slots(layer), (1, 3 if layer.basis is None else 1), strict=True):
        codes = np.zeros((views, max(least, len(slots)), layer.height, layer.width), np.uint16)
        out.append(codes)
        tasks += [(c, view, codes[view, plane]) for c, plane in slots.items() for view in range(views)]
    _run(_plane_decoder(container, index), tasks, threads)
    return out[0], out[1]


def _plane_decoder(container: Container, index: int) -> Callable[[tuple[ChannelRecord, int, NDArray]], None]:
    layer = container.layers[index]
    own = local()  # a libavcodec context per thread, kept from plane to plane

    def decode(task: tuple[ChannelRecord, int, NDArray]) -> None:
        channel, view, out = task
        payload = container.payload(index, channel, view)
        if not hasattr(own, "decoder"):
            own.decoder = PlaneDecoder(container.parameter_sets[layer.parameter_set], layer.height, layer.width)
        try:
            own.decoder.decode_into(payload, out)
        except FormatError as error:
            raise FormatError(error.message, where=f"plane {channel.name}, view {view}") from None

    return decode


def _run(decode: Callable[[tuple[ChannelRecord, int, NDArray]], None], tasks: Sequence, threads: int) -> None:
    if threads == 1 or len(tasks) < 2:
        for task in tasks:
            decode(task)
        return
    with ThreadPoolExecutor(max_workers=min(threads, len(tasks))) as pool:
        list(pool.map(decode, tasks))


def _synthesise(
    container: Container, layer: LayerHeader, geometry: NDArray, colors: NDArray, store: GraphStore
) -> Gaussians:
    """Run the synthesis graph; dequantisation and all linear maps are folded into matrices in float64."""
    cameras = layer.cameras
    views = len(cameras)
    mix, bias = _geometry_map(layer, geometry.shape[1])
    rotations = np.stack([camera.rotation.T for camera in cameras])
    quats = matrices_to_quats(rotations)
    if layer.reference_quats is not None:
        quats = multiply_quats(quats, layer.reference_quats.astype(np.float64))
    inputs = {
        "geometry_codes": geometry,
        "geometry_mix": as_input(np.broadcast_to(mix, (views, *mix.shape))),
        "geometry_bias": as_input(np.broadcast_to(bias, (views, *bias.shape))),
        "color_codes": colors,
        "K": as_input([camera.K for camera in cameras]),
        "rotation": as_input(rotations),
        "rotation_quat": as_input(quats),
        "centre": as_input([camera.centre - container.origin for camera in cameras]),
        "inverse_depth": as_input(layer.inverse_depth),
        "relative_rotation": as_input(layer.reference_quats is not None),
        "depth_limits": as_input(layer.depth_limits),
    }
    if layer.basis is None:
        step, offset = _plain_color_map(layer)
        return _run_synthesis(
            store, "synthesis_dc", {**inputs, "color_step": step, "color_bias": offset}, container, layer
        )
    color_mix, color_bias = _color_map(layer, layer.basis, colors.shape[1])
    return _run_synthesis(
        store, "synthesis", {**inputs, "color_mix": color_mix, "color_bias": color_bias}, container, layer
    )


def _run_synthesis(
    store: GraphStore, graph: str, inputs: dict[str, NDArray], container: Container, layer: LayerHeader
) -> Gaussians:
    arrays = store.transform(graph).run(inputs)
    return Gaussians.unchecked(**arrays, cameras=layer.cameras, origin=container.origin)


def _geometry_map(layer: LayerHeader, planes: int) -> tuple[NDArray, NDArray]:
    """(11, P) and (11,) float64: geometry channels = mix · codes + bias."""
    mix, bias = np.zeros((GEOMETRY_CHANNELS, planes)), np.zeros(GEOMETRY_CHANNELS)
    slots, _ = _slots(layer)
    for channel in layer.channels:
        if channel.plane_class == PlaneClass.COLOR:
            continue
        row = GEOMETRY[channel.plane_class].start + channel.target
        bias[row] += channel.offset
        if channel.streams:
            mix[row, slots[channel]] = channel.scale
    if layer.scale_mix is not None:
        rows = GEOMETRY[PlaneClass.SCALE]
        matrix, mean = (a.astype(np.float64) for a in layer.scale_mix)
        mix[rows], bias[rows] = matrix @ mix[rows], matrix @ bias[rows] + mean
    return mix, bias


def _color_map(layer: LayerHeader, basis: NDArray, planes: int) -> tuple[NDArray, NDArray]:
    """(P, d) and (d,) float32: SH coefficients = codes · mix + bias."""
    inverse = basis.astype(np.float64)
    mix, bias = np.zeros((planes, len(inverse))), np.zeros(len(inverse))
    _, slots = _slots(layer)
    for channel in layer.channels:
        if channel.plane_class == PlaneClass.COLOR:
            bias += inverse[:, channel.target] * channel.offset
            if channel.streams:
                mix[slots[channel]] = inverse[:, channel.target] * channel.scale
    return as_input(mix), as_input(bias)


def _plain_color_map(layer: LayerHeader) -> tuple[NDArray, NDArray]:
    """(3,) and (3,) float32: degree-0 coefficients = codes · step + offset."""
    step, offset = np.zeros(3), np.zeros(3)
    for channel in layer.channels:
        if channel.plane_class == PlaneClass.COLOR:
            step[channel.target], offset[channel.target] = channel.scale, channel.offset
    return as_input(step), as_input(offset)
