"""`tinysplat encode` and `compress`: photos or Gaussians in, a .tsplat file and what is said of it out."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from pathlib import Path

from ..api import Runtime
from ..container.layout import SUFFIX
from ..container.list import List
from ..errors import InputError, within
from ..formats.viewpoints import found_beside
from ..graphs.providers import providers_of
from ..modes import LIST
from ..network.ways import LEAST_EACH
from ..recipe.encode import Encoded, listed
from ..recipe.encode import compress as compress_gaussians
from ..recipe.encode import encode as encode_photos
from ..recipe.export import KEEPS_CAMERAS
from ..recipe.request import CompressRequest, EncodeRequest
from ..system.stopwatch import Stopwatch
from ..system.voice import Voice
from .files import named, write_file, write_json
from .given import asked, reading_of, voice_of
from .outputs import is_standard
from .parser import OF_EXPORTS


def encode(args: Namespace) -> None:
    """Photos and cameras to a .tsplat file, or to one list of Gaussians in another format."""
    voice = voice_of(args)
    runtime = Runtime(threads=args.threads, providers=providers_of(args.provider), told=voice)
    if not (is_standard(args.output) or args.output.lower().endswith(SUFFIX)):
        _list(args, voice, runtime)
        return
    moved = next((name for name in OF_EXPORTS if getattr(args, name)), None)
    if moved:
        fault = f"given with {args.output}, where cameras stay as they are; `tinysplat convert --{moved}` moves it"
        raise InputError(fault, where=f"--{moved}")
    request = asked(args, EncodeRequest, args.scene)
    coded = encode_photos(request, runtime, voice, keep=bool(args.report))
    _write(coded, voice, args, runtime)
    if voice.listens:
        _compare(coded, voice, runtime, model=request.model)


def _list(args: Namespace, voice: Voice, runtime: Runtime) -> None:
    """Photos to a file for any viewer: a list that is not coded."""
    from ..recipe.export import exported, write_list
    from ..recipe.request import Coding, ExportRequest

    given = [name for name in (*Coding.options(), "report", "fast") if getattr(args, name, None)]
    if given or args.mode not in (None, LIST):
        option = f"--{(given or ['mode'])[0].replace('_', '-')}"
        raise InputError(f"of .tsplat files, expected none with {args.output}", where=option)
    args.mode = LIST
    with named(OF_EXPORTS):
        request = ExportRequest.of(**{name: getattr(args, name) for name in OF_EXPORTS})
    gaussians, *_ = listed(asked(args, EncodeRequest, args.scene), runtime, voice)
    with named(OF_EXPORTS):
        gaussians = exported([("", gaussians)], args.output, request, runtime, voice)
    for loss in write_list(args.output, gaussians, request):
        voice.say("notice", loss, args.output)
    size = Path(args.output).stat().st_size
    voice.done(f"{size} bytes, {gaussians.count} Gaussians of SH degree {gaussians.degree}", args.output)


def compress(args: Namespace) -> None:
    """Gaussians of any network to a .tsplat file."""
    voice = voice_of(args)
    reading = replace(reading_of(args, voice), grid=args.grid)
    runtime, gaussians = reading.runtime(), reading.load(args.gaussians, Stopwatch())
    if gaussians.viewpoints and not (args.cameras or args.gaussians.endswith(KEEPS_CAMERAS)):
        used = f"used as cameras of {len(gaussians.viewpoints)} photos"
        voice.say("notice", used, found_beside(Path(args.gaussians)) or "")
    with within(args.gaussians):
        request = asked(args, CompressRequest, gaussians)
        coded = compress_gaussians(request, runtime, voice, keep=bool(args.report))
        _write(coded, voice, args, runtime)


def _write(coded: Encoded, voice: Voice, args: Namespace, runtime: Runtime) -> None:
    """Write the file and its report, and say what it is."""
    data, stats = coded.data, coded.stats
    with stats.watch.stage("write"):
        write_file(args.output, data)
    if args.report:
        from ..recipe.report import encode_report

        write_json(args.report, encode_report(coded, runtime, model=args.model))
    share = coded.raw_bytes / len(data)
    voice.done(f"{len(data)} bytes, 1/{share:.0f} of the raw Gaussians, {coded.seconds:.2f} s", args.output)
    if stats.mode == List.mode:
        if stats.psnr is not None:
            pruned = f"{stats.left_out:,} Gaussians pruned" if stats.left_out else "all Gaussians kept"
            voice.done(f"{stats.psnr:.1f} dB to what was given, in {stats.views}; {pruned}")
        else:
            voice.done("all Gaussians kept; how like they look from where people stand, only cameras tell")
        if coded.scene is None:
            smaller = "if these are pixels of known views, --grid V,H,W and --cameras make the file smaller"
            voice.done(f"coded as a list; {smaller}")


def _compare(coded: Encoded, voice: Voice, runtime: Runtime, *, model: str) -> None:
    """The line that `encode` ends with: what there is of what, and how like its own photos it looks."""
    from ..recipe.own import LOW_DB, compared

    scene, camera = coded.photos, coded.photos.cameras[0]
    compiled = None if len(scene.frames) >= LEAST_EACH else False  # which judging and training have loaded
    look = compared(coded.data, scene, runtime, model, voice, compiled=compiled)
    voice.done(
        f"{len(scene.frames)} views of {camera.width}x{camera.height}, {look.gaussians} Gaussians,"
        f" {len(coded.data)} bytes, {coded.seconds:.1f} s; {look.psnr:.1f} dB at its own photos"
    )
    if look.psnr < LOW_DB:
        known = "not units, w2c, axes or overlap; photos may differ in light or time"
        cause = coded.doubts[0] if coded.doubts else known
        voice.say("doubt", f"{look.psnr:.1f} dB is low; likely cause: {cause}", scene.path)
