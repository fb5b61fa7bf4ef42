"""`tinysplat convert`: Gaussian files joined, cut, moved, and in other formats."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace

from ..errors import InputError
from ..formats.check import file_loss
from ..system.stopwatch import Stopwatch
from .given import reading_of, writing_of


def convert(args: Namespace) -> None:
    """Gaussian files to another format; several become one."""
    if args.check and args.points:
        raise InputError("given with --points, which writes no Gaussians to compare", where="--check")
    reading = replace(reading_of(args), views=args.views)
    watch = Stopwatch()
    gaussians = writing_of(args).write([(file, reading.load(file, watch)) for file in args.files], watch)
    if args.check:
        print(f"{args.output}: {file_loss(args.output, gaussians)}")
