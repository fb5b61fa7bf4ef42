"""`tinysplat convert`: Gaussian files joined, cut, moved, and in other formats."""

from __future__ import annotations

from argparse import Namespace

from ..errors import InputError
from ..formats.check import file_loss
from ..system.stopwatch import Stopwatch
from .given import writing_of


def convert(args: Namespace) -> None:
    """Gaussian files to another format; several become one."""
    if args.check and args.points:
        raise InputError("given with --points, which writes no Gaussians to compare", where="--check")
    writing, watch = writing_of(args), Stopwatch()
    gaussians = writing.write([(file, writing.reading.load(file, watch)) for file in args.files], watch)
    if args.check:
        print(f"{args.output}: {file_loss(args.output, gaussians)}")
