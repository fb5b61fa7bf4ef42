"""What does coding cost? Seconds, bytes and dB of profiles, Q_g, k and SH bands, each held against the video
library alone on the same planes.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.analysis import coefficient_moment, color_planes
from tinysplat_runtime.codec.basis import mean_magnitude_weighting, reduce_basis, view_directions, weighted_spectrum
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, PAPER, PROFILES, Profile, find_profile
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.gaussian.difference import attribute_errors
from tinysplat_runtime.gaussian.gaussians import Gaussians

from ..clock import Baseline, Figures, Variant, measure, measure_peak, plural
from ..pictures import Pictures
from ..rows import Row
from ..show.plots import Axis, Chart
from ..show.tables import (
    BYTES,
    LOST,
    TO_RAW,
    Column,
    Listing,
    View,
    decibels,
    digits,
    mean,
    percent,
    said,
    small,
    whole,
)
from ..study import Run, Study
from ..subjects.cases import Case, truncated
from ..tasks import PlaneRecorder, decode_alone, encode_alone, file_streams
from ..tasks import start as start_task

QPS, QUICK_QPS = (-6.0, 0.0, 6.0, 12.0), (0.0,)
KS, QUICK_KS = (1, 2, 3, 4, 6, 8, 12, 24, 75), (1, 6, 24)
"""Numbers of colour planes, as far as the SH degree has them."""

SHOWN_COMPONENTS = 12

# ---- encode, decode, cold start -----------------------------------------------------------------------------------


def codec_rows(run: Run) -> Iterator[Row]:
    """Encoding, decoding, cold start."""
    qps = run.options.qps or (QUICK_QPS if run.quick else QPS)
    for case in run.cases:
        pictures, files = Pictures(case, run.drawing), {}
        variants = []
        for name in run.options.profiles or tuple(PROFILES):
            for qp in qps:
                label = f"{name} qp {qp:g}"
                variant, files[label] = _coding(label, case, find_profile(name), qp, pictures, run.runtime)
                variants.append(variant)
        yield from measure("encode", case.name, variants, run.effort)
        yield from _decode_rows(run, case, files)
    yield from _cold_start_rows(run, run.cases[0])


def _decode_rows(run: Run, case: Case, files: dict[str, bytes]) -> Iterator[Row]:
    """Files to Gaussians, on one thread and all, each against libavcodec alone; peaks of Q_g 0 on one thread."""
    variants = []
    for count in run.thread_counts:
        runtime = Runtime(threads=count)
        for label, data in files.items():
            streams = file_streams(data)
            baseline = Baseline("libavcodec alone", decode_alone(streams, count)) if streams else None
            sizes = {"bytes": len(data), "planes": len(streams)}
            decode = partial(runtime.decompress, data)
            name = f"{label}, {plural(count)}"
            variants.append(Variant(name, decode, lambda _, sizes=sizes: sizes, {"file": label}, count, baseline))  # type: ignore[misc]
    for row in measure("decode", case.name, variants, run.effort):
        has_peak = row.setting["threads"] == 1 and row.setting["file"].endswith("qp 0")
        yield _with_peak(row, files[row.setting["file"]]) if has_peak else row


def _with_peak(row: Row, data: bytes) -> Row:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "f.tsplat"
        path.write_bytes(data)
        peak = measure_peak("tinysplat.measure.tasks.decode", path, row.setting["threads"])
    return replace(row, costs={**row.costs, "peak_bytes": peak.total})


def _cold_start_rows(run: Run, case: Case) -> Iterator[Row]:
    """`tinysplat decode` as a process of its own, from starting the interpreter to the written .npz."""
    data = run.runtime.compress(case.gaussians, drop_invalid=True)
    sizes = {"bytes": len(data), "planes": len(file_streams(data))}
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "cold.tsplat", Path(folder) / "cold.npz"
        source.write_bytes(data)
        start = start_task(str(source), str(target))
        variant = Variant("tinysplat decode", start, lambda _: sizes, threads=run.threads)
        yield from measure("cold start", case.name, [variant], run.effort)


def _coding(
    label: str, case: Case, profile: Profile, qp: float, pictures: Pictures, runtime: Runtime
) -> tuple[Variant, bytes]:
    """A variant against libx265 alone on its own planes, and the file that comes of it."""

    def encode(**options: Any) -> bytes:
        return encode_gaussians(
            case.gaussians, profile, qp, runtime.store, threads=runtime.threads, drop_invalid=True, **options
        )

    recorder = PlaneRecorder()
    data = encode(plane_coder=recorder)
    figures = coding_figures(data, pictures, runtime) | {"planes": len(recorder.planes)}
    setting = {"profile": profile.name, "qp": qp, "preset": profile.encoder.preset}
    alone = encode_alone(recorder.planes, runtime.threads)
    baseline = Baseline("libx265 alone", alone) if recorder.planes else None
    return Variant(label, encode, lambda _: figures, setting, runtime.threads, baseline), data


def coding_figures(data: bytes, pictures: Pictures, runtime: Runtime) -> Figures:
    """`bytes`, `k`, what the pictures lose, and the RMSE of every attribute in world units."""
    decoded = runtime.decompress(data)
    errors = attribute_errors(pictures.case.gaussians, decoded)
    attributes = {f"rmse_{name}": error["rmse"] for name, error in errors.items()}
    return {"bytes": len(data), "k": inspect_bytes(data)["k"], **pictures.figures(decoded), **attributes}


CODEC = Study.of(
    "Coding",
    codec_rows,
    View(
        "encode",
        "Encoding",
        "Gaussians to a file, by profile and Q_g. `× libx265 alone` is the time over that of the library on the same"
        " planes, with the same threads, in the same round (CPU seconds in brackets). dB to raw: pictures of the"
        " decoded Gaussians against those of the raw ones, over the input views and views in between.",
        (BYTES, TO_RAW, LOST, Column("k", "k", whole), Column("rmse_means", "RMSE of means", small)),
        costs=("bytes",), gains=("psnr_decoded_raw",), y="psnr_decoded_raw", y_label="dB to raw", group="profile",
    ),
    View(
        "decode",
        "Decoding",
        "A file's bytes to Gaussians. `× libavcodec alone` is the time over that of the library on the same streams,"
        " with the same threads, in the same round (CPU seconds in brackets). Peaks are those of a process of its own.",
        (BYTES, Column("planes", "planes", whole)),
    ),
    View(
        "cold start",
        "Cold start",
        "`tinysplat decode F.tsplat -o G.npz` as a process: interpreter, imports, graphs, decoding, writing.",
        (BYTES, Column("planes", "planes", whole)),
    ),
)  # fmt: skip

# ---- k and SH degree ----------------------------------------------------------------------------------------------


def reduction_rows(run: Run) -> Iterator[Row]:
    """How many colour planes (k), and how many SH bands: bytes, seconds and dB of each, and the bits of components."""
    for case in run.cases:
        if case.gaussians.degree > 0:
            yield from _reductions(run, case)
        elif run.sources:
            run.left_out.append(f"left out k of {case.name}: SH degree 0 has no components for VABR to choose")


def _reductions(run: Run, case: Case) -> Iterator[Row]:
    pictures, runtime, files = Pictures(case, run.drawing), run.runtime, dict[int, bytes]()
    d = 3 * (case.gaussians.degree + 1) ** 2

    def k_variant(k: int) -> Variant:
        profile = replace(find_profile("paper"), settings=replace(PAPER, k=k))
        encode = partial(encode_gaussians, case.gaussians, profile, 0, runtime.store, threads=runtime.threads,
                         drop_invalid=True)  # fmt: skip

        def figures(data: bytes) -> Figures:
            files[k] = data
            alone = pictures.figures(reduced(case.gaussians, k, runtime))["psnr_decoded_raw"]
            return {**coding_figures(data, pictures, runtime), "psnr_vabr_alone": alone}

        return Variant(f"k = {k}", encode, figures, {"k": k}, runtime.threads)

    def degree_variant(degree: int) -> Variant:
        gaussians = truncated(case.gaussians, degree)

        def figures(data: bytes) -> Figures:
            alone = pictures.figures(gaussians)["psnr_decoded_raw"]
            return {**coding_figures(data, pictures, runtime), "psnr_bands_alone": alone}

        encode = partial(runtime.compress, gaussians, DEFAULT_PROFILE, drop_invalid=True)
        return Variant(f"SH degree {degree}", encode, figures, {"degree": degree}, runtime.threads)

    ks = sorted({min(k, d) for k in (QUICK_KS if run.quick else KS)})
    yield from measure("k", case.name, [k_variant(k) for k in ks], run.effort)
    sizes = component_bytes(files[ks[-1]])[:SHOWN_COMPONENTS]
    for i, size in enumerate(sizes):
        bits = {"bytes": size, "bits": 8 * size / case.gaussians.opacities.size, "share": size / max(sum(sizes), 1)}
        yield Row("component bits", case.name, str(i + 1), {"component": i + 1}, bits)
    degrees = range(case.gaussians.degree + 1)
    yield from measure("SH degree", case.name, [degree_variant(n) for n in degrees], run.effort)


def component_bytes(data: bytes) -> list[int]:
    """Bytes of each of VABR's components of a file's layer 0; empty for SH degree 0, which has none."""
    described = inspect_bytes(data)
    planes = [p for p in described["planes"] if p["layer"] == 0 and p["class"] == "color"] if described["k"] else []
    return [plane["bytes"] for plane in planes]


def reduced(gaussians: Gaussians, k: int, runtime: Runtime) -> Gaussians:
    """The paper's VABR forth and back with k components, in float32, without quantisation."""
    moment = coefficient_moment(runtime.store, gaussians)
    weighting = mean_magnitude_weighting(view_directions(gaussians.cameras), gaussians.degree)
    reduction = reduce_basis(weighted_spectrum(moment, weighting), weighting, k)
    planes = color_planes(runtime.store, gaussians, reduction.projection)
    sh = np.einsum("vkhw,dk->vhwd", planes, reduction.inverse.astype(np.float32))
    return replace(gaussians, sh=sh.reshape(gaussians.sh.shape))


REDUCTION = Study.of(
    "Colour planes",
    reduction_rows,
    View(
        "k",
        "Colour planes (k)",
        "Profile `paper` with k planes; the last column is what k planes give when nothing is quantised.",
        (BYTES, TO_RAW, LOST, Column("psnr_vabr_alone", "dB, VABR alone", decibels)),
        costs=("bytes",), gains=("psnr_decoded_raw",), y="psnr_decoded_raw", y_label="dB to raw",
    ),
    Listing(
        "component bits",
        {"component": said("way"), "bytes": mean("bytes", whole), "bits per Gaussian": mean("bits", digits(3)),
         "share of colour": mean("share", percent)},
        sections="subject",
    ),
    Chart("component bits", "Colour planes", Axis("component", "component", "setting"),
          Axis("bits", "bits per Gaussian"), curve="subject", point="component", log=""),
    View(
        "SH degree",
        "SH degree",
        "The default profile on the same Gaussians with the bands above a degree cut off; pictures against those of all"
        " bands. The last column is the loss of the cut alone.",
        (BYTES, TO_RAW, Column("k", "k", whole), Column("psnr_bands_alone", "dB, cut alone", decibels)),
        costs=("bytes",), gains=("psnr_decoded_raw",), y="psnr_decoded_raw", y_label="dB to raw",
    ),
)  # fmt: skip
