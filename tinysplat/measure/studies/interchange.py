"""What does each format of Gaussian files cost, in bytes and dB?

What the default network makes of two photos of the room goes out in every format that is written, each as it is by
default, is read again and drawn from its own views: what `convert --check` says of a user's file. Gaussian files that
are given go out in those that README shows.
"""

import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path

from tinysplat_runtime.api import load_gaussians
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE
from tinysplat_runtime.container.layout import SUFFIX
from tinysplat_runtime.formats.check import file_loss
from tinysplat_runtime.formats.table import FORMATS, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.scene.intake.layouts import load_scene

from ..rows import Row
from ..show.tables import Listing, decibels, kilobytes, mean, said
from ..study import Run, Study
from ..subjects.room import write_room

VIEWS = 2
OURS = f"`{SUFFIX}`, {DEFAULT_PROFILE}"


def interchange_rows(run: Run) -> Iterator[Row]:
    """A row per format: bytes, and dB of its pictures beside the original's; .tsplat beside them."""
    if run.paths:
        for path in run.paths:
            yield from _rows(path.stem, load_gaussians(path), _IN_SHORT, run)
        return
    with tempfile.TemporaryDirectory() as folder:
        write_room(Path(folder), VIEWS, run.side, run.side)
        made = run.runtime.predict(load_scene(folder), run.model)
    yield from _rows(f"room, {VIEWS}×{run.side}²", made, [form.name for form in FORMATS], run)


def _rows(subject: str, gaussians: Gaussians, names: Collection[str], run: Run) -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        for form in FORMATS:
            if form.write is not None and form.name in names:
                path = Path(folder, f"scene{form.endings[0]}")
                save_gaussians(path, gaussians)
                loss = file_loss(path, gaussians)
                figures = {"bytes": loss.bytes, "psnr_decoded_raw": loss.psnr}
                yield Row("formats", subject, form.name, {"count": gaussians.count}, figures)
        data, decoded = run.runtime.compress(gaussians), Path(folder, "decoded.npz")
        save_gaussians(decoded, run.runtime.decompress(data))
        figures = {"bytes": len(data), "psnr_decoded_raw": file_loss(decoded, gaussians).psnr}
        yield Row("formats", subject, OURS, {"count": gaussians.count}, figures)


_COLUMNS = {
    "format": said("way"),
    "KB": mean("bytes", kilobytes),
    "dB to its source": mean("psnr_decoded_raw", decibels),
}
_IN_SHORT = ("PLY (3DGS)", "SPZ", "SOG")

_SIDE_BY_SIDE = {
    "": said("subject"),
    "Gaussians": said("count", "{:,}".format),
    "PLY, KB": mean("bytes", kilobytes, way="PLY (3DGS)"),
    "SPZ, KB": mean("bytes", kilobytes, way="SPZ"),
    "SPZ, dB": mean("psnr_decoded_raw", decibels, way="SPZ"),
    "SOG, KB": mean("bytes", kilobytes, way="SOG"),
    "SOG, dB": mean("psnr_decoded_raw", decibels, way="SOG"),
    f"`{SUFFIX}`, KB": mean("bytes", kilobytes, way=OURS),
    f"`{SUFFIX}`, dB": mean("psnr_decoded_raw", decibels, way=OURS),
}

INTERCHANGE = Study(
    "Formats",
    interchange_rows,
    {
        "formats": Listing("formats", _COLUMNS, sections="subject"),
        "formats in short": Listing("formats", _SIDE_BY_SIDE, by=("subject",)),
    },
)
