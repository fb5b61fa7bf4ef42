"""What are VPT and VABR worth? The paper's figures: channels before and after VPT, and the profile `paper` with VPT or
VABR taken away (the choice of k is the study `reduction`). The paper prints these as pictures alone, so its statements
are all that can be quoted: without VPT or VABR the curves fall, quality is flat beyond k = 6, the first component takes
most bits.

Every variant takes the real file of the profile `paper` and replaces one part, coded by the same rules: a class's α and
Q_c, the 14-bit window, 12-bit codes through the same encoder. Sizes are those of the real file less the planes that
are replaced, plus the planes that replace them.

    without VPT     x, y, z in the world with depth's α and Q_c in place of depth and offset; world scales and rotations
    without VABR    the first k SH coefficients (degree by degree, red, green, blue), or all, each a plane; one step
                    for all of them, from the one of largest σ, as VABR's components share one
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.analysis import project_layer
from tinysplat_runtime.codec.profiles import PAPER, PROFILES, EncoderSettings
from tinysplat_runtime.codec.quantise import choose_code_map
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.planes import Channel, PlaneClass
from tinysplat_runtime.graphs.inference import GraphStore

from ..pictures import Pictures
from ..rows import Row, grouped, of_study
from ..show.plots import Axis, Chart, Curve, Panel, save_grid
from ..show.tables import Listing, decibels, digits, kilobytes, mean, said
from ..study import Run, Study
from ..tasks import through_hevc

QPS, QUICK_QPS = (-6.0, 0.0, 6.0, 12.0), (0.0, 12.0)
_BINS, _SHOWN = 100, (0.5, 99.5)  # percentiles; a few far points would squeeze all others into one bin

_LEVELS = 1 << 14  # of the paper's integers
_HEVC_STEP_14_BITS = 64.0  # quantiser step in 14-bit codes at QP 4
_GEOMETRY = (PlaneClass.DEPTH, PlaneClass.OFFSET, PlaneClass.SCALE, PlaneClass.ROTATION)


@dataclass(frozen=True, eq=False)
class Variant:
    """A way to code, carried out.

    Attributes:
        gaussians: decoded.
        bytes: of the whole file.
        bytes_by_class: of its planes; `depth` has all of the position where there is no VPT.
    """

    gaussians: Gaussians
    bytes: int
    bytes_by_class: dict[str, int]


def paper_variant(gaussians: Gaussians, qp: float, runtime: Runtime) -> Variant:
    """The profile `paper` as it is."""
    data = runtime.compress(gaussians, "paper", qp, drop_invalid=True)
    return Variant(runtime.decompress(data), len(data), inspect_bytes(data)["bytes_by_class"])


def without_vpt(gaussians: Gaussians, qp: float, runtime: Runtime) -> Variant:
    """Geometry in the world's frame, colours and opacities as in the real file."""
    real = paper_variant(gaussians, qp, runtime)
    by_class = {**real.bytes_by_class, **dict.fromkeys((c.label for c in _GEOMETRY), 0)}
    layers = []
    for layer, decoded in zip(gaussians.layers, real.gaussians.layers, strict=True):
        arrays = {
            PlaneClass.DEPTH: layer.means, PlaneClass.SCALE: layer.scales,
            PlaneClass.ROTATION: _aligned_quats(layer.quats),
        }  # fmt: skip
        planes = {}
        for plane_class, array in arrays.items():
            channels = [_paper_channel(plane_class, i, array[..., i], qp) for i in range(array.shape[-1])]
            values, size = code_channels(channels, PROFILES["paper"].encoder, runtime.threads)
            by_class[plane_class.label] += size
            planes[plane_class] = np.stack(values, axis=-1)
        layers.append(
            replace(
                decoded, means=planes[PlaneClass.DEPTH], scales=np.maximum(planes[PlaneClass.SCALE], 0),
                quats=_nonzero(planes[PlaneClass.ROTATION]), extra_layers=(),
            )
        )  # fmt: skip
    return _variant(real, layers, by_class)


def without_vabr(gaussians: Gaussians, qp: float, runtime: Runtime, k: int | None = None) -> Variant:
    """SH coefficients as they are in place of components: the first k of them, or all; geometry as in the real file."""
    real = paper_variant(gaussians, qp, runtime)
    by_class = {**real.bytes_by_class, PlaneClass.COLOR.label: 0}
    layers = []
    for layer, decoded in zip(gaussians.layers, real.gaussians.layers, strict=True):
        flat = layer.sh.reshape(*layer.opacities.shape, -1)  # (V, H, W, d)
        kept = min(k or flat.shape[-1], flat.shape[-1])
        sigma = float(flat[..., :kept].std(axis=(0, 1, 2), dtype=np.float64).max())
        channels = [_paper_channel(PlaneClass.COLOR, i, flat[..., i], qp, sigma) for i in range(kept)]
        values, size = code_channels(channels, PROFILES["paper"].encoder, runtime.threads)
        by_class[PlaneClass.COLOR.label] += size
        coefficients = np.zeros_like(flat)
        coefficients[..., :kept] = np.stack(values, axis=-1)
        layers.append(replace(decoded, sh=coefficients.reshape(layer.sh.shape), extra_layers=()))
    basis = sum(2 * 3 * layer.sh.shape[-2] * PAPER.k for layer in gaussians.layers if layer.degree > 0)
    return _variant(real, layers, by_class, saved=basis)


def code_channels(channels: Sequence[Channel], encoder: EncoderSettings, threads: int) -> tuple[list[NDArray], int]:
    """Code channels through HEVC and back, as the codec does.

    Args:
        channels: of one size.
        encoder: libx265's settings.
        threads: planes at a time.

    Returns:
        (V, H, W) float32 per channel, and the bytes of all pictures.
    """
    with ThreadPoolExecutor(max_workers=threads) as pool:
        coded = list(pool.map(lambda channel: _code_channel(channel, encoder), channels))
    return [values for values, _ in coded], sum(size for _, size in coded)


def vpt_channels(gaussians: Gaussians, store: GraphStore) -> dict[str, dict[str, NDArray]]:
    """Layer 0's positions and scales before and after VPT, each (V, H, W) float32, by name."""
    layer = gaussians.layers[0]
    projected = project_layer(store, layer, drop_invalid=True, where="layer 0")
    offset, scale = projected.planes(PlaneClass.OFFSET), projected.planes(PlaneClass.SCALE)
    return {
        "position before": {axis: layer.means[..., i] for i, axis in enumerate("xyz")},
        "position after": {
            "depth": projected.planes(PlaneClass.DEPTH)[:, 0], "offset x": offset[:, 0], "offset y": offset[:, 1]
        },
        "scale before": {f"s{i + 1}": layer.scales[..., i] for i in range(3)},
        "scale after": {f"ŝ{i + 1}": scale[:, i] for i in range(3)},
    }  # fmt: skip


def smoothness(values: NDArray) -> float:
    """Correlation of neighbouring samples (V, H, W) float, mean over both directions: what intra coding uses."""
    pairs = ((values[:, :, 1:], values[:, :, :-1]), (values[:, 1:], values[:, :-1]))
    found = [np.corrcoef(a.ravel(), b.ravel())[0, 1] if a.std() > 0 and b.std() > 0 else 1.0 for a, b in pairs]
    return float(np.mean(found))


def _variant(real: Variant, layers: Sequence[Gaussians], by_class: dict[str, int], saved: int = 0) -> Variant:
    first, *rest = layers
    size = real.bytes + sum(by_class.values()) - sum(real.bytes_by_class.values()) - saved
    return Variant(replace(first, extra_layers=tuple(rest)), size, by_class)


def _paper_channel(
    plane_class: PlaneClass, index: int, values: NDArray, qp: float, sigma: float | None = None
) -> Channel:
    """A channel with the paper's step and window; values (V, H, W)."""
    values = np.ascontiguousarray(values)
    deviation = float(values.std(dtype=np.float64)) if sigma is None else sigma
    integer_step = deviation / PAPER.alpha[plane_class]
    step = integer_step * _HEVC_STEP_14_BITS * 2 ** ((PAPER.class_qp[plane_class] + qp - 4) / 6)
    low, high = float(values.min()), float(values.max())
    return Channel(plane_class, index, values, step, (low, min(high, low + (_LEVELS - 1) * integer_step)))


def _code_channel(channel: Channel, encoder: EncoderSettings) -> tuple[NDArray, int]:
    values, (low, high) = channel.values, channel.window
    mean = float(values.mean(dtype=np.float64))
    if not high > low or float(values.std(dtype=np.float64)) < channel.flat_share * channel.step:
        return np.full_like(values, mean), 0
    code_map = choose_code_map(low, high, mean, channel.step)
    codes, _ = code_map.quantise(values)
    decoded, size = through_hevc(codes, code_map.qp, encoder)
    return code_map.dequantise(decoded), size


def _aligned_quats(quats: NDArray) -> NDArray:
    """Unit quaternions (V, H, W, 4) with the sign nearer to their view's dominant one, as planes have them."""
    unit = quats / np.linalg.norm(quats, axis=-1, keepdims=True)
    flat = unit.reshape(len(unit), -1, 4).astype(np.float64)
    dominant = np.linalg.eigh(flat.swapaxes(1, 2) @ flat)[1][..., -1]  # (V, 4)
    side = np.einsum("vhwc,vc->vhw", unit, dominant)
    return unit * np.where(side < 0, -1, 1)[..., None].astype(np.float32)


def _nonzero(quats: NDArray) -> NDArray:
    is_zero = ~quats.any(axis=-1, keepdims=True)
    return np.where(is_zero, np.array([1, 0, 0, 0], np.float32), quats)


# ---- studied ------------------------------------------------------------------------------------------------------

VARIANTS: dict[str, Callable[..., Variant]] = {
    "paper": paper_variant,
    "without VPT": without_vpt,
    "without VABR, first 6": partial(without_vabr, k=6),
    "without VABR, all": without_vabr,
}


def figure_rows(run: Run) -> Iterator[Row]:
    """All figures of the first window of every input, the built-in ones included."""
    for case in run.cases:
        pictures, runtime = Pictures(case, run.drawing), run.runtime
        yield from _channel_rows(case.name, case.gaussians, runtime)
        for qp in run.options.qps or (QUICK_QPS if run.quick else QPS):
            for name, make in VARIANTS.items():
                variant = make(case.gaussians, qp, runtime)
                figures = {"bytes": variant.bytes, **pictures.figures(variant.gaussians)}
                yield Row("ablation", case.name, name, {"qp": qp}, figures)


def _channel_rows(subject: str, gaussians: Gaussians, runtime: Runtime) -> Iterator[Row]:
    """Positions and scales before and after VPT: how they are distributed, and what coding them costs at Q_g 0."""
    for group, channels in vpt_channels(gaussians, runtime.store).items():
        for name, values in channels.items():
            low, high = (float(v) for v in np.percentile(values, _SHOWN))
            counts = np.histogram(values, _BINS, (low, max(high, low + 1e-9)))[0]
            figures = {"deviation": float(values.std()), "smoothness": smoothness(values), "range": [low, high],
                       "counts": counts.tolist()}  # fmt: skip
            yield Row("channels", subject, name, {"group": group}, figures)
    for way, make in (("without VPT", without_vpt), ("with VPT", paper_variant)):
        by_class = make(gaussians, 0, runtime).bytes_by_class
        sizes = {"position": by_class["depth"] + by_class["offset"], **by_class}
        yield Row("channel bytes", subject, way, figures={name: sizes[name] for name in _GEOMETRY_NAMES})


_GEOMETRY_NAMES = ("position", "scale", "rotation")


def channel_table(rows: Sequence[Row]) -> str:
    """σ and smoothness of each channel, and bytes with and without VPT."""
    return "\n\n".join(filter(None, [_CHANNELS(rows), _CHANNEL_BYTES(rows)]))


_CHANNELS = Listing(
    "channels",
    {"channel": lambda rows: f"{rows[0].setting['group']}: {rows[0].way}", "σ": mean("deviation", digits(4)),
     "neighbours correlate": mean("smoothness", digits(4))},
    sections="subject",
)  # fmt: skip
_CHANNEL_BYTES = Listing(
    "channel bytes",
    {"planes at Q_g 0, all layers": said("way"), **{f"KB {name}": mean(name, kilobytes) for name in _GEOMETRY_NAMES}},
    sections="subject",
)


def plot_channels(path: Path, rows: Sequence[Row]) -> bool:
    """Distributions, a panel per group."""
    grid = []
    for members in grouped(of_study(rows, "channels"), "subject").values():
        panels = []
        for (group,), channels in grouped(members, "group").items():
            curves = []
            for row in channels:
                low, high = row.figures["range"]
                edges = np.linspace(low, high, _BINS)
                curves.append(
                    Curve(row.way, list(zip(edges.tolist(), row.figures["counts"], strict=True)), marks=False)
                )
            panels.append(Panel(group, "", "Gaussians", curves, log=""))
        grid.append(panels)
    if grid:
        save_grid(path, "Channels before and after VPT", grid)
    return bool(grid)


FIGURES = Study(
    "The paper's figures",
    figure_rows,
    {
        "channels": channel_table,
        "ablation": Listing(
            "ablation",
            {"variant": said("way"), "Q_g": said("qp", "{:g}".format), "KB": mean("bytes", kilobytes),
             "dB to raw": mean("psnr_decoded_raw", decibels), "dB to photo": mean("psnr", decibels)},
            by=("way", "qp"), text="Means over inputs.",
        ),
    },
    {
        "channels": plot_channels,
        "ablation": Chart("ablation", "Profile paper, taken apart", Axis("bytes", "KB", unit=1e-3),
                          Axis("psnr_decoded_raw", "dB to raw")),
    },
)  # fmt: skip
