"""How good pictures are, as `tinysplat eval` shows it by scene, and pages by kind of window."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from ..quality import STUDY, decode_seconds, encode_seconds, groups_of, mean_of_rows, mean_of_scenes
from ..rows import Row, grouped
from .tables import Table, decibels, format_table, kilobytes, number


class Part(NamedTuple):
    """A line of a table: rows of one size, and the means of their figures."""

    name: str
    rows: Sequence[Row]
    mean: dict[str, Any]


def by_scene(rows: Sequence[Row]) -> list[Part]:
    """A group's scenes, and the means over scenes and over windows where these are others."""
    scenes = grouped(rows, "scene")
    parts = [Part(name, members, mean_of_rows(members)) for (name,), members in scenes.items()]
    if len(scenes) > 1:
        parts.append(Part("mean of scenes", rows, mean_of_scenes(rows)))
    if len(rows) > len(scenes):
        parts.append(Part("mean of windows", rows, mean_of_rows(rows)))
    return parts


def results_text(rows: Sequence[Row], *, has_lpips: bool) -> str:
    """Every group's tables by scene."""
    sections = []
    for identity, members in groups_of(rows):
        coded = "{kind}, {views} views, {model}, {profile} at Q_g {qp:g}, {width}x{height}".format(**identity)
        parts = by_scene(members)
        tables = [every_figure(parts, has_lpips), refined_table(parts)]
        sections.append(f"{coded}\n" + "\n\n".join(filter(None, tables)))
    return "\n\n".join(sections)


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
    "FLIP": lambda m: number(m.get("flip"), 4),
    "sharpness raw": lambda m: number(m.get("sharpness_raw"), 3),
    "sharpness": lambda m: number(m.get("sharpness"), 3),
    "LPIPS": lambda m: number(m["lpips"], 4),
    "KB": lambda m: kilobytes(m["bytes"]),
    "network s": lambda m: number(m["seconds"].get("network"), 2),
    "encode s": lambda m: number(encode_seconds(m["seconds"]), 2),
    "decode s": lambda m: number(decode_seconds(m["seconds"]), 3),
    "render s": lambda m: number(m["seconds"]["render"], 3),
}


def every_figure(parts: Sequence[Part], has_lpips: bool) -> str:
    """All that was measured of pictures and bytes, and the seconds."""
    columns = {**_COLUMNS} if has_lpips else {**_COLUMNS, "LPIPS": lambda _: "no weights"}
    lines = [[part.name, str(len(part.rows)), *(cell(part.mean) for cell in columns.values())] for part in parts]
    return format_table(["scene", "windows", *columns], lines)


def summary_table(rows: Sequence[Row]) -> str:
    """By group of evaluations, what matters most, as means over scenes, and how much was measured."""
    lines = []
    for group, members in groups_of([row for row in rows if row.study == STUDY and row.figures]):
        mean, scenes = mean_of_scenes(members), len(grouped(members, "scene"))
        name = "{kind}, {views} views".format(**group)
        how = "{model}, {profile} {qp:g}, {width}×{height}".format(**group)
        cells = (decibels(mean[key]) for key in ("psnr_photo", "psnr_raw", "psnr", "psnr_covered"))
        counts = str(scenes), str(len(members))
        lines.append([name, how, *counts, *cells, number(mean["ssim"], 4), kilobytes(mean["bytes"])])
    heads = ["", "network, coding", "scenes", "windows", "photo dB", "raw dB", "coded dB", "covered dB", "SSIM", "KB"]
    return format_table(heads, lines) if lines else ""


def refined_table(parts: Sequence[Part]) -> str:
    """dB at held-out photos before and after refinement, and the window that gains least."""
    lines = []
    for part in (part for part in parts if part.mean.get("refined")):
        mean, before, after = part.mean, part.mean["refined"]["psnr_before"], part.mean["psnr_raw"]
        least = min(row.figures["psnr_raw"] - row.figures["refined"]["psnr_before"] for row in part.rows)
        cells = decibels(before), decibels(after), f"{after - before:+.2f}", f"{least:+.2f}", decibels(mean["psnr"])
        lines.append([part.name, str(len(part.rows)), *cells, kilobytes(mean["bytes"])])
    heads = ["", "windows", "before, dB", "refined, dB", "gain", "least gain", "coded, dB", "KB"]
    return format_table(heads, lines) if lines else ""


TABLES: Mapping[str, Table] = {"quality summary": summary_table}
"""Of evaluations, which pages show by these names."""
