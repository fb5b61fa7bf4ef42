"""Studies on pictures so small that a test can afford them, and what their tables show."""

import re
from pathlib import Path

from tinysplat.commands.bench import measure_studies
from tinysplat.measure.rows import ROWS, Row, RowFile
from tinysplat.measure.study import Run, StudyOptions
from tinysplat_runtime.api import Runtime


class TinyRun(Run):
    """A run on views of 32 pixels."""

    side = 32  # type: ignore[assignment]


def tiny_run(folder: Path, *paths: Path, **options: object) -> TinyRun:
    """A run on inputs, or on the built-in ones, with `options` as the command line has them; rows go to `folder`."""
    options = {"size": (48, 64), **options}
    return TinyRun(True, Runtime(threads=1), RowFile(folder / ROWS), paths, "sweep", StudyOptions(**options))


def shows(text: str, value: float) -> bool:
    """Whether a number stands in a text, with however many digits behind its point; whole ones may stand without."""
    numbers = (number.replace(",", "") for number in re.findall(r"\d[\d,]*(?:\.\d+)?", text))
    known = (number for number in numbers if "." in number or value == round(value))
    return any(abs(float(number) - abs(value)) <= 0.51 * 10.0 ** -len(number.partition(".")[2]) for number in known)


def rows_of(study: str, run: Run) -> list[Row]:
    """Measured and kept."""
    return measure_studies(run, (study,), quiet=True)
