"""What is looked at before a command's long work begins: its options, and memory. Its outputs: `outputs`."""

from __future__ import annotations

import sys
from argparse import Namespace

from ..api import DEFAULT_MODEL, check_targets
from ..codec.encoder import check_qp
from ..codec.modes.choice import check_options
from ..errors import InputError
from ..graphs.enlarge import LARGE_PIXELS, Enlarger
from ..scene.scenes import Scene
from ..system.memory import available_bytes

BYTES_PER_PIXEL, BYTES_AT_ALL = 1300, 250_000_000
"""Most memory that a network and coding take, per pixel of all photos and besides: edge and sweep as measured."""

LARGE_BYTES_PER_PIXEL = 280
"""The same of large photos, whose small copies alone a network is given: photos 24, Gaussians 56, planning 169."""

MEMORY_SHARE = 0.9
"""Of the memory that is free, at most so much is planned with."""


def check_coding(args: Namespace) -> None:
    """Refuse options of coding that contradict each other or lie out of range, before a network runs."""
    check_targets(
        qp=args.qp, target_size=args.target_size, target_psnr=args.target_psnr, lossless=args.lossless or None,
        like=args.like,
    )  # fmt: skip
    check_qp(args.qp or 0)
    targets = (args.target_size, args.target_psnr, args.lossless, args.like)
    check_options(args.mode, has_target=any(targets))


def fitting_size(scene: Scene) -> tuple[int, int] | None:
    """(height, width) to which photos larger than LARGE_PIXELS are scaled; None where they are not."""
    camera = scene.frames[0].camera
    share = (LARGE_PIXELS / (camera.width * camera.height)) ** 0.5
    return (round(camera.height * share), round(camera.width * share)) if share < 1 else None


def sized(args: Namespace, scene: Scene) -> Scene:
    """The scene at the size that `--size` says, or at one that networks are good for."""
    if args.size == "full":
        return scene
    size = args.size or fitting_size(scene)
    if size is None:
        return scene
    if not args.size and not args.quiet:
        camera = scene.frames[0].camera
        found = f"photos of {camera.width}x{camera.height} scaled to {size[1]}x{size[0]}"
        advice = f"which {args.model or DEFAULT_MODEL} is good for; --size full takes all of them"
        print(f"{scene.path}: {found}, {advice}", file=sys.stderr)
    return scene.resized(*size)


def check_memory(scene: Scene, enlarger: Enlarger | None = None) -> None:
    """Refuse photos that take more memory than is free, with a size that would fit.

    `enlarger` is what the runtime has for large photos of that scene, if it has.
    """
    camera, free = scene.frames[0].camera, available_bytes()
    views = len(scene.frames)
    pixels = views * camera.width * camera.height
    at_all, per_pixel = BYTES_AT_ALL, BYTES_PER_PIXEL
    if enlarger is not None:
        at_all, per_pixel = at_all + views * enlarger.pixels * BYTES_PER_PIXEL, LARGE_BYTES_PER_PIXEL
    needed = at_all + per_pixel * pixels
    if free is None or needed <= MEMORY_SHARE * free:
        return
    fits = max(MEMORY_SHARE * free - at_all, 0) / per_pixel
    share = (fits / pixels) ** 0.5
    size = f"{int(camera.height * share)}x{int(camera.width * share)}"
    found = f"{views} photos of {camera.width}x{camera.height} take about {needed / 1e9:.1f} GB"
    advice = f"--size {size} would fit" if share * min(camera.height, camera.width) >= 64 else "free some first"
    raise InputError(f"{found}, {free / 1e9:.1f} GB are free; {advice}", where=str(scene.path))
