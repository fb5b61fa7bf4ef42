"""What does storing Gaussians cost? Seconds, bytes and dB of profiles, presets, Q_g, k, SH bands and other formats,
each held against the video library alone on the same planes.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.analysis import coefficient_moment, color_planes
from tinysplat_runtime.codec.basis import mean_magnitude_weighting, reduce_basis, view_directions, weighted_spectrum
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.hevc import EncoderSettings
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, PAPER, PROFILES, Profile, find_profile
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians

from .. import tasks
from ..clock import Baseline, Figures, Variant, measure, measure_peak, plural, summarised, timed
from ..floors import PlaneRecorder, decode_alone, encode_alone, file_streams
from ..metrics import attribute_errors
from ..peers import MAX_DEGREE, MissingToolError, peer_ways, tool_note
from ..pictures import Pictures
from ..published import PUBLISHED
from ..rows import Row, grouped
from ..show.plots import Curve, Panel, save_grid
from ..show.tables import decibels, duration, format_table, kilobytes, small, whole
from ..show.views import BYTES, LOST, TO_RAW, Column, View
from ..study import Run, Study
from ..subjects.cases import Case, truncated
from ..subjects.made import made_case
from ..ways import Way

QPS, QUICK_QPS = (-6.0, 0.0, 6.0, 12.0), (0.0,)
KS, QUICK_KS = (1, 2, 3, 4, 6, 8, 12, 24, 75), (1, 6, 24)

PRESETS: dict[str, tuple[str, ...]] = {
    "ultrafast": (),
    "ultrafast, min-cu-size=8": ("min-cu-size=8",),
    "superfast": (),
    "superfast, rdoq-level=2": ("rdoq-level=2",),
    "medium, rdoq-level=2": ("rdoq-level=2",),
    "veryslow, rdoq-level=2": ("rdoq-level=2",),
}
"""Presets of libx265 that the default profile's planes are coded with, the further parameters of each."""

QUICK_PRESETS = ("ultrafast, min-cu-size=8", "superfast, rdoq-level=2")

SOG_LIMIT_S, QUICK_SOG_LIMIT_S = 240.0, 5.0
"""SOG is given up after this long: on a CPU its clustering of SH takes minutes."""

EXACT_DB = 100
"""Above it a format is exact but for float32's rounding; its dB would flatten all others on a plot."""

# ---- encode, preset, decode, cold start ---------------------------------------------------------------------------


def codec_rows(run: Run) -> Iterator[Row]:
    """Encoding, presets, decoding."""
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
    yield from _preset_rows(run, run.cases[0])


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
        start = tasks.start(str(source), str(target))
        variant = Variant("tinysplat decode", start, lambda _: sizes, threads=run.threads)
        yield from measure("cold start", case.name, [variant], run.effort)


def _preset_rows(run: Run, case: Case) -> Iterator[Row]:
    """The default profile's planes by several presets of libx265."""
    profile, pictures = find_profile(DEFAULT_PROFILE), Pictures(case, run.drawing)
    kept = tuple(p for p in profile.encoder.params if not p.startswith(("rdoq-level", "min-cu-size")))
    variants = []
    for name in QUICK_PRESETS if run.quick else PRESETS:
        coder = replace(profile, encoder=EncoderSettings(name.partition(",")[0], (*PRESETS[name], *kept)))
        for qp in (0.0,) if run.quick else (0.0, 6.0):
            variants.append(_coding(f"{name}; qp {qp:g}", case, coder, qp, pictures, run.runtime)[0])
    yield from measure("preset", case.name, variants, run.effort)


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


CODEC = Study.of_views(
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
    View(
        "preset",
        "Presets of libx265",
        "The default profile's planes by other presets.",
        (BYTES, TO_RAW),
        costs=("bytes",), gains=("psnr_decoded_raw",), y="bytes", y_label="bytes",
    ),
)  # fmt: skip

# ---- k and SH degree ----------------------------------------------------------------------------------------------


def reduction_rows(run: Run) -> Iterator[Row]:
    """How many colour planes (k), and how many SH bands: bytes, seconds and dB of each."""
    case = made_case(2, run.side, run.side, 4)
    pictures, runtime = Pictures(case, run.drawing), run.runtime
    d = 3 * (case.gaussians.degree + 1) ** 2

    def k_variant(k: int) -> Variant:
        profile = replace(find_profile("paper"), settings=replace(PAPER, k=k))
        encode = partial(encode_gaussians, case.gaussians, profile, 0, runtime.store, threads=runtime.threads,
                         drop_invalid=True)  # fmt: skip

        def figures(data: bytes) -> Figures:
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
    degrees = range(case.gaussians.degree + 1)
    yield from measure("SH degree", case.name, [degree_variant(n) for n in degrees], run.effort)


def reduced(gaussians: Gaussians, k: int, runtime: Runtime) -> Gaussians:
    """The paper's VABR forth and back with k components, in float32, without quantisation."""
    moment = coefficient_moment(runtime.store, gaussians)
    weighting = mean_magnitude_weighting(view_directions(gaussians.cameras), gaussians.degree)
    reduction = reduce_basis(weighted_spectrum(moment, weighting), weighting, k)
    planes = color_planes(runtime.store, gaussians, reduction.projection)
    sh = np.einsum("vkhw,dk->vhwd", planes, reduction.inverse.astype(np.float32))
    return replace(gaussians, sh=sh.reshape(gaussians.sh.shape))


REDUCTION = Study.of_views(
    "Colour planes",
    reduction_rows,
    View(
        "k",
        "Colour planes (k)",
        "Profile `paper` with k planes; the last column is what k planes give when nothing is quantised.",
        (BYTES, TO_RAW, LOST, Column("psnr_vabr_alone", "dB, VABR alone", decibels)),
        costs=("bytes",), gains=("psnr_decoded_raw",), y="psnr_decoded_raw", y_label="dB to raw",
    ),
    View(
        "SH degree",
        "SH degree",
        "The default profile on the same Gaussians with the bands above a degree cut off; pictures against those of all"
        " bands. The last column is the loss of the cut alone.",
        (BYTES, TO_RAW, Column("k", "k", whole), Column("psnr_bands_alone", "dB, cut alone", decibels)),
        costs=("bytes",), gains=("psnr_decoded_raw",), y="psnr_decoded_raw", y_label="dB to raw",
    ),
)  # fmt: skip

# ---- peers --------------------------------------------------------------------------------------------------------


def peer_rows(run: Run) -> Iterator[Row]:
    """Other formats, side by side in one run: bytes, seconds, dB."""
    ways = peer_ways(run.runtime, QUICK_SOG_LIMIT_S if run.quick else SOG_LIMIT_S)
    for case in run.cases:
        if case.gaussians.degree > MAX_DEGREE:
            cut = truncated(case.gaussians, MAX_DEGREE)
            case = replace(case, name=f"{case.name}, cut to {MAX_DEGREE}", gaussians=cut)
        yield from compare_ways(case, ways, run)


def compare_ways(case: Case, ways: Sequence[Way], run: Run) -> list[Row]:
    """Rows of `peers encode` (with bytes and dB) and `peers decode`, one of each per way."""
    pictures, rows, variants = Pictures(case, run.drawing), [], []
    for way in ways:
        encode = partial(way.encode, case, way.settings[0])
        setting: dict[str, Any] = {"tool": way.tool}
        results: list[Any] = []
        try:
            times = [timed(lambda: results.append(encode()))]  # noqa: B023 - called at once
            data = results[0]
            decode = partial(way.decode, case, data)
            times.append(timed(lambda: results.append(decode())))  # noqa: B023
        except (MissingToolError, InputError) as error:
            rows.append(Row("peers encode", case.name, way.name, setting, note=str(error)))
            continue
        figures = {"bytes": len(data), **pictures.figures(results[1])}
        if way.is_slow:
            note, setting = tool_note(way.tool), {**setting, "threads": way.threads}
            for stage, found, time in (("encode", figures, times[0]), ("decode", {}, times[1])):
                rows.append(Row(f"peers {stage}", case.name, way.name, setting, found, summarised([time]), note))
        else:
            variants.append((Variant(way.name, encode, lambda _, f=figures: f, setting, way.threads),  # type: ignore[misc]
                             Variant(way.name, decode, setting=setting, threads=way.threads)))  # fmt: skip
    for i, stage in enumerate(("encode", "decode")):
        rows += measure(f"peers {stage}", case.name, [pair[i] for pair in variants], run.effort)
    order = [way.name for way in ways]
    return sorted(rows, key=lambda row: (row.study != "peers encode", order.index(row.way)))


def peer_table(rows: Sequence[Row]) -> str:
    """A line per format."""
    decodes = {(row.subject, row.way): row for row in rows if row.study == "peers decode"}
    sections = []
    for (subject,), members in grouped((row for row in rows if row.study == "peers encode"), "subject").items():
        lines = []
        for row in members:
            decode, figures = decodes.get((subject, row.way)), row.figures
            cells = [kilobytes(figures.get("bytes")), duration(row.seconds),
                     duration(decode.seconds if decode else None), decibels(figures.get("psnr_decoded_raw")),
                     decibels(figures.get("db_lost"))]  # fmt: skip
            lines.append([row.way, row.setting["tool"], *cells, row.note])
        heads = ["", "tool", "KB", "encode", "decode", "dB to raw", "dB lost to photo", ""]
        sections.append(f"**{subject}**\n\n{format_table(heads, lines)}")
    if not sections:
        return ""
    text = "The same Gaussians in other formats, in the same run. dB to raw: against pictures of the raw Gaussians."
    return "\n\n".join([text, *sections])


def published_table(rows: Sequence[Row]) -> str:
    """What others printed, beside our formats."""
    if not any(row.study == "peers encode" for row in rows):
        return ""
    text = "Published figures, **quoted, not measured here**; other networks, scenes and machines:"
    heads = ["", "data", "size", "dB to photo", "encode / decode s", "source"]
    return f"{text}\n\n{format_table(heads, [list(vars(line).values()) for line in PUBLISHED])}"


def plot_peers(path: Path, rows: Sequence[Row]) -> bool:
    """dB against KB, a mark per format, those that are exact left out."""
    shown = [row for row in rows if row.study == "peers encode" and row.figures.get("psnr_decoded_raw", 999) < EXACT_DB]
    panels = []
    for (subject,), members in grouped(shown, "subject").items():
        points = [(row.way, (row.figures["bytes"] / 1000, row.figures["psnr_decoded_raw"])) for row in members]
        panels.append(Panel(subject, "KB", "dB to raw", [Curve(name, [at], is_line=False) for name, at in points]))
    if panels:
        save_grid(path, "The same Gaussians in several formats", [panels])
    return bool(panels)


PEERS = Study("Peers", peer_rows, {"peers": peer_table, "published": published_table}, {"peers": plot_peers})
