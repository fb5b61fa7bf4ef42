"""`convert`, and what `decode` shares with it: which Gaussians go out, how they are moved, and in what format."""

from __future__ import annotations

import math
import sys
import tempfile
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..api import MAX_FILE_BYTES
from ..container.layout import SUFFIX
from ..container.reader import read_container
from ..errors import InputError, TinySplatError
from ..formats.check import file_loss
from ..formats.table import save_gaussians, save_points
from ..gaussian.editing import crop, cut_degree, drop_transparent, merge, select_views, similarity, trim_border
from ..gaussian.footprints import widened
from ..gaussian.gaussians import Gaussians
from ..gaussian.quaternions import normalize_quats, quats_to_matrices
from ..system.files import read_limited
from ..system.stopwatch import Stopwatch
from .files import Reading, noted, write_file
from .given import notes_of, reading_of, selection_of, voice_of, writing_of
from .outputs import is_standard

_AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


@dataclass(frozen=True)
class Selection:
    """Which Gaussians go out, and how wide.

    Attributes:
        views: only those of these views; None for all.
        dilate: own pixels² that they are widened by; None for none.
        trim_border: without so many of the outermost pixels of each view.
        min_opacity: only those of this opacity or more.
        sh_degree: SH cut to this degree.
    """

    views: Sequence[int] | None = None
    dilate: float | None = None
    trim_border: int | None = None
    min_opacity: float | None = None
    sh_degree: int | None = None

    def of(self, gaussians: Gaussians) -> Gaussians:
        """What goes out of some Gaussians."""
        if self.views is not None:
            gaussians = select_views(gaussians, self.views)
        if self.dilate is not None:
            gaussians = widened(gaussians, self.dilate)
        if self.trim_border:
            gaussians = trim_border(gaussians, self.trim_border)
        if self.min_opacity is not None:
            gaussians = drop_transparent(gaussians, self.min_opacity)
        return gaussians if self.sh_degree is None else cut_degree(gaussians, self.sh_degree)


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
    """

    reading: Reading
    points: bool = False
    sh_bits: Sequence[int] = (5, 4)
    spz_version: int = 3
    gltf_spz: bool = False
    source: str | None = None
    turned: bool = False
    keeps_pixels: bool = True

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

    def _coded(self, gaussians: Gaussians) -> bytes:
        """A .tsplat file's bytes.

        Moved as a whole they take their source's very pictures, which hold what cameras see; else its profile and Q_g.
        Cut or joined they are no longer pixels of views, and coded as such.
        """
        runtime = self.reading.runtime()
        if self.source is None:
            return runtime.compress(gaussians)
        source = read_limited(self.source, MAX_FILE_BYTES)
        container = read_container(source, runtime.limits)
        if container.mode == "lossless":
            return runtime.compress(gaussians, lossless=gaussians.is_per_pixel)
        turns = self.turned and gaussians.degree > 0  # a basis of SH does not turn along
        # Where the scene grew, steps of depth did not grow along.
        if container.mode != "gaussians" or not gaussians.is_per_pixel or turns or not self.keeps_pixels:
            return runtime.compress(gaussians, container.profile, container.qp)
        return runtime.compress(gaussians, like=source)

    def _write_standard(self, path: str, gaussians: Gaussians) -> None:
        """To standard output by way of a temporary file; `-` alone is a .tsplat file."""
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / f"standard output{Path('x' + path[1:]).suffix or SUFFIX}"
            self.write(str(copy), gaussians)
            write_file(path, copy.read_bytes())


def convert(args: Namespace) -> None:
    """Gaussian files to another format; several become one."""
    if args.check and args.points:
        raise InputError("given with --points, which writes no Gaussians to compare", where="--check")
    reading, selection, parts = reading_of(args), selection_of(args), []
    for file in args.files:
        loaded = reading.load(file, Stopwatch())
        try:
            parts.append(selection.of(loaded))
        except TinySplatError as error:
            raise error.within(file) from None
    gaussians = parts[0] if len(parts) == 1 else merge(parts)
    if args.crop:
        gaussians = crop(gaussians, args.crop[:3], args.crop[3:])
    gaussians = similarity(gaussians, _rotation(args.rotate or "x,0"), args.scale, args.translate)
    gaussians = noted(gaussians, notes_of(args))
    writing_of(args).write(args.output, gaussians)
    voice_of(args)(f"{args.output}: {gaussians.count} Gaussians of SH degree {gaussians.degree}")
    if args.check:
        print(f"{args.output}: {file_loss(args.output, gaussians)}")


def _sh_bits(values: Sequence[int]) -> tuple[int, int]:
    if len(values) != 2:
        raise InputError(f"{','.join(map(str, values))}, expected two numbers of 1 to 8", where="--sh-bits")
    return values[0], values[1]


def _rotation(text: str) -> NDArray:
    """`x,90` (an axis and degrees) or `w,x,y,z` (a quaternion) as a matrix (3, 3)."""
    axis, *rest = text.split(",")
    try:
        if axis in _AXES and len(rest) == 1:
            half = math.radians(float(rest[0])) / 2
            quat = np.array([math.cos(half), *(math.sin(half) * np.array(_AXES[axis]))])
        else:
            quat = np.array([float(axis), *map(float, rest)])
        usable = quat.shape == (4,) and np.isfinite(quat).all() and quat.any()
    except ValueError:
        usable = False
    if not usable:
        raise InputError(f"'{text}', expected AXIS,DEGREES such as x,90 or a quaternion w,x,y,z", where="--rotate")
    return quats_to_matrices(normalize_quats(quat))
