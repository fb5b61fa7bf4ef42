"""Rows to pages: the report of a run, and the marked places of README and docs.

A place is filled from committed rows and stands between two marks:

    <!-- measured 2026-11-22/formats.jsonl: formats -->
    …
    <!-- end -->

The file lies in `benchmarks/reports/`; the words behind the colon name a table of a study (`Study.tables`), and behind
it, if need be, what chooses rows: `table where subject=…; way=…`. Marks may stand within a line; those behind a
backtick are talked about.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.files import write_atomically

from .machine import RUN
from .rows import Row, read_rows
from .show import quality
from .studies import STUDIES, find_study

REPORT_MD = "report.md"
REPORTS = Path("benchmarks", "reports")

_MARK = re.compile(
    r"(?<!`)(?P<open><!-- measured (?P<file>[^\s:]+): (?P<table>[^>]+?) -->)(?P<text>.*?)(?P<close><!-- end -->)",
    re.DOTALL,
)


def write_report(folder: Path, rows: Sequence[Row], left_out: Sequence[str] = ()) -> Path:
    """Write report.md and its plots beside the rows; returns its path."""
    lines = ["# Measured", "", *_machine(rows), *(f"- {line}" for line in left_out), ""]
    for name in STUDIES:
        study = find_study(name)
        tables = [text for table in study.tables.values() if (text := table(rows))]
        if not tables:
            continue
        lines += [f"## {study.title}", ""]
        for text in tables:
            lines += [text, ""]
        for plot, draw in study.plots.items():
            path = folder / "plots" / f"{plot.replace(' ', '_')}.png"
            if draw(path, rows):
                lines += [f"![{study.title}](plots/{path.name})", ""]
    write_atomically(folder / REPORT_MD, "\n".join(lines).encode())
    return folder / REPORT_MD


def _machine(rows: Sequence[Row]) -> Iterator[str]:
    """What the rows were made on, of every run that made some."""
    for row in rows:
        if row.study != RUN:
            continue
        m: Mapping[str, Any] = row.figures
        memory = f", {m['memory_bytes'] / 1e9:.0f} GB" if m.get("memory_bytes") else ""
        commit = f" at {m['commit']}" if m.get("commit") else ""
        yield (
            f"`tinysplat bench {row.way}`: {row.subject}, {m['cpu']} ({', '.join(m['vector_extensions'])}),"
            f" {m['cores']} of {m['cores_of_machine']} cores{memory}, load {m['load_average']} at the start,"
            f" Python {m['python']}, tinysplat {m['tinysplat']}{commit}, numpy {m['numpy']}, onnxruntime"
            f" {m['onnxruntime']}, av {m['av']}; {row.costs['seconds'] / 60:.1f} minutes.\n"
        )
    yield ("Seconds are medians over interleaved rounds; CPU seconds are those of all threads. KB are 1000 bytes.")


# ---- marked places ------------------------------------------------------------------------------------------------


def pages(root: Path) -> list[Path]:
    """Pages that may have marks."""
    return [root / "README.md", *sorted((root / "docs").rglob("*.md"))]


def filled(text: str, root: Path, page: str = "") -> str:
    """A page with every marked place filled anew from committed rows.

    Raises:
        InputError: a mark names rows or a table that there are not, or nothing is there for it.
    """

    def fill(match: re.Match[str]) -> str:
        found = _marked(root / REPORTS / match["file"], match["table"], page)
        end = "\n" if match["text"].startswith("\n") or not match["text"] else ""
        return f"{match['open']}{end}{found}{end}{match['close']}"

    return _MARK.sub(fill, text)


def fill_pages(root: Path) -> list[Path]:
    """Fill all pages; those that changed."""
    changed = []
    for path in pages(root):
        text = path.read_text("utf-8")
        new = filled(text, root, path.name)
        if new != text:
            write_atomically(path, new.encode())
            changed.append(path)
    return changed


def _marked(path: Path, words: str, page: str) -> str:
    name, _, condition = words.partition(" where ")
    wanted = dict(part.strip().split("=", 1) for part in condition.split(";") if part.strip())
    rows = [
        row
        for row in read_rows(path)
        if all(str(getattr(row, key, row.setting.get(key))) == value for key, value in wanted.items())
    ]
    tables = dict(quality.TABLES) | {
        key: one for study in map(find_study, STUDIES) for key, one in study.tables.items()
    }
    if name not in tables:
        raise InputError(f"no study has a table '{name}'", where=page)
    text = tables[name](rows)
    if not text:
        raise InputError(f"{path.name} has no rows for '{words}'", where=page)
    return text
