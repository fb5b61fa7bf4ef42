"""What `--report` writes: bytes, seconds, memory and errors as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..container.inspection import inspect_bytes
from ..container.layout import MAX_FILE_BYTES
from ..gaussian.gaussians import Gaussians
from ..recipe.report import file_report
from ..system.files import read_limited, write_atomically
from ..system.stopwatch import Stopwatch, peak_rss_bytes
from .files import Reading


def render_report(file: str, reading: Reading, gaussians: Gaussians, watch: Stopwatch) -> dict[str, Any]:
    """The report of `render`: the file's where it is a .tsplat one, or else what its Gaussians are."""
    if Path(file).suffix.lower() == ".tsplat":
        data = read_limited(file, MAX_FILE_BYTES)
        return file_report(inspect_bytes(data, is_prefix=reading.is_in_part), watch)
    return {
        "gaussians": gaussians.count,
        "sh_degree": gaussians.degree,
        "seconds": watch.seconds,
        "peak_rss_bytes": peak_rss_bytes(),
    }


def write_json(path: str, value: dict[str, Any]) -> None:
    """Write a report, whole or not at all."""
    write_atomically(path, (json.dumps(value, indent=2) + "\n").encode())
