"""The options of `encode`, `compress` and `batch` as argparse knows them.

What an option may be and what it is by default stands in `recipe.request`: here they have words and help. One that is
not given stays None, or False.
"""

from __future__ import annotations

import argparse
from typing import TypeAlias

from ..codec.modes import CHOICES
from .arguments import budget, byte_count, count, size_or_full, views

Options: TypeAlias = "argparse._ActionsContainer"
"""A parser, or a group of its options; argparse has no public name for both."""


def add_coding(options: Options) -> None:
    """How planes are coded."""
    from ..codec.profiles import DEFAULT_PROFILE, PROFILES

    options.add_argument(
        "--profile", choices=PROFILES, metavar="P", help=f"{', '.join(PROFILES)}; default {DEFAULT_PROFILE}"
    )
    rate = options.add_mutually_exclusive_group()
    rate.add_argument("--qp", type=float, metavar="Q", help="steps coarser by 2^(Q/6); default 0")
    rate.add_argument("--target-size", type=byte_count, metavar="SIZE", help="at most 100KB, 1.5MB or so many bytes")
    rate.add_argument("--target-psnr", type=float, metavar="DB", help="this many dB of decoded against raw pictures")
    rate.add_argument("--lossless", action="store_true", help="float16 planes, bit for bit")
    rate.add_argument("--like", metavar="F.tsplat", help="steps and unchanged pictures of this file")
    options.add_argument("--drop-invalid", action="store_true", help="hide Gaussians at or behind their camera")


def add_refine(options: Options) -> None:
    """For how long Gaussians are corrected."""
    options.add_argument(
        "--refine",
        type=budget,
        nargs="?",
        const="auto",
        metavar="STEPS|10s",
        help="correct Gaussians until they show their photos",
    )


def add_photos(options: Options) -> None:
    """Which photos, how large, and what a network and a file make of them."""
    options.add_argument("--views", type=views, metavar="I,J-K|auto[:N]|all", help="photos; all of 6, else auto")
    options.add_argument(
        "--size", type=size_or_full, metavar="WxH|full", help="of photos; default at most about 640x480"
    )
    options.add_argument("--model", metavar="NAME|FILE.onnx", help="network; `tinysplat models` lists them")
    add_refine(options)
    options.add_argument(
        "--no-refine",
        dest="refine",
        action="store_const",
        const="no",
        help="as the network made them; captures are refined",
    )
    options.add_argument("--mode", choices=CHOICES, metavar="MODE", help=f"the file has: {', '.join(CHOICES)}")


def add_notes(options: Options) -> None:
    """What a file says of itself."""
    options.add_argument("--unit", metavar="TEXT", help="of lengths, such as metre; kept in the file")
    options.add_argument("--attribution", metavar="TEXT", help="author to name; kept in the file")
    options.add_argument("--licence", metavar="TEXT", help="such as CC-BY-4.0; kept in the file")


def add_provider(options: Options) -> None:
    """What runs graphs."""
    options.add_argument("--provider", metavar="NAME[:K=V,…]", help="of onnxruntime (`tinysplat doctor` lists them)")


def add_threads(options: Options) -> None:
    """How many threads work; for commands whose work has some."""
    options.add_argument("--threads", type=count, metavar="N", help="default: all cores; changes no result")
