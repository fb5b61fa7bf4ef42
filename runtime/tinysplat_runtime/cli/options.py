"""The options of `encode`, `compress` and `batch` as argparse knows them.

What an option may be and what it is by default stands in `recipe.request`: here they have words and help. One that is
not given stays None, or False.
"""

from __future__ import annotations

import argparse

from ..codec.modes import CHOICES, DEFAULT_MODE
from .arguments import budget, byte_count, size_or_full, views


def add_coding(parser: argparse.ArgumentParser) -> None:
    """How planes are coded."""
    from ..codec.profiles import DEFAULT_PROFILE, PROFILES

    parser.add_argument("--profile", choices=PROFILES, help=f"default: {DEFAULT_PROFILE}")
    rate = parser.add_mutually_exclusive_group()
    rate.add_argument("--qp", type=float, metavar="Q", help="make every quantiser step coarser by 2^(Q/6); default 0")
    rate.add_argument(
        "--target-size",
        type=byte_count,
        metavar="SIZE",
        help="at most 100KB, 1.5MB or this many bytes, of which the file fills 97 %% or more",
    )
    rate.add_argument(
        "--target-psnr",
        type=float,
        metavar="DB",
        help="reach this PSNR of decoded against raw pictures at the input views, within 0.2 dB",
    )
    rate.add_argument("--lossless", action="store_true", help="store float16 planes bit for bit")
    rate.add_argument(
        "--like", metavar="F.tsplat",
        help="use profile, steps and maps of this file, and its pictures where nothing changed",
    )  # fmt: skip
    parser.add_argument(
        "--drop-invalid", action="store_true", help="make Gaussians at or behind their camera transparent"
    )
    parser.add_argument(
        "--refine", type=budget, nargs="?", const="auto", metavar="STEPS|10s",
        help="correct the Gaussians to show their photos better, for this many steps or seconds; without a number, in"
        " as many steps as are usual (needs numba)",
    )  # fmt: skip


def add_photos(parser: argparse.ArgumentParser) -> None:
    """Which photos, how large, and what a network and a file make of them."""
    parser.add_argument(
        "--no-refine", dest="refine", action="store_const", const="no",
        help="leave Gaussians as the network made them; default: captures of more than six photos are refined",
    )  # fmt: skip
    parser.add_argument(
        "--views", type=views, metavar="I,J-K:S|auto[:N]|all",
        help="frames to use: a list, N of them, as many as the capture needs (auto), or all; default: all of up to 6,"
        " else auto",
    )  # fmt: skip
    parser.add_argument(
        "--poses", metavar="POSES",
        help="poses of a video's frames: RealEstate10K .txt, transforms.json, or a folder with these or a COLMAP model",
    )  # fmt: skip
    parser.add_argument(
        "--first-number",
        type=int,
        choices=(0, 1),
        help="number of the first frame in names of POSES such as frame_00012.png; default 0",
    )
    parser.add_argument("--model", metavar="NAME|FILE.onnx", help="network; `tinysplat models` lists them")
    parser.add_argument("--near", type=float, metavar="Z", help="nearest depth in scene units, not the scene's own")
    parser.add_argument("--far", type=float, metavar="Z", help="farthest depth in scene units, not the scene's own")
    parser.add_argument(
        "--size", type=size_or_full, metavar="WxH|full",
        help="scale photos to cover this and crop their centre; default: full, but at most about 640x480 pixels",
    )  # fmt: skip
    parser.add_argument(
        "--mode", choices=CHOICES, help=f"what the file carries; default {DEFAULT_MODE}, which every receiver reads"
    )


def add_notes(parser: argparse.ArgumentParser) -> None:
    """What a file says of itself."""
    parser.add_argument("--unit", metavar="TEXT", help="unit of lengths, such as metre; kept in the file")
    parser.add_argument("--attribution", metavar="TEXT", help="author to name; kept in the file")
    parser.add_argument("--licence", metavar="TEXT", help="licence, such as CC-BY-4.0; kept in the file")


def add_provider(parser: argparse.ArgumentParser) -> None:
    """What runs graphs."""
    parser.add_argument(
        "--provider", metavar="NAME[:KEY=VALUE,…]",
        help="onnxruntime's execution provider, such as CUDA, before the CPU's; `tinysplat doctor` lists them",
    )  # fmt: skip
