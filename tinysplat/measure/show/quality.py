"""How good pictures are, as `tinysplat eval` shows it by scene, and pages by kind of window."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

from ..quality import GROUP, STUDY, mean_of_rows
from ..rows import Row, grouped
from .tables import Cell, Listing, Table, Write, decibels, digits, format_table, kilobytes, mean, said

FEW = 7
"""Scenes that a terminal has columns for."""

ENCODE_STAGES = ("vpt", "vabr", "quantise", "x265", "write")
DECODE_STAGES = ("parse", "libavcodec", "synthesis")


def of_scenes(rows: Sequence[Row]) -> list[Row]:
    """A row per scene of each group: means over its windows, and how many these are."""
    found = []
    for members in grouped([row for row in rows if row.study == STUDY and row.figures], *GROUP, "scene").values():
        figures = mean_of_rows(members)
        found.append(replace(members[0], figures={**figures, "windows": len(members)}, costs=figures["seconds"]))
    return found


def results_text(rows: Sequence[Row]) -> str:
    """A table of every group, a figure to a line: the mean of scenes, and where there are few, each."""
    sections = []
    for group, scenes in grouped(of_scenes(rows), *GROUP).items():
        kind, views, model, profile, qp, (height, width) = group
        means = [replace(row, setting={**row.setting, "scene": "mean"}) for row in scenes]
        shown = scenes if len(scenes) == 1 else [*means, *(scenes if len(scenes) <= FEW else [])]
        lines = [[head, *cells] for head, cells in _RESULTS.cells(shown).items()]
        table = format_table(lines[0], lines[1:])
        sections.append(f"{kind}, {views} views, {model}, {profile} at Q_g {qp:g}, {width}x{height}\n{table}")
    return "\n\n".join(sections)


def _coded(rows: Sequence[Row]) -> str:
    height, width = rows[0].setting["size"]
    return "{model}, {profile} {qp:g}, {width}×{height}".format(**rows[0].setting, width=width, height=height)


def _seconds(stages: Sequence[str], rows: Sequence[Row], write: Write) -> str:
    sums = [replace(row, costs={"all": sum(row.costs.get(stage, 0.0) for stage in stages)}) for row in rows]
    return mean("all", write, "costs")(sums)


_COLUMNS: dict[str, Cell] = {
    "windows": lambda rows: str(sum(row.figures["windows"] for row in rows)),
    "photo dB": mean("psnr_photo", decibels),
    "raw dB": mean("psnr_raw", decibels),
    "coded dB": mean("psnr", decibels),
    "fitted dB": mean("fitted", decibels),
    "covered photo dB": mean("psnr_photo_covered", decibels),
    "covered raw dB": mean("psnr_raw_covered", decibels),
    "covered dB": mean("psnr_covered", decibels),
    "coded–raw dB": mean("psnr_decoded_raw", decibels),
    "SSIM raw": mean("ssim_raw", digits(4)),
    "SSIM": mean("ssim", digits(4)),
    "FLIP": mean("flip", digits(4)),
    "sharpness raw": mean("sharpness_raw", digits(3)),
    "sharpness": mean("sharpness", digits(3)),
    "LPIPS": mean("lpips", digits(4)),
    "KB": mean("bytes", kilobytes),
    "network s": mean("network", digits(2), "costs"),
    "encode s": partial(_seconds, ENCODE_STAGES, write=digits(2)),
    "decode s": partial(_seconds, DECODE_STAGES, write=digits(3)),
    "render s": mean("render", digits(3), "costs"),
}

_IN_SHORT = ("windows", "photo dB", "raw dB", "coded dB", "covered dB", "SSIM", "KB")  # what pages show

_RESULTS = Listing(STUDY, {"scene": said("scene"), **_COLUMNS}, by=("scene",))

_SUMMARY = Listing(
    STUDY,
    {
        "": lambda rows: "{kind}, {views} views".format(**rows[0].setting),
        "network, coding": _coded,
        "scenes": lambda rows: str(len(rows)),
        **{head: _COLUMNS[head] for head in _IN_SHORT},
    },
    by=GROUP,
)

TABLES: Mapping[str, Table] = {"quality summary": lambda rows: _SUMMARY(of_scenes(rows))}
"""Of evaluations, which pages show by these names."""
