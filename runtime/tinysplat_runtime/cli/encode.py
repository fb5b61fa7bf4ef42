"""`tinysplat encode` and `compress`: photos or Gaussians in, a .tsplat file and what is said of it out."""

from __future__ import annotations

import sys
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..api import Runtime
from ..container.points import Points
from ..errors import TinySplatError
from ..formats.viewpoints import found_beside
from ..graphs.providers import providers_of
from ..recipe.encode import Encoded, Listener
from ..recipe.encode import compress as compress_gaussians
from ..recipe.encode import encode as encode_photos
from ..recipe.export import KEEPS_CAMERAS
from ..recipe.request import CompressRequest, EncodeRequest
from ..refine.stats import RefineStats
from ..scene.scenes import Scene
from ..system.printable import printable
from ..system.progress import Show, progress, working
from ..system.stopwatch import Stopwatch
from .files import Voice, write_file, write_json
from .given import asked, reading_of, voice_of


def encode(args: Namespace) -> None:
    """Photos and cameras to a .tsplat file."""
    request, runtime = (
        asked(args, EncodeRequest, args.scene),
        Runtime(threads=args.threads, providers=providers_of(args.provider)),
    )
    coded = encode_photos(request, runtime, _listener(quiet=args.quiet), keep=bool(args.report))
    _write(voice_of(args), coded, args.report, runtime, model=args.model)
    if not args.quiet:
        from ..recipe.own import looked_at, near_of, own_psnr

        with working("comparing", quiet=False):
            photos = len(coded.photos.frames)
            near, seen = near_of(coded.data, photos, runtime, args.model), coded.photos.views(looked_at(photos))
            some = near(seen.cameras[0])
            psnr = own_psnr(near, seen.cameras, seen.images(), args.threads)
        _report_own(voice_of(args), coded, some.count // len(some.cameras) * photos, psnr)


def _listener(*, quiet: bool) -> Listener:
    """What the command says while it is at work."""

    def notice(text: str) -> None:
        print(printable(text), file=sys.stderr)

    def doubt(scene: Scene, text: str) -> None:
        print(printable(f"{scene.path}: warning: {text}"), file=sys.stderr)

    def show(label: str) -> Show:
        return lambda items, total, note: progress(items, total, label, quiet=quiet, note=note)

    def refined(stats: RefineStats) -> None:
        print(stats.text)

    def at_work(label: str) -> Any:
        return working(label, quiet=quiet)

    if quiet:
        return Listener(working=at_work)
    return Listener(notice, doubt, at_work, show("photos"), show("refine"), refined, show)


def compress(args: Namespace) -> None:
    """Gaussians of any network to a .tsplat file."""
    reading = replace(reading_of(args), grid=args.grid)
    runtime, gaussians = reading.runtime(), reading.load(args.gaussians, Stopwatch())
    if gaussians.viewpoints and not (args.cameras or args.quiet or args.gaussians.endswith(KEEPS_CAMERAS)):
        used = f"{found_beside(Path(args.gaussians))}: used as cameras of {len(gaussians.viewpoints)} photos"
        print(printable(used), file=sys.stderr)
    try:
        request = asked(args, CompressRequest, gaussians)
        coded = compress_gaussians(request, runtime, _listener(quiet=args.quiet), keep=bool(args.report))
        _write(voice_of(args), coded, args.report, runtime, model=args.model)
    except TinySplatError as error:
        raise error.within(args.gaussians) from None


def _write(say: Voice, coded: Encoded, report: str | None, runtime: Runtime, *, model: str | None) -> None:
    """Write the file and its report, and say what it is."""
    output = say.output
    data, stats = coded.data, coded.stats
    with stats.watch.stage("write"):
        write_file(output, data)
    if report:
        from ..recipe.report import encode_report

        write_json(report, encode_report(coded, runtime, model=model))
    share = coded.raw_bytes / len(data)
    say(f"{output}: {len(data)} bytes, 1/{share:.0f} of the raw Gaussians, {coded.seconds:.2f} s")
    if stats.reason:
        say(f"mode {stats.mode}: {stats.reason}")
    elif stats.mode == Points.mode:
        if stats.left_out:
            say(f"pruned {stats.left_out:,} Gaussians: {stats.left_out_psnr:.1f} dB between pictures with and without")
        say("coded as a list; if these are pixels of known views, --grid V,H,W and --cameras make the file smaller")


def _report_own(say: Voice, coded: Encoded, count: int, psnr: float) -> None:
    """The line that `encode` ends with: what there is of what, and how like its own photos it looks."""
    scene, camera = coded.photos, coded.photos.cameras[0]
    say(
        f"{len(scene.frames)} views of {camera.width}x{camera.height}, {count} Gaussians,"
        f" {len(coded.data)} bytes, {coded.seconds:.1f} s; {psnr:.1f} dB at its own photos"
    )
    from ..recipe.own import LOW_DB

    if psnr < LOW_DB:
        known = "none of the known (units, w2c, axes, overlap); photos may differ in light or time"
        cause = coded.doubts[0] if coded.doubts else known
        print(printable(f"{scene.path}: warning: {psnr:.1f} dB is low; likely cause: {cause}"), file=sys.stderr)
