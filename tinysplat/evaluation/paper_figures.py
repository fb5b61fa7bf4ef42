"""The paper's figures: distributions before and after VPT, rate against quality, ablations, and the choice of k.

Each gives a picture and the numbers behind it. The paper prints these as pictures alone, so there are no figures of
its to quote beyond its statements: without VPT or VABR the curves fall, quality is flat beyond k = 6, and the first
component takes most of the bits.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.errors import InputError

from .ablation import (
    Variant,
    component_bytes,
    paper_variant,
    smoothness,
    vpt_channels,
    without_vabr,
    without_vpt,
)
from .measure import Prepared, capped_psnr, render_targets
from .paper_tables import Inputs, network_name
from .plots import Curve, Panel, save_bars, save_grid, save_histograms
from .runner import Coding, Job
from .summary import mean_record
from .tables import format_table, number

FIGURE_K = (1, 2, 3, 4, 6, 8, 12, 18, 27, 48, 75)
"""Numbers of components tried, as far as the SH degree has them."""

MAX_SHOWN_COMPONENTS = 12

Maker = Callable[..., Variant]

VARIANTS: dict[str, Maker] = {
    "paper": paper_variant,
    "without VPT": without_vpt,
    "without VABR, first 6": partial(without_vabr, k=6),
    "without VABR, all": without_vabr,
}


@dataclass(frozen=True)
class Point:
    """One coding of one window: bytes, and PSNR of its pictures in dB."""

    bytes: int
    to_raw: float
    to_photo: float | None


def vpt_figure(inputs: Inputs, folder: Path) -> str:
    """Positions and scales before and after VPT: how they are distributed, and what coding them costs."""
    runtime = Runtime(threads=inputs.settings.threads)
    sections = []
    for job, prepared in inputs.prepared(runtime):
        gaussians = prepared.case.gaussians
        groups = vpt_channels(gaussians, runtime.store)
        save_histograms(folder / f"fig-vpt-{_safe(job)}.png", str(job), groups)
        rows = [
            [f"{group}: {name}", number(float(values.std()), 4), number(smoothness(values), 4)]
            for group, channels in groups.items()
            for name, values in channels.items()
        ]
        after, before = (make(gaussians, 0, runtime).bytes_by_class for make in (paper_variant, without_vpt))
        costs = [
            ["position", _kilobytes(before["depth"]), _kilobytes(after["depth"] + after["offset"])],
            *([name, _kilobytes(before[name]), _kilobytes(after[name])] for name in ("scale", "rotation")),
        ]
        sections.append(
            f"{job}\n\n{format_table(['channel', 'σ', 'neighbours correlate'], rows)}\n\n"
            f"{format_table(['planes at Q_g 0, all layers', 'KB without VPT', 'KB with VPT'], costs)}\n"
        )
    return _joined(sections)


def rd_figure(inputs: Inputs, folder: Path, qps: Sequence[float]) -> str:
    """Rate against quality of every profile over Q_g."""
    rows, curves = [], []
    for data in inputs.sources:
        codings = [Coding(p, qp) for p in inputs.profiles for qp in qps]
        records = inputs.records(data, codings, inputs.wanted_views)
        for model in dict.fromkeys(r.model for r in records):
            for profile in inputs.profiles:
                points = []
                for qp in qps:
                    chosen = [r for r in records if (r.model, r.profile, r.qp) == (model, profile, qp)]
                    if chosen:
                        mean = mean_record(chosen)
                        point = Point(round(mean["bytes"]), mean["psnr_decoded_raw"], mean["psnr"])
                        points.append(point)
                        label = f"{network_name(model)}, {profile}"
                        rows.append([label, f"{qp:g}", *_point_cells(point)])
                curves.append((f"{network_name(model)}, {profile}", points))
    return _curves(folder / "fig-rd.png", "Rate against quality", ["codec", "Q_g"], rows, curves)


def ablation_figure(inputs: Inputs, folder: Path, qps: Sequence[float]) -> str:
    """Rate against quality with VPT or VABR taken away, means over windows."""
    points = _sweep(inputs, {(name, qp): partial(make, qp=qp) for name, make in VARIANTS.items() for qp in qps})
    rows = [[name, f"{qp:g}", *_point_cells(point)] for (name, qp), point in points.items()]
    curves = [(name, [points[name, qp] for qp in qps]) for name in VARIANTS]
    return _curves(folder / "fig-ablation.png", "Profile paper, taken apart", ["variant", "Q_g"], rows, curves)


def k_figure(inputs: Inputs, folder: Path) -> str:
    """Quality and size against the number of components, and the bits of each component."""
    runtime = Runtime(threads=inputs.settings.threads)
    sections = []
    for job, prepared in inputs.prepared(runtime):
        gaussians = prepared.case.gaussians
        d = 3 * gaussians.sh.shape[-2]
        if gaussians.degree == 0:
            print(f"paper: left out {job}: SH degree 0 has no components for VABR to choose", file=sys.stderr)
            continue
        ks = [k for k in FIGURE_K if k < d] + [d]
        points = [_point(prepared, paper_variant(gaussians, 0, runtime, k=k), runtime) for k in ks]
        shown = min(MAX_SHOWN_COMPONENTS, d)
        sizes = component_bytes(gaussians, 0, runtime, shown)
        pixels = gaussians.opacities.size
        path = folder / f"fig-k-{_safe(job)}.png"
        save_bars(path, str(job), (ks, [p.to_raw for p in points]), [8 * size / pixels for size in sizes])
        rows = [[str(k), *_point_cells(point)] for k, point in zip(ks, points, strict=True)]
        bits = [
            [str(i + 1), str(size), number(8 * size / pixels, 3), number(100 * size / max(sum(sizes), 1), 1)]
            for i, size in enumerate(sizes)
        ]
        sections.append(
            f"{job}: d = {d}\n\n{format_table(['k', *_POINT_HEADER], rows)}\n\n"
            f"{format_table(['component', 'bytes', 'bits per Gaussian', '% of colour'], bits)}\n"
        )
    return _joined(sections)


_POINT_HEADER = ("KB", "dB to raw", "dB to photo")


def _point_cells(point: Point) -> list[str]:
    return [_kilobytes(point.bytes), number(point.to_raw, 2), number(point.to_photo, 2)]


def _sweep(inputs: Inputs, makers: dict[tuple[str, float], Callable[..., Variant]]) -> dict[tuple[str, float], Point]:
    """Every maker's point, mean over windows."""
    runtime = Runtime(threads=inputs.settings.threads)
    found: dict[tuple[str, float], list[Point]] = {key: [] for key in makers}
    for _, prepared in inputs.prepared(runtime):
        for key, make in makers.items():
            variant = make(prepared.case.gaussians, runtime=runtime)
            found[key].append(_point(prepared, variant, runtime))
    if not all(found.values()):
        raise InputError("no window to measure", where="paper")
    return {key: _mean_point(points) for key, points in found.items()}


def _point(prepared: Prepared, variant: Variant, runtime: Runtime) -> Point:
    images = render_targets(variant.gaussians, prepared.case, runtime.threads).images
    photos = prepared.case.photos
    return Point(variant.bytes, _mean_psnr(images, prepared.raw.images),
                 None if photos is None else _mean_psnr(images, photos))  # fmt: skip


def _mean_psnr(images: Iterable[np.ndarray], references: Iterable[np.ndarray]) -> float:
    return float(np.mean([capped_psnr(a, b) for a, b in zip(images, references, strict=True)]))


def _mean_point(points: Sequence[Point]) -> Point:
    photos = [p.to_photo for p in points if p.to_photo is not None]
    return Point(
        round(np.mean([p.bytes for p in points])),
        float(np.mean([p.to_raw for p in points])),
        float(np.mean(photos)) if photos else None,
    )


def _curves(
    path: Path, title: str, header: list[str], rows: list[list[str]], curves: list[tuple[str, list[Point]]]
) -> str:
    to_raw = [Curve(name, [(p.bytes / 1000, p.to_raw) for p in points]) for name, points in curves]
    to_photo = [
        Curve(name, [(p.bytes / 1000, p.to_photo) for p in points if p.to_photo is not None]) for name, points in curves
    ]
    panels = [Panel("", "KB", "dB to the raw render", to_raw)]
    if any(curve.points for curve in to_photo):
        panels.append(Panel("", "KB", "dB to the photo", to_photo))
    save_grid(path, title, [panels])
    return f"{title}\n\n{format_table([*header, *_POINT_HEADER], rows)}\n"


def _kilobytes(size: float) -> str:
    return number(size / 1000, 1)


def _joined(sections: Sequence[str]) -> str:
    if not sections:
        raise InputError("no window to measure", where="paper")
    return "\n".join(sections)


def _safe(job: Job) -> str:
    text = f"{job.source.name}-{job.window.kind}-{'_'.join(map(str, job.window.context))}"
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in text)
