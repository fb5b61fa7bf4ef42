"""How good are the pictures? What `tinysplat eval` measures: by scene, closer and farther, with more photos."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from ..quality import (
    NESTED,
    ProfileQp,
    Quality,
    decode_seconds,
    encode_seconds,
    groups_of,
    mean_of_rows,
    mean_of_scenes,
)
from ..rows import Row, grouped
from ..runner import run_jobs
from ..show.tables import decibels, format_table, kilobytes, number
from ..study import Run, Study

STUDY = "quality"


def quality_rows(run: Run) -> Iterator[Row]:
    """Windows of scenes with photos, drawn at 0.5, 1 and 2 times their size, and from their nearest photos."""
    options = run.options
    codings = tuple(ProfileQp(p, q) for p in options.profiles or ("balanced",) for q in options.qps or (0.0,))
    zooms = (1.0, 2.0) if run.quick else (0.5, 1.0, 2.0)
    work = Quality(codings, run.folder, run.lpips, zooms=zooms, nested=not run.quick)
    outcome = run_jobs(run.plan(), work, run.store, threads=run.threads, processes=options.jobs, runtime=run.runtime)
    run.left_out += [*map(str, outcome.left_out), *outcome.notes]
    yield from outcome.rows


_COLUMNS: dict[str, Callable[[dict[str, Any]], str]] = {
    "photo dB": lambda m: decibels(m["psnr_photo"]),
    "raw dB": lambda m: decibels(m["psnr_raw"]),
    "coded dB": lambda m: decibels(m["psnr"]),
    "covered photo dB": lambda m: decibels(m["psnr_photo_covered"]),
    "covered raw dB": lambda m: decibels(m["psnr_raw_covered"]),
    "covered dB": lambda m: decibels(m["psnr_covered"]),
    "coded–raw dB": lambda m: decibels(m["psnr_decoded_raw"]),
    "SSIM raw": lambda m: number(m["ssim_raw"], 4),
    "SSIM": lambda m: number(m["ssim"], 4),
    "LPIPS": lambda m: number(m["lpips"], 4),
    "KB": lambda m: kilobytes(m["bytes"]),
    "network s": lambda m: number(m["seconds"].get("network"), 2),
    "encode s": lambda m: number(encode_seconds(m["seconds"]), 2),
    "decode s": lambda m: number(decode_seconds(m["seconds"]), 3),
    "render s": lambda m: number(m["seconds"]["render"], 3),
}


def results_text(rows: Sequence[Row], *, has_lpips: bool) -> str:
    """Every group's table: a row per scene, and the means over scenes and over windows; and its other tables."""
    sections = []
    for identity, members in groups_of(rows):
        tables = [group_table(members, has_lpips), zoom_table(members), nested_table(members), refined_table(members)]
        sections.append(f"{title(identity)}\n" + "\n\n".join(filter(None, tables)))
    return "\n\n".join(sections)


def zoom_table(rows: Sequence[Row]) -> str:
    """dB of pictures at multiples of the coded size, and of the coded size's pictures brought to them; empty where
    nothing was zoomed.
    """
    if not any("zoom" in row.figures for row in rows):
        return ""
    lines = []
    for name, (_, mean) in means(rows).items():
        for factor, zoomed in (mean.get("zoom") or {}).items():
            gain = zoomed["psnr"] - zoomed["psnr_enlarged"]
            scale = zoomed["photos_enlarged"]
            photos = "smaller than the picture, enlarged" if scale > 1.001 else "as large or larger"
            cells = decibels(zoomed["psnr_raw"]), decibels(zoomed["psnr"]), decibels(zoomed["psnr_enlarged"])
            lines.append([name, f"{factor} ×", *cells, f"{gain:+.2f}", f"{photos} ({scale:.2f} ×)"])
    return format_table(["scene", "size", "raw dB", "coded dB", "enlarged dB", "gain", "stored photos"], lines)


def nested_table(rows: Sequence[Row]) -> str:
    """dB of the same targets from the nearest 2, 4 and 6 photos; empty where that was not measured."""
    rows = [row for row in rows if "nested" in row.figures]
    if not rows:
        return ""
    lines = [
        [name, *(decibels(mean["nested"].get(str(count))) for count in NESTED)]
        for name, (_, mean) in means(rows).items()
    ]
    return format_table(["scene", *(f"nearest {count} photos, dB" for count in NESTED)], lines)


def nested_summary(rows: Sequence[Row]) -> str:
    """A line per group: means over scenes."""
    lines = []
    for identity, members in groups_of([row for row in rows if row.study == STUDY and "nested" in row.figures]):
        nested = mean_of_scenes(members)["nested"]
        lines.append([f"windows of {identity['views']}", *(decibels(nested.get(str(count))) for count in NESTED)])
    return format_table(["", *(f"nearest {count}, dB" for count in NESTED)], lines) if lines else ""


def refined_table(rows: Sequence[Row]) -> str:
    """dB at held-out photos before and after refinement, by scene; empty where nothing was refined."""
    rows = [row for row in rows if "refined" in row.figures]
    if not rows:
        return ""
    lines = []
    for name, (count, mean) in means(rows).items():
        before, after = mean["refined"]["psnr_before"], mean["psnr_raw"]
        cells = decibels(before), decibels(after), f"{after - before:+.2f}", decibels(mean["psnr"])
        lines.append([name, str(count), *cells, kilobytes(mean["bytes"]), number(mean["seconds"].get("refine"), 1)])
    heads = ["scene", "windows", "before, dB", "refined, dB", "gain", "coded, dB", "KB", "refine s"]
    return format_table(heads, lines)


def refined_summary(rows: Sequence[Row]) -> str:
    """A line per group: means over scenes, and the window that gains least."""
    lines = []
    for identity, members in groups_of([row for row in rows if row.study == STUDY and "refined" in row.figures]):
        mean = mean_of_scenes(members)
        before, after = mean["refined"]["psnr_before"], mean["psnr_raw"]
        least = min(row.figures["psnr_raw"] - row.figures["refined"]["psnr_before"] for row in members)
        cells = decibels(before), decibels(after), f"{after - before:+.2f}", f"{least:+.2f}", decibels(mean["psnr"])
        kind = f"{identity['kind']}, {identity['views']} views"
        lines.append([kind, str(len(members)), *cells, kilobytes(mean["bytes"])])
    heads = ["", "windows", "before, dB", "refined, dB", "gain", "least gain", "coded, dB", "KB"]
    return format_table(heads, lines) if lines else ""


def title(identity: Mapping[str, Any]) -> str:
    """What the rows of a group have in common, in words."""
    size = f"{identity['width']}x{identity['height']}"
    coded = f"{identity['profile']} at Q_g {identity['qp']:g}"
    return f"{identity['kind']}, {identity['views']} views, {identity['model']}, {coded}, {size}"


def means(rows: Sequence[Row]) -> dict[str, tuple[int, dict[str, Any]]]:
    """Number of windows and means, by scene and over all."""
    scenes = grouped(rows, "scene")
    means = {name: (len(members), mean_of_rows(members)) for (name,), members in scenes.items()}
    if len(scenes) > 1:
        means["mean of scenes"] = len(rows), mean_of_scenes(rows)
    if len(rows) > len(scenes):
        means["mean of windows"] = len(rows), mean_of_rows(rows)
    return means


def group_table(rows: Sequence[Row], has_lpips: bool) -> str:
    """Every figure of a group's pictures by scene, and their means."""
    columns = {**_COLUMNS} if has_lpips else {**_COLUMNS, "LPIPS": lambda _: "no weights"}
    lines = [
        [name, str(count), *(cell(mean) for cell in columns.values())] for name, (count, mean) in means(rows).items()
    ]
    return format_table(["scene", "windows", *columns], lines)


def _has_lpips(rows: Sequence[Row]) -> bool:
    return any(row.figures["lpips"] is not None for row in rows)


def _tables(rows: Sequence[Row], table: Callable[[Sequence[Row]], str]) -> str:
    """A table per group."""
    chosen = [row for row in rows if row.study == STUDY]
    titled = [(title(identity), table(members)) for identity, members in groups_of(chosen)]
    return "\n\n".join(f"**{name}**\n\n{text}" for name, text in titled if text)


def summary_table(rows: Sequence[Row]) -> str:
    """A line per group: means over scenes, each scene's the mean of its windows."""
    lines = []
    for identity, members in groups_of([row for row in rows if row.study == STUDY]):
        mean, scenes = mean_of_scenes(members), len(grouped(members, "scene"))
        name = f"{identity['kind']}, {identity['views']} views"
        how = f"{identity['model']}, {identity['profile']} {identity['qp']:g}, {identity['width']}×{identity['height']}"
        cells = (decibels(mean[key]) for key in ("psnr_photo", "psnr_raw", "psnr", "psnr_covered"))
        counts = str(scenes), str(len(members))
        lines.append([name, how, *counts, *cells, number(mean["ssim"], 4), kilobytes(mean["bytes"])])
    heads = ["", "network, coding", "scenes", "windows", "photo dB", "raw dB", "coded dB", "covered dB", "SSIM", "KB"]
    return format_table(heads, lines) if lines else ""


def zoom_summary(rows: Sequence[Row]) -> str:
    """A line per group and multiple: means over scenes."""
    lines = []
    for identity, members in groups_of([row for row in rows if row.study == STUDY]):
        for factor, zoomed in (mean_of_scenes(members).get("zoom") or {}).items():
            dB = (decibels(zoomed[key]) for key in ("psnr_raw", "psnr", "psnr_enlarged"))
            gain = f"{zoomed['psnr'] - zoomed['psnr_enlarged']:+.2f}"
            size = f"{identity['width']}×{identity['height']}, {factor} ×"
            lines.append([f"{identity['kind']}, {identity['views']} views, {identity['model']}", size, *dB, gain])
    return format_table(["", "coded at, drawn at", "raw dB", "coded dB", "enlarged dB", "gain"], lines) if lines else ""


QUALITY = Study(
    "Pictures",
    quality_rows,
    {
        "quality summary": summary_table,
        "quality": lambda rows: _tables(rows, lambda members: group_table(members, _has_lpips(members))),
        "zoom summary": zoom_summary,
        "zoom": lambda rows: _tables(rows, zoom_table),
        "nested summary": nested_summary,
        "nested": lambda rows: _tables(rows, nested_table),
        "refined summary": refined_summary,
        "refined": lambda rows: _tables(rows, refined_table),
    },
)
