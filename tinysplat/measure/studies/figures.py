"""What are VPT and VABR worth? The paper's figures: channels before and after VPT, the profile `paper` with VPT or
VABR taken away, and the choice of k. The paper prints these as pictures alone, so there is nothing of its to quote but
its statements: without VPT or VABR the curves fall, quality is flat beyond k = 6, the first component takes most bits.

Every variant takes the real file of the profile `paper` and replaces one part, coded by the same rules: a class's α and
Q_c, the 14-bit window, 12-bit codes through the same encoder. Sizes are those of the real file less the planes that
are replaced, plus the planes that replace them.

    without VPT     x, y, z in the world with depth's α and Q_c in place of depth and offset; world scales and rotations
    without VABR    the first k SH coefficients (degree by degree, red, green, blue), or all, each a plane; one step
                    for all of them, from the one of largest σ, as VABR's components share one
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.analysis import project_layer
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.hevc import EncoderSettings, PlaneDecoder, encode_plane
from tinysplat_runtime.codec.profiles import PAPER, PROFILES, Profile
from tinysplat_runtime.codec.quantise import choose_code_map
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.planes import Channel, PlaneClass
from tinysplat_runtime.graphs.inference import GraphStore

from ..pictures import Pictures
from ..rows import Row, grouped
from ..show.plots import Curve, Panel, save_grid
from ..show.tables import decibels, format_table, kilobytes, number
from ..study import Run, Study

QPS, QUICK_QPS = (-6.0, 0.0, 6.0, 12.0), (0.0, 12.0)
KS, QUICK_KS = (1, 2, 3, 4, 6, 8, 12, 18, 27, 48, 75), (1, 6)
"""Numbers of components tried, as far as the SH degree has them."""

SHOWN_COMPONENTS = 12
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


def paper_variant(gaussians: Gaussians, qp: float, runtime: Runtime, k: int | None = None) -> Variant:
    """The profile `paper` as it is, or with another number of colour planes.

    Args:
        gaussians: per pixel, with cameras.
        qp: Q_g.
        runtime: codes and decodes.
        k: colour planes; None for the paper's 6.
    """
    data, described = _coded(gaussians, qp, runtime, k)
    return Variant(runtime.decompress(data), len(data), described["bytes_by_class"])


def component_bytes(gaussians: Gaussians, qp: float, runtime: Runtime, k: int) -> list[int]:
    """Bytes of each of VABR's k components of layer 0; empty for SH degree 0, which has none."""
    _, described = _coded(gaussians, qp, runtime, k)
    if described["k"] == 0:
        return []
    planes = [plane for plane in described["planes"] if plane["layer"] == 0 and plane["class"] == "color"]
    return [plane["bytes"] for plane in planes]


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
    """Layer 0's positions and scales before and after VPT, each (V, H, W) by name."""
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
    """Correlation of neighbouring samples (V, H, W), mean over both directions: what intra coding lives on."""
    pairs = ((values[:, :, 1:], values[:, :, :-1]), (values[:, 1:], values[:, :-1]))
    found = [np.corrcoef(a.ravel(), b.ravel())[0, 1] if a.std() > 0 and b.std() > 0 else 1.0 for a, b in pairs]
    return float(np.mean(found))


def _coded(gaussians: Gaussians, qp: float, runtime: Runtime, k: int | None) -> tuple[bytes, dict[str, Any]]:
    encoder = PROFILES["paper"].encoder
    settings = PAPER if k is None else replace(PAPER, k=k)
    data = encode_gaussians(
        gaussians, Profile("paper", encoder, settings), qp, runtime.store, threads=runtime.threads, drop_invalid=True
    )
    return data, inspect_bytes(data)


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
    decoded, size = np.empty_like(codes), 0
    for view, plane in enumerate(codes):
        coded = encode_plane(plane, code_map.qp, encoder)
        PlaneDecoder(coded.parameter_sets, *plane.shape).decode_into(coded.payload, decoded[view])
        size += len(coded.payload)
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
        d = 3 * case.gaussians.sh.shape[-2]
        if case.gaussians.degree == 0:
            run.left_out.append(f"left out k of {case.name}: SH degree 0 has no components for VABR to choose")
            continue
        for k in [k for k in (QUICK_KS if run.quick else KS) if k < d] + [d]:
            variant = paper_variant(case.gaussians, 0, runtime, k=k)
            figures = {"bytes": variant.bytes, **pictures.figures(variant.gaussians)}
            yield Row("components", case.name, f"k = {k}", {"k": k}, figures)
        sizes = component_bytes(case.gaussians, 0, runtime, min(SHOWN_COMPONENTS, d))
        for i, size in enumerate(sizes):
            bits = {"bytes": size, "bits": 8 * size / case.gaussians.opacities.size, "share": size / max(sum(sizes), 1)}
            yield Row("component bits", case.name, str(i + 1), {"component": i + 1}, bits)


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


def _of(rows: Sequence[Row], study: str) -> dict[tuple[Any, ...], list[Row]]:
    return grouped((row for row in rows if row.study == study), "subject")


def channel_table(rows: Sequence[Row]) -> str:
    """σ and smoothness of each channel, and bytes with and without VPT."""
    sections = []
    costs = _of(rows, "channel bytes")
    for (subject,), members in _of(rows, "channels").items():
        lines = [[f"{row.setting['group']}: {row.way}", number(row.figures["deviation"], 4),
                  number(row.figures["smoothness"], 4)] for row in members]  # fmt: skip
        sections.append(f"**{subject}**\n\n{format_table(['channel', 'σ', 'neighbours correlate'], lines)}")
        pair = costs[subject,]
        lines = [[name, *(kilobytes(row.figures[name]) for row in pair)] for name in _GEOMETRY_NAMES]
        sections.append(format_table(["planes at Q_g 0, all layers", *(f"KB {row.way}" for row in pair)], lines))
    return "\n\n".join(sections)


def plot_channels(path: Path, rows: Sequence[Row]) -> bool:
    """Distributions, a panel per group."""
    grid = []
    for members in _of(rows, "channels").values():
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


def ablation_table(rows: Sequence[Row]) -> str:
    """Means over subjects."""
    lines = []
    for (way, qp), members in grouped((row for row in rows if row.study == "ablation"), "way", "qp").items():
        lines.append([way, f"{qp:g}", *_cells(members)])
    return format_table(["variant", "Q_g", *_HEADER], lines) if lines else ""


def plot_ablation(path: Path, rows: Sequence[Row]) -> bool:
    """Rate against quality, means over subjects."""
    curves = []
    for (way,), members in grouped((row for row in rows if row.study == "ablation"), "way").items():
        points = [(statistics.fmean(r.figures["bytes"] for r in found) / 1000,
                   statistics.fmean(r.figures["psnr_decoded_raw"] for r in found))
                  for found in grouped(members, "qp").values()]  # fmt: skip
        curves.append(Curve(way, points))
    if curves:
        save_grid(path, "Profile paper, taken apart", [[Panel("", "KB", "dB to raw", curves)]])
    return bool(curves)


def component_table(rows: Sequence[Row]) -> str:
    """Quality and size by k, and the bits of each component."""
    sections, bits = [], _of(rows, "component bits")
    for (subject,), members in _of(rows, "components").items():
        lines = [[str(row.setting["k"]), *_cells([row])] for row in members]
        sections.append(f"**{subject}**\n\n{format_table(['k', *_HEADER], lines)}")
        lines = [[row.way, str(row.figures["bytes"]), number(row.figures["bits"], 3),
                  number(100 * row.figures["share"], 1)] for row in bits[subject,]]  # fmt: skip
        sections.append(format_table(["component", "bytes", "bits per Gaussian", "% of colour"], lines))
    return "\n\n".join(sections)


def plot_components(path: Path, rows: Sequence[Row]) -> bool:
    """Quality against k, and the bits of each component."""
    quality = [Curve(subject, [(row.setting["k"], row.figures["psnr_decoded_raw"]) for row in members])
               for (subject,), members in _of(rows, "components").items()]  # fmt: skip
    bits = [Curve(subject, [(row.setting["component"], row.figures["bits"]) for row in members])
            for (subject,), members in _of(rows, "component bits").items()]  # fmt: skip
    if quality:
        panels = [Panel("", "k", "dB to raw", quality), Panel("", "component", "bits per Gaussian", bits, log="")]
        save_grid(path, "Colour planes", [panels])
    return bool(quality)


_HEADER = ("KB", "dB to raw", "dB to photo")


def _cells(rows: Sequence[Row]) -> list[str]:
    photos = [row.figures["psnr"] for row in rows if "psnr" in row.figures]
    return [kilobytes(statistics.fmean(row.figures["bytes"] for row in rows)),
            decibels(statistics.fmean(row.figures["psnr_decoded_raw"] for row in rows)),
            decibels(statistics.fmean(photos) if photos else None)]  # fmt: skip


FIGURES = Study(
    "The paper's figures",
    figure_rows,
    {"channels": channel_table, "ablation": ablation_table, "components": component_table},
    {"channels": plot_channels, "ablation": plot_ablation, "components": plot_components},
)
