"""Tables for people and for spreadsheets."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from .records import Record
from .summary import Group, decode_seconds, encode_seconds, flat_row, group_records, mean_of_scenes, mean_record

ABSENT = "–"
NO_WEIGHTS = "no weights"

Cell = Callable[[dict[str, Any]], str]


def format_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table whose columns line up: the first to the left, the others to the right."""
    lines = [list(header), *(list(row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]

    def text(line: Sequence[str]) -> str:
        cells = [line[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(line[1:], widths[1:], strict=True))]
        return f"| {' | '.join(cells)} |"

    rule = "|".join(["-" * (widths[0] + 2), *("-" * (w + 1) + ":" for w in widths[1:])])
    return "\n".join([text(lines[0]), f"|{rule}|", *(text(line) for line in lines[1:])])


def number(value: Any, digits: int) -> str:
    """A number with so many digits behind the point, or a dash."""
    return ABSENT if value is None else f"{value:.{digits}f}"


_COLUMNS: dict[str, Cell] = {
    "photo dB": lambda m: number(m["psnr_photo"], 2),
    "raw dB": lambda m: number(m["psnr_raw"], 2),
    "coded dB": lambda m: number(m["psnr"], 2),
    "covered photo dB": lambda m: number(m["psnr_photo_covered"], 2),
    "covered raw dB": lambda m: number(m["psnr_raw_covered"], 2),
    "covered dB": lambda m: number(m["psnr_covered"], 2),
    "coded–raw dB": lambda m: number(m["psnr_decoded_raw"], 2),
    "SSIM raw": lambda m: number(m["ssim_raw"], 4),
    "SSIM": lambda m: number(m["ssim"], 4),
    "LPIPS": lambda m: number(m["lpips"], 4),
    "KB": lambda m: number(m["bytes"] / 1000, 1),
    "network s": lambda m: number(m["seconds"].get("network"), 2),
    "encode s": lambda m: number(encode_seconds(m["seconds"]), 2),
    "decode s": lambda m: number(decode_seconds(m["seconds"]), 3),
    "render s": lambda m: number(m["seconds"]["render"], 3),
}


def results_text(records: Sequence[Record], *, has_lpips: bool) -> str:
    """Every group's table: a row per scene, and the means over scenes and over windows."""
    return "\n\n".join(f"{group.title}\n{_group_table(group, has_lpips)}" for group in group_records(records))


def _group_table(group: Group, has_lpips: bool) -> str:
    means = {name: (len(records), mean_record(records)) for name, records in group.scenes.items()}
    if len(means) > 1:
        means["mean of scenes"] = (len(group.records), mean_of_scenes(group))
    if len(group.records) > len(group.scenes):
        means["mean of windows"] = (len(group.records), mean_record(group.records))
    columns = {**_COLUMNS} if has_lpips else {**_COLUMNS, "LPIPS": lambda _: NO_WEIGHTS}
    rows = [[name, str(count), *(cell(m) for cell in columns.values())] for name, (count, m) in means.items()]
    return format_table(["scene", "windows", *columns], rows)


def csv_text(records: Sequence[Record]) -> str:
    """One row per record, columns of all records."""
    rows = [flat_row(record) for record in records]
    columns = list(dict.fromkeys(name for row in rows for name in row))
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()
