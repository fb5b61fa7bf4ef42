"""`tinysplat convert`: Gaussian files joined, cut, moved, and in other formats."""

from __future__ import annotations

import math
from argparse import Namespace
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, TinySplatError
from ..formats.check import file_loss
from ..formats.viewpoints import seen_from
from ..gaussian.editing import crop, merge, similarity
from ..gaussian.quaternions import normalize_quats, quats_to_matrices
from ..system.stopwatch import Stopwatch
from .files import noted
from .given import notes_of, reading_of, selection_of, voice_of, writing_of
from .written import pruned

_AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


def convert(args: Namespace) -> None:
    """Gaussian files to another format; several become one."""
    if args.check and args.points:
        raise InputError("given with --points, which writes no Gaussians to compare", where="--check")
    reading, selection, parts = replace(reading_of(args), views=args.views), selection_of(args), []
    for file in args.files:
        loaded = reading.load(file, Stopwatch())
        try:
            parts.append(selection.of(loaded))
        except TinySplatError as error:
            raise error.within(file) from None
    gaussians = parts[0] if len(parts) == 1 else merge(parts)
    if args.crop:
        gaussians = crop(gaussians, args.crop[:3], args.crop[3:])
    if args.cameras:
        gaussians = seen_from(gaussians, args.cameras)
    gaussians = similarity(gaussians, _rotation(args.rotate or "x,0"), args.scale, args.translate)
    gaussians = pruned(noted(gaussians, notes_of(args)), args.prune, reading, voice_of(args))
    writing_of(args).write(args.output, gaussians)
    voice_of(args)(f"{args.output}: {gaussians.count} Gaussians of SH degree {gaussians.degree}")
    if args.check:
        print(f"{args.output}: {file_loss(args.output, gaussians)}")


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
