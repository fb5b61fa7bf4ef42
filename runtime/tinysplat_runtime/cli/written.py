"""What `decode` and `convert` write: which Gaussians go out, and in what format."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..container.layout import MAX_FILE_BYTES, SUFFIX
from ..container.reader import read_container
from ..errors import InputError
from ..formats.table import save_gaussians, save_points
from ..formats.viewpoints import save_beside
from ..gaussian.editing import cut_degree, drop_transparent, trim_border
from ..gaussian.footprints import widened
from ..gaussian.gaussians import Gaussians
from ..system.files import read_limited
from ..system.progress import progress
from ..system.threads import Crew, available_cores
from .files import Reading, Voice, write_file
from .outputs import is_standard

if TYPE_CHECKING:
    from ..prune.amount import Amount


@dataclass(frozen=True)
class Selection:
    """Which Gaussians go out, and how wide.

    Attributes:
        dilate: own pixels² that they are widened by; None for none.
        trim_border: without so many of the outermost pixels of each view.
        min_opacity: only those of this opacity or more.
        sh_degree: SH cut to this degree.
        thins: whether of a capture, more than `FEW` views, what several of them show goes out from two.
        fuse: for how many seconds Gaussians of all views are made one surface; None for not at all.
        threads: for that, None for all cores.
        quiet: whether it says nothing of how far it is.
    """

    dilate: float | None = None
    trim_border: int | None = None
    min_opacity: float | None = None
    sh_degree: int | None = None
    thins: bool = False
    fuse: float | None = None
    threads: int | None = None
    quiet: bool = False

    def of(self, gaussians: Gaussians) -> Gaussians:
        """What goes out of some Gaussians."""
        if self.dilate is not None:
            gaussians = widened(gaussians, self.dilate)
        if self.trim_border:
            gaussians = trim_border(gaussians, self.trim_border)
        if self.fuse is not None:
            gaussians = self._fused(gaussians, self.fuse)
        elif self.thins:
            gaussians = self._thinned(gaussians)
        if self.min_opacity is not None:
            gaussians = drop_transparent(gaussians, self.min_opacity)
        return gaussians if self.sh_degree is None else cut_degree(gaussians, self.sh_degree)

    def _thinned(self, gaussians: Gaussians) -> Gaussians:
        from ..render.near import FEW

        if len(gaussians.cameras) <= FEW:
            return gaussians
        from ..gaussian.thin import thinned

        found = thinned(gaussians, Crew(self.threads or available_cores()).map)
        if not self.quiet:
            said = f"{found.count} of {gaussians.count} Gaussians go out, for viewers that draw all"
            print(f"{said}; --fuse makes them one, --keep-all keeps all", file=sys.stderr)
        return found

    def _fused(self, gaussians: Gaussians, seconds: float) -> Gaussians:
        try:
            from ..refine.fuse import FuseStats, fused
        except ImportError as error:
            raise InputError(f'needs {error.name}; pip install "tinysplat[fast]" brings it', where="--fuse") from None
        stats = FuseStats()

        def show(steps: Iterator[int]) -> Iterator[int]:
            return progress(steps, None, "fuse", quiet=self.quiet, note=stats.note)

        found = fused(gaussians, seconds=seconds, threads=self.threads, stats=stats, show=show)
        if not self.quiet:
            print(stats.text, file=sys.stderr)
        return found


def pruned(gaussians: Gaussians, amount: Amount | None, reading: Reading, say: Voice) -> Gaussians:
    """What `--prune` leaves, as one list; as they are without it.

    Raises:
        InputError: numba is missing, none shows, or the quality is out of reach.
    """
    if amount is None:
        return gaussians
    try:
        from ..prune.reduction import leave_out
    except ImportError as error:
        raise InputError(f'needs {error.name}; pip install "tinysplat[fast]" brings it', where="--prune") from None
    found = leave_out(gaussians, amount, reading.runtime().threads)
    say(f"{found.text or 'none left out'}, in pictures as defined")
    return found.gaussians


@dataclass(frozen=True)
class Writing:
    """How Gaussian files are written.

    Attributes:
        reading: the options that commands share.
        points: as a plain point cloud.
        sh_bits, spz_version, gltf_spz: see `formats.table.save_gaussians`.
        source: the .tsplat file whose quality a .tsplat file is written with; None for the default profile's.
        turned: whether the Gaussians were turned since it was read.
        keeps_pixels: whether they are all that it holds, at its scale.
        keep_all: of Gaussians of no pixels, even those that pictures hardly need, in a .tsplat file.
        with_cameras: cameras of their photos go into a file beside those that have no room for them.
    """

    reading: Reading
    points: bool = False
    sh_bits: Sequence[int] = (5, 4)
    spz_version: int = 3
    gltf_spz: bool = False
    source: str | None = None
    turned: bool = False
    keeps_pixels: bool = True
    keep_all: bool = False
    with_cameras: bool = False

    def write(self, path: str, gaussians: Gaussians) -> None:
        """Write a file, or to standard output; what the format cannot keep goes to standard error."""
        if is_standard(path):
            self._write_standard(path, gaussians)
        elif self.points:
            save_points(path, gaussians)
        elif path.lower().endswith(SUFFIX):
            write_file(path, self._coded(gaussians))
        else:
            bits = _sh_bits(self.sh_bits)
            for loss in save_gaussians(path, gaussians, bits, self.spz_version, gltf_spz=self.gltf_spz):
                print(f"{path}: {loss}", file=sys.stderr)
            if self.with_cameras and gaussians.viewpoints and not path.lower().endswith(KEEPS_CAMERAS):
                save_beside(Path(path), gaussians)

    def _coded(self, gaussians: Gaussians) -> bytes:
        """A .tsplat file's bytes.

        Moved as a whole they take their source's very pictures, which hold what cameras see; else its profile and Q_g.
        Cut or joined they are no longer pixels of views, and coded as such. What was thinned once stays as it is.
        """
        runtime = self.reading.runtime()
        keep_all = self.keep_all or bool(gaussians.notes.thinned)
        if self.source is None:
            return runtime.compress(gaussians, keep_all=keep_all)
        source = read_limited(self.source, MAX_FILE_BYTES)
        container = read_container(source, runtime.limits)
        if container.mode == "lossless":
            return runtime.compress(gaussians, lossless=gaussians.is_per_pixel)
        turns = self.turned and gaussians.degree > 0  # a basis of SH does not turn along
        # Where the scene grew, steps of depth did not grow along.
        if container.mode != "gaussians" or not gaussians.is_per_pixel or turns or not self.keeps_pixels:
            return runtime.compress(gaussians, container.profile, container.qp, keep_all=keep_all)
        return runtime.compress(gaussians, like=source)

    def _write_standard(self, path: str, gaussians: Gaussians) -> None:
        """To standard output by way of a temporary file; `-` alone is a .tsplat file."""
        import tempfile

        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / f"standard output{Path('x' + path[1:]).suffix or SUFFIX}"
            self.write(str(copy), gaussians)
            write_file(path, copy.read_bytes())


KEEPS_VIEWS = (SUFFIX, ".npz", ".safetensors")
"""Endings of files that know of which view each Gaussian is."""

KEEPS_CAMERAS = (*KEEPS_VIEWS, ".glb", ".gltf")
"""Endings of files that have room for cameras of photos."""


def is_drawn_whole(path: str) -> bool:
    """Whether those who read a file of this name know of no views, and draw all of its Gaussians."""
    name = f"x{path[1:] or SUFFIX}" if is_standard(path) else path
    return not name.lower().endswith(KEEPS_VIEWS)


def _sh_bits(values: Sequence[int]) -> tuple[int, int]:
    if len(values) != 2:
        raise InputError(f"{','.join(map(str, values))}, expected two numbers of 1 to 8", where="--sh-bits")
    return values[0], values[1]
