"""A `.tsplat` file's bytes to Gaussians."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import local

import numpy as np
from numpy.typing import NDArray

from ..container.layout import ChannelRecord, Limits
from ..container.reader import Container, LayerHeader, read_container
from ..errors import FormatError
from ..gaussians import FIELDS, Gaussians
from ..inference import GraphStore, as_input
from ..predict import predict
from ..quaternions import matrices_to_quats, multiply_quats
from ..reports import Stopwatch
from .absent import PlaneRef, cut_off_planes, damaged_planes, first_picture_end, hidden_views, plane_name, stand_in_code
from .hevc import PlaneDecoder
from .hybrid import add_colors, as_codes, check_prediction, predicted_geometry
from .lossless import decode_exact
from .photos import decode_photos
from .planes import GEOMETRY, GEOMETRY_CHANNELS, PlaneClass


def decode_gaussians(
    data: bytes,
    store: GraphStore,
    *,
    threads: int,
    limits: Limits | None = None,
    max_bytes: int | None = None,
    lost: list[str] | None = None,
    model: str | None = None,
    watch: Stopwatch | None = None,
) -> Gaussians:
    """Decode a file.

    Args:
        data: the whole file; with `max_bytes`, at least that many of its first bytes.
        store: opens the synthesis graphs.
        threads: planes decoded at a time.
        limits: what to accept.
        max_bytes: decode from this many first bytes alone; `absent` says what stands in for the rest.
        lost: decode what is intact of a damaged or cut file; filled with the names of the planes that are not, for
            which the same stands in. None refuses such a file.
        model: the network for a file of photos: a path, or a name in the manifest; None to find it by its hash.
        watch: filled with seconds per stage.

    Returns:
        Gaussians with cameras and all layers.

    Raises:
        FormatError: damaged, cut short, foreign, or beyond the limits; a prefix too short for any picture; with
            `lost`, damaged metadata or no intact depth picture of layer 0.
        ModelError: the network that the file names is not at hand.
    """
    watch = watch or Stopwatch()
    with watch.stage("parse"):
        is_prefix = max_bytes is not None or lost is not None
        container = read_container(memoryview(data)[:max_bytes], limits, is_prefix=is_prefix)
        absent = cut_off_planes(container) if lost is None else damaged_planes(container)
        if lost is not None:
            lost += [plane_name(container, ref) for ref in sorted(absent)]
        _check_something_is_left(container, absent)
    return _decode(container, absent, store, threads, model, watch).with_notes(container.notes)


def _decode(
    container: Container,
    absent: Collection[PlaneRef],
    store: GraphStore,
    threads: int,
    model: str | None,
    watch: Stopwatch,
) -> Gaussians:
    """Gaussians of a file of any mode."""
    if container.exact:
        return _decode_exact(container, store, threads, watch)
    prediction = _predict(container, store, threads, model, watch) if container.photos else None
    if prediction is not None and not container.layers:
        return prediction
    layers = []
    for index, layer in enumerate(container.layers):
        with watch.stage("libavcodec"):
            geometry, colors = _decode_planes(container, index, threads, absent)
        with watch.stage("synthesis"):
            layers.append(
                _synthesise(container, layer, geometry, colors, store, _base(prediction, index, layer, store))
            )
            if prediction is None:
                layers[-1].opacities[hidden_views(layer, index, absent)] = 0
    return Gaussians.unchecked(
        **{name: getattr(layers[0], name) for name in FIELDS},
        cameras=container.cameras,
        origin=container.origin,
        extra_layers=tuple(layers[1:]),
    )


def _predict(container: Container, store: GraphStore, threads: int, model: str | None, watch: Stopwatch) -> Gaussians:
    """What the network that the file names makes of its photos."""
    photos, network = container.photos, container.network
    assert photos is not None and network is not None
    with watch.stage("libavcodec"):
        images = decode_photos(photos, container.parameter_sets[photos.parameter_set], threads)
    with watch.stage("network"):
        graph = store.network_by_hash(network.name, network.sha256, model)
        return predict(images, container.cameras, network.near, network.far, graph)


def _base(
    prediction: Gaussians | None, index: int, layer: LayerHeader, store: GraphStore
) -> tuple[NDArray, NDArray] | None:
    """Geometry and SH coefficients that a hybrid file's layer is added to."""
    if prediction is None:
        return None
    if index >= len(prediction.layers):
        raise FormatError(f"the network gives {len(prediction.layers)} layers", where=f"layer {index}")
    check_prediction(layer, prediction.layers[index], index)
    return predicted_geometry(store, prediction.layers[index], f"layer {index}"), prediction.layers[index].sh


def _decode_exact(container: Container, store: GraphStore, threads: int, watch: Stopwatch) -> Gaussians:
    layers = []
    for index, exact in enumerate(container.exact):
        with watch.stage("zlib"):
            geometry, sh = decode_exact(exact, threads)
        # A layer without channels: all that it is stands in the base.
        header = LayerHeader(
            exact.height, exact.width, 0, exact.degree, exact.depth_limits, 0.0, 1.0, True, exact.cameras, None, None,
            None, 0, (),
        )  # fmt: skip
        ones = np.ones((len(exact.cameras), 1, exact.height, exact.width), np.uint16)
        with watch.stage("synthesis"):
            layer = _synthesise(container, header, ones, ones, store, (geometry, sh[..., :1, :]))
        fields = {name: getattr(layer, name) for name in FIELDS} | {"sh": sh}
        if not all(np.isfinite(array).all() for array in fields.values()):
            raise FormatError("decodes to numbers beyond float32", where=f"layer {index}")
        layers.append(Gaussians.unchecked(**fields, cameras=exact.cameras, origin=container.origin))
    first = {name: getattr(layers[0], name) for name in FIELDS}
    rest = tuple(layers[1:])
    return Gaussians.unchecked(**first, cameras=container.cameras, origin=container.origin, extra_layers=rest)


def _check_something_is_left(container: Container, absent: Collection[PlaneRef]) -> None:
    if container.mode != "gaussians":
        return
    first = container.layers[0]
    if absent and len(hidden_views(first, 0, absent)) == len(first.cameras):
        end = first_picture_end(container)
        raise FormatError(f"holds no intact depth picture; the first of them ends at byte {end}", where="file")


def _slots(layer: LayerHeader) -> tuple[dict[ChannelRecord, int], dict[ChannelRecord, int]]:
    """Plane index of every channel that has pictures, in the geometry and in the colour tensor."""
    coded = [c for c in layer.channels if c.streams]
    geometry = [c for c in coded if c.plane_class != PlaneClass.COLOR]
    colors = [c for c in coded if c.plane_class == PlaneClass.COLOR]
    return {c: i for i, c in enumerate(geometry)}, {c: i for i, c in enumerate(colors)}


def _decode_planes(
    container: Container, index: int, threads: int, absent: Collection[PlaneRef]
) -> tuple[NDArray, NDArray]:
    """Codes (V, P + 1, H, W) of the geometry and (V, k + 1, H, W) of the colour channels; the last planes are ones."""
    layer = container.layers[index]
    views = len(layer.cameras)
    out, tasks = [], []
    for slots in _slots(layer):
        codes = np.empty((views, len(slots) + 1, layer.height, layer.width), np.uint16)
        codes[:, -1] = 1
        out.append(codes)
        for channel, plane in slots.items():
            number = layer.channels.index(channel)
            for view in range(views):
                if (index, number, view) in absent:
                    codes[view, plane] = stand_in_code(layer, number)
                else:
                    tasks.append((channel, view, codes[view, plane]))
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
    container: Container,
    layer: LayerHeader,
    geometry: NDArray,
    colors: NDArray,
    store: GraphStore,
    base: tuple[NDArray, NDArray] | None,
) -> Gaussians:
    """Run the synthesis graph; dequantisation and all linear maps are folded into matrices in float64.

    `base` is what the codes are added to: geometry planes (V, 11, H, W) and SH coefficients.
    """
    cameras = layer.cameras
    mix = _geometry_mix(layer, geometry.shape[1])
    if base is not None:
        codes, base_mix = as_codes(base[0])
        geometry = np.concatenate([codes, geometry], axis=1)
        mix[:, -1] += base_mix[:, -1]
        mix = np.concatenate([base_mix[:, :-1], mix], axis=1)
    rotations = np.stack([camera.rotation.T for camera in cameras])
    quats = matrices_to_quats(rotations)
    if layer.reference_quats is not None:
        quats = multiply_quats(quats, layer.reference_quats.astype(np.float64))
    arrays = store.transform("synthesis").run(
        {
            "geometry_codes": geometry,
            "geometry_mix": as_input(np.broadcast_to(mix, (len(cameras), *mix.shape))),
            "color_codes": colors,
            "color_mix": as_input(_color_mix(layer, colors.shape[1])),
            "K": as_input([camera.K for camera in cameras]),
            "rotation": as_input(rotations),
            "rotation_quat": as_input(quats),
            "centre": as_input([camera.centre - container.origin for camera in cameras]),
            "inverse_depth": as_input(layer.inverse_depth),
            "relative_rotation": as_input(layer.reference_quats is not None),
            "depth_limits": as_input(layer.depth_limits),
        }
    )
    arrays["sh"] = arrays["sh"].reshape(*arrays["opacities"].shape, -1, 3)
    if base is not None:
        arrays["sh"] = add_colors(arrays["sh"], base[1])
    return Gaussians.unchecked(**arrays, cameras=cameras, origin=container.origin)


def _geometry_mix(layer: LayerHeader, planes: int) -> NDArray:
    """(11, P + 1) float64: geometry channels = mix · codes, the last code being 1."""
    mix = np.zeros((GEOMETRY_CHANNELS, planes))
    slots, _ = _slots(layer)
    for channel in layer.channels:
        if channel.plane_class == PlaneClass.COLOR:
            continue
        row = GEOMETRY[channel.plane_class].start + channel.target
        mix[row, -1] += channel.offset
        if channel in slots:
            mix[row, slots[channel]] = channel.scale
    if layer.scale_mix is not None:
        rows = GEOMETRY[PlaneClass.SCALE]
        matrix, mean = (a.astype(np.float64) for a in layer.scale_mix)
        mix[rows] = matrix @ mix[rows]
        mix[rows, -1] += mean
    return mix


def _color_mix(layer: LayerHeader, planes: int) -> NDArray:
    """(k + 1, d) float64: SH coefficients = codes · mix, the last code being 1."""
    # Without VABR the colour planes are the three coefficients of degree 0 themselves.
    inverse = np.eye(3) if layer.basis is None else layer.basis.astype(np.float64)  # (d, k)
    mix = np.zeros((planes, len(inverse)))
    _, slots = _slots(layer)
    for channel in layer.channels:
        if channel.plane_class == PlaneClass.COLOR:
            mix[-1] += inverse[:, channel.target] * channel.offset
            if channel in slots:
                mix[slots[channel]] = inverse[:, channel.target] * channel.scale
    return mix
