"""Code Gaussians like a file: with its maps, ranges, steps and QPs, and its very pictures where nothing changed.

A decoded scene that is coded anew loses quality although nothing changed: steps are measured on other planes, and HEVC
is no fixed point of itself, because libx265 chooses other block sizes and directions for its own output. Here a
Gaussian that is still what the file decodes to takes the file's codes, and a picture all of whose Gaussians are takes
the file's bytes: an untouched scene becomes the same planes to the bit, an edited one pays where it was edited.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..codec.analysis import ProjectedLayer, color_planes, project_layer, relative_rotation_planes
from ..codec.basis import left_inverse, mean_magnitude_weighting, second_moment_weighting, view_directions
from ..codec.encoder import write_planes
from ..codec.hevc import CodedPlane, encode_plane
from ..codec.job import EncodeStats, Job
from ..codec.one_colour import as_seen
from ..codec.profiles import EncoderSettings, PaperSettings, Profile, find_profile
from ..codec.quantise import CodeMap
from ..container.body import Container
from ..container.layers import CodedLayer, LayerHeader
from ..container.limits import Limits
from ..container.planes import Planes
from ..container.reader import read_container
from ..container.records import ChannelRecord, Picture
from ..errors import InputError, within
from ..gaussian.gaussians import Gaussians
from ..gaussian.planes import LayerPlan, PlaneClass, Reduction
from ..gaussian.sh import resized_sh
from ..graphs.inference import GraphStore
from ..system.threads import Crew
from .decoder import decode_file

SAME = 0.25
"""Codes that a value may differ by from what the file decodes to and still be the same: rounding of a format on the
way (.ply has logarithms and logits) moves values by less, an eighth of the finest quantiser step is ten times more."""

_LEAST_SCALE = 1e-30
_WHERE = "like"


@dataclass
class _Target:
    """What the channels of one class and number add up to.

    Attributes:
        values: (V, H, W) wanted.
        rest: what the channels coded so far have left of it.
        same: (V, H, W) whether the value is still what the file decodes to.
    """

    values: NDArray
    rest: NDArray
    same: NDArray


def encode_like(job: Job, file: bytes, limits: Limits | None = None) -> bytes:
    """Code all layers as a file's were.

    Args:
        job: its Gaussians are per pixel, with cameras, of the file's views, layers and grids; SH of another degree are
            cut or filled with zeros, and where the file has degree 0, one colour takes their place as the input views
            see it. Its profile and Q_g play no part.
        file: a `.tsplat` file of planes.
        limits: what to accept of the file.

    Returns:
        A file of the same profile, Q_g, maps, steps and QPs, and with the cameras of the job's Gaussians.

    Raises:
        FormatError: the file is damaged.
        InputError: it is of another mode, or of a profile that is none; other views, layers or grids.
        NumericError: as `SceneEncoder`.
    """
    gaussians, stats = job.gaussians, job.stats
    with stats.watch.stage("parse"), within(_WHERE):
        container = example(file, limits)
        layers, profile = _checked(gaussians, container)
        earlier = decode_file(container, job.store, threads=job.threads)
    coded, crew = [], Crew(job.threads)
    for index, layer in enumerate(layers):
        pair = gaussians.layers[index], earlier.layers[index]
        coder = _LayerCoder(container, layer, profile.encoder, crew, stats)
        coded.append(coder.code(*_targets(job, layer, *pair, profile)))
    return write_planes(coded, gaussians, profile, container.qp, stats)


def example(file: bytes, limits: Limits | None = None) -> Container:
    """What a file holds that others can be coded like.

    Raises:
        FormatError: the file is damaged.
        InputError: it is of another mode.
    """
    container = read_container(file, limits)
    if not isinstance(container.body, Planes):
        raise InputError(f"a file of mode {container.mode}, expected {Planes.mode}")
    return container


def _checked(gaussians: Gaussians, container: Container) -> tuple[tuple[LayerHeader, ...], Profile]:
    """The file's layers and profile; InputError unless the file can serve as the scene's model."""
    assert isinstance(container.body, Planes)
    gaussians.check_pixels()
    found = [layer.opacities.shape for layer in gaussians.layers]
    wanted = [(len(layer.cameras), layer.height, layer.width) for layer in container.body.layers]
    if found != wanted:
        raise InputError(f"grids {_grids(found)}, those of the file are {_grids(wanted)}", where="gaussians")
    for index, layer in enumerate(container.body.layers):
        for channel in layer.channels:
            if channel.pictures and not channel.scale > _LEAST_SCALE:
                found_scale = f"plane {channel.name} of layer {index} has {channel.scale:g} units per code"
                raise InputError(f"{found_scale}, expected more than {_LEAST_SCALE:g}", where=_WHERE)
    return container.body.layers, find_profile(container.profile)


def _grids(shapes: Sequence[tuple[int, ...]]) -> str:
    return ", ".join("x".join(map(str, shape)) for shape in shapes)


def _targets(
    job: Job, header: LayerHeader, layer: Gaussians, earlier: Gaussians, profile: Profile
) -> tuple[dict[tuple[PlaneClass, int], _Target], LayerPlan]:
    """What every channel of a layer is to hold, and the maps behind them."""
    both = layer, earlier
    with job.stats.watch.stage("vpt"):
        projected = [project_layer(job.store, one, drop_invalid=job.drop_invalid, where="") for one in both]
    with job.stats.watch.stage("vabr"):
        reduction = _reduction(header, profile)
        colors = [_colours(job.store, one, header, reduction) for one in both]
    wanted, decoded = ({**_geometry(p, header), **c} for p, c in zip(projected, colors, strict=True))
    if header.reference_quats is None:  # q and −q are one rotation: the sign is the file's
        rotation = [(PlaneClass.ROTATION, n) for n in range(4)]
        sign = np.where(sum(wanted[key] * decoded[key] for key in rotation) < 0, np.float32(-1), np.float32(1))
        wanted |= {key: sign * wanted[key] for key in rotation}
    targets = {}
    for key in {channel.key: None for channel in header.channels}:
        scales = [channel.scale for channel in header.channels if channel.key == key and channel.pictures]
        tolerance = SAME * min(scales) if scales else 1e-5 * (1 + np.abs(decoded[key]))
        same = np.abs(wanted[key].astype(np.float64) - decoded[key]) <= tolerance
        targets[key] = _Target(wanted[key], wanted[key], same)
    low, high = header.depth_limits
    depth = targets.get((PlaneClass.DEPTH, 0))
    if depth is not None and not depth.same.all():  # the limits reach as far beyond as Gaussians that are new
        new = projected[0].geometry[:, 0][~depth.same]
        low, high = min(low, float(new.min())), max(high, float(new.max()))
    maps = header.reference_quats, header.scale_mix, reduction
    return targets, LayerPlan((), header.degree, (low, high), header.inverse_depth, None, *maps)


def _reduction(header: LayerHeader, profile: Profile) -> Reduction | None:
    """The file's basis, and the forward map that belongs to it under the profile's weighting."""
    if header.basis is None:
        return None
    directions, is_paper = view_directions(header.cameras), isinstance(profile.settings, PaperSettings)
    weighting = (mean_magnitude_weighting if is_paper else second_moment_weighting)(directions, header.degree)
    return Reduction(header.basis, left_inverse(header.basis, weighting), header.energy_lost, header.condition)


def _colours(
    store: GraphStore, layer: Gaussians, header: LayerHeader, reduction: Reduction | None
) -> dict[tuple[PlaneClass, int], NDArray]:
    if header.degree == 0:
        layer = as_seen(layer, np.inf) or layer
    sh = np.ascontiguousarray(resized_sh(layer.sh, (header.degree + 1) ** 2))
    if reduction is None:
        planes = np.moveaxis(sh[..., 0, :], -1, 1)
    else:
        planes = color_planes(store, replace(layer, sh=sh, extra_layers=()), reduction.projection)
    return {(PlaneClass.COLOR, k): planes[:, k] for k in range(planes.shape[1])}


def _geometry(projected: ProjectedLayer, header: LayerHeader) -> dict[tuple[PlaneClass, int], NDArray]:
    """Planes (V, H, W) in the file's own units."""
    depth, scales = projected.planes(PlaneClass.DEPTH), projected.planes(PlaneClass.SCALE)
    if header.inverse_depth:
        depth = -1 / depth
    if header.scale_mix is not None:
        matrix, mean = (a.astype(np.float64) for a in header.scale_mix)
        scales = np.einsum("pc,vchw->vphw", np.linalg.pinv(matrix), scales - mean[:, None, None]).astype(np.float32)
    rotation = projected.planes(PlaneClass.ROTATION)
    if header.reference_quats is not None:
        vector = relative_rotation_planes(projected, header.reference_quats.astype(np.float64))
        rotation = np.concatenate([np.zeros_like(depth), vector], axis=1)  # w is rebuilt, whatever a file says of it
    planes = {
        PlaneClass.DEPTH: depth,
        PlaneClass.SCALE: scales,
        PlaneClass.ROTATION: rotation,
        PlaneClass.OPACITY: projected.planes(PlaneClass.OPACITY),
        PlaneClass.OFFSET: projected.planes(PlaneClass.OFFSET),
    }
    return {(c, target): values[:, target] for c, values in planes.items() for target in range(values.shape[1])}


class _LayerCoder:
    """Codes the channels of one layer, keeping the file's pictures where they still say what is wanted."""

    def __init__(
        self, container: Container, layer: LayerHeader, settings: EncoderSettings, crew: Crew, stats: EncodeStats
    ) -> None:
        self._container, self._header = container, layer
        self._settings, self._crew, self._stats = settings, crew, stats
        self._sets = container.parameter_sets.get(layer.parameter_set, b"")

    def code(self, targets: dict[tuple[PlaneClass, int], _Target], plan: LayerPlan) -> CodedLayer:
        """The layer ready for the file."""
        clipped = dict(self._stats.clipped)
        channels, sets = self._channels(targets)
        if sets - {self._sets}:  # another libx265, whose pictures need other parameter sets: none of the file's stays
            self._stats.clipped = clipped
            fresh = {key: _Target(t.values, t.values, np.zeros_like(t.same)) for key, t in targets.items()}
            channels, sets = self._channels(fresh)
            self._sets = next(iter(sets))
        header = self._header
        degree = max(header.source_degree, plan.degree)
        return CodedLayer(header.height, header.width, degree, plan, tuple(channels), self._sets, header.cameras)

    def _channels(self, targets: dict[tuple[PlaneClass, int], _Target]) -> tuple[list[ChannelRecord], set[bytes]]:
        """All channels, and the parameter sets of the pictures that were coded anew."""
        channels, sets = [], set[bytes]()
        for record in self._header.channels:
            target = targets[record.key]
            if record.pictures:
                with self._stats.watch.stage("x265"):
                    channels.append(self._coded(record, target, sets))
            else:
                is_same, mean = target.same.all(), float(target.rest.mean(dtype=np.float64))
                value = record.offset if is_same else mean
                channels.append(replace(record, offset=value))
        return channels, sets

    def _coded(self, record: ChannelRecord, target: _Target, sets: set[bytes]) -> ChannelRecord:
        code_map = CodeMap(record.scale, record.offset, record.qp)
        codes, clipped = code_map.quantise(target.rest)
        self._stats.add_clipped(record.plane_class, clipped)
        views = range(len(codes))
        coded = self._crew.map(lambda view: self._picture(record, codes[view], target.same[view], view), views)
        for view, (plane, _, is_fresh) in enumerate(coded):
            if is_fresh:
                sets.add(plane.parameter_sets)
                target.same[view] = False  # what a second channel adds to this one changes with it
        target.rest = target.rest - code_map.dequantise(np.stack([decoded for _, decoded, _ in coded]))
        return replace(record, pictures=Picture.each_of(plane.payload for plane, _, _ in coded))

    def _picture(
        self, record: ChannelRecord, codes: NDArray, same: NDArray, view: int
    ) -> tuple[CodedPlane, NDArray, bool]:
        """A picture, what it decodes to, and whether it was coded anew."""
        sets = self._container.parameter_sets[self._header.parameter_set]
        earlier = CodedPlane(sets, bytes(self._container.table.payload(record, view)))
        decoded = earlier.decoded(*codes.shape)
        if same.all():
            return earlier, decoded, False
        coded = encode_plane(np.where(same, decoded, codes), record.qp, self._settings)
        return coded, coded.decoded(*codes.shape), True
