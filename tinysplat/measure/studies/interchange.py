"""What does each format of Gaussian files cost, in bytes and dB, on one scene?

One made scene (two views of the room, SH degree 3) goes out in every format that is written, each as it is by default,
is read again and drawn from its own views: what `convert --check` says of a user's file.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE
from tinysplat_runtime.container.layout import SUFFIX
from tinysplat_runtime.formats.check import file_loss
from tinysplat_runtime.formats.table import FORMATS, save_gaussians

from ..rows import Row
from ..show.tables import Listing, decibels, kilobytes, mean, said
from ..study import Run, Study
from ..subjects.made import made_gaussians

VIEWS, DEGREE = 2, 3
OURS = f"`{SUFFIX}`, {DEFAULT_PROFILE}"


def interchange_rows(run: Run) -> Iterator[Row]:
    """A row per format: bytes, and dB of its pictures beside the original's; .tsplat beside them."""
    side = run.side // 2
    gaussians = made_gaussians(VIEWS, side, side, DEGREE)
    subject = f"room, {VIEWS}×{side}², SH degree {DEGREE}"
    with tempfile.TemporaryDirectory() as folder:
        for form in FORMATS:
            if form.write is not None:
                path = Path(folder, f"scene{form.endings[0]}")
                save_gaussians(path, gaussians)
                loss = file_loss(path, gaussians)
                yield Row("formats", subject, form.name, figures={"bytes": loss.bytes, "psnr_decoded_raw": loss.psnr})
        data, decoded = run.runtime.compress(gaussians), Path(folder, "decoded.npz")
        save_gaussians(decoded, run.runtime.decompress(data))
        figures = {"bytes": len(data), "psnr_decoded_raw": file_loss(decoded, gaussians).psnr}
        yield Row("formats", subject, OURS, figures=figures)


_COLUMNS = {
    "format": said("way"),
    "KB": mean("bytes", kilobytes),
    "dB to its source": mean("psnr_decoded_raw", decibels),
}
_IN_SHORT = ("PLY (3DGS)", "SOG", "SPZ", OURS)

INTERCHANGE = Study(
    "Formats",
    interchange_rows,
    {
        "formats": Listing("formats", _COLUMNS, sections="subject"),
        "formats in short": Listing("formats", _COLUMNS, wanted=lambda row: row.way in _IN_SHORT),
    },
)
