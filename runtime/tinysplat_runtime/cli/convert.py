"""`convert`, and what `decode` shares with it: which Gaussians go out, how they are moved, and in what format."""

from __future__ import annotations

import math
import sys
import tempfile
from argparse import Namespace
from collections.abc import Sequence
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
from .files import is_in_part, limited_runtime, load_any, noted, say, write_file
from .outputs import is_standard

_AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


def convert(args: Namespace) -> None:
    """Gaussian files to another format; several become one."""
    if args.check and args.points:
        raise InputError("given with --points, which writes no Gaussians to compare", where="--check")
    parts = []
    for file in args.files:
        loaded = load_any(Namespace(**{**vars(args), "file": file}), Stopwatch())
        try:
            parts.append(selected(args, loaded))
        except TinySplatError as error:
            raise error.within(file) from None
    gaussians = parts[0] if len(parts) == 1 else merge(parts)
    if args.crop:
        gaussians = crop(gaussians, args.crop[:3], args.crop[3:])
    gaussians = noted(args, similarity(gaussians, _rotation(args.rotate or "x,0"), args.scale, args.translate))
    write(args, args.output, gaussians)
    say(args, f"{args.output}: {gaussians.count} Gaussians of SH degree {gaussians.degree}")
    if args.check:
        print(f"{args.output}: {file_loss(args.output, gaussians)}")


def selected(args: Namespace, gaussians: Gaussians) -> Gaussians:
    """What `--views`, `--trim-border`, `--min-opacity` and `--sh-degree` let out, and `--dilate` widens."""
    if args.views is not None:
        gaussians = select_views(gaussians, args.views)
    if args.dilate is not None:
        gaussians = widened(gaussians, args.dilate)
    if args.trim_border:
        gaussians = trim_border(gaussians, args.trim_border)
    if args.min_opacity is not None:
        gaussians = drop_transparent(gaussians, args.min_opacity)
    return gaussians if args.sh_degree is None else cut_degree(gaussians, args.sh_degree)


def write(args: Namespace, path: str, gaussians: Gaussians) -> None:
    """Write a Gaussian file, or with `--points` a point cloud; what the format cannot keep goes to standard error.

    For a .tsplat file see `_coded`.
    """
    if is_standard(path):
        _write_standard(args, path, gaussians)
    elif args.points:
        save_points(path, gaussians)
    elif path.lower().endswith(SUFFIX):
        write_file(path, _coded(args, gaussians))
    else:
        bits = _sh_bits(args.sh_bits)
        for loss in save_gaussians(path, gaussians, bits, args.spz_version, gltf_spz=args.gltf_spz):
            print(f"{path}: {loss}", file=sys.stderr)


def _coded(args: Namespace, gaussians: Gaussians) -> bytes:
    """A .tsplat file's bytes: of the quality of the .tsplat file that the Gaussians came from, if it was one.

    Moved as a whole they take its very pictures, which hold what cameras see; else its profile and Q_g. Cut or joined
    they are no longer pixels of views, and coded as such.
    """
    runtime, files = limited_runtime(args), getattr(args, "files", None) or [args.file]
    if len(files) > 1 or not files[0].lower().endswith(SUFFIX) or is_in_part(args):
        return runtime.compress(gaussians)
    source = read_limited(files[0], MAX_FILE_BYTES)
    container = read_container(source, runtime.limits)
    if container.mode == "lossless":
        return runtime.compress(gaussians, lossless=gaussians.is_per_pixel)
    turns = getattr(args, "rotate", None) and gaussians.degree > 0  # a basis of SH does not turn along
    enlarges = getattr(args, "scale", 1) != 1  # steps of depth do not grow along
    if container.mode != "gaussians" or not gaussians.is_per_pixel or args.views is not None or turns or enlarges:
        return runtime.compress(gaussians, container.profile, container.qp)
    return runtime.compress(gaussians, like=source)


def _write_standard(args: Namespace, path: str, gaussians: Gaussians) -> None:
    """To standard output by way of a temporary file; `-` alone is a .tsplat file."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / f"standard output{Path('x' + path[1:]).suffix or SUFFIX}"
        write(args, str(copy), gaussians)
        write_file(path, copy.read_bytes())


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
