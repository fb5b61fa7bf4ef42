"""`tinysplat encode` and `compress`: photos or Gaussians in, a .tsplat file and what is said of it out."""

from argparse import Namespace
from dataclasses import replace
from pathlib import Path

from ..api import Runtime
from ..container.layout import SUFFIX
from ..container.list import List
from ..errors import InputError, within
from ..formats.viewpoints import found_beside
from ..modes import LIST
from ..recipe.compress import Encoded
from ..recipe.compress import compress as compress_gaussians
from ..recipe.export import KEEPS_CAMERAS
from ..recipe.request import Coding, CompressRequest, EncodeRequest, ExportRequest, Upright
from ..system.stopwatch import Stopwatch
from ..system.voice import Voice
from .asks import Compress, Encode, Reported
from .files import Reading, Running, write_file, write_json
from .options import asked, named
from .outputs import is_standard


def encode(args: Namespace) -> None:
    """Photos and cameras to a .tsplat file, or to one list of Gaussians in another format."""
    from ..recipe.encode import encode as encode_photos

    own = asked(args, Encode)
    request, placed = asked(args, EncodeRequest, own.scene), asked(args, Upright)
    voice = own.voice
    runtime = asked(args, Running).runtime(voice)
    if not (is_standard(own.output) or own.output.lower().endswith(SUFFIX)):
        _list(own, request, placed, runtime)
        return
    if moved := next(iter(placed.given()), None):
        fault = f"given with {own.output}, where cameras stay as they are; `tinysplat convert --{moved}` moves it"
        raise InputError(fault, where=f"--{moved}")
    coded = encode_photos(request, runtime, voice, keep=bool(own.report))
    _write(coded, own, runtime, model=request.model)
    if voice.listens:
        _compare(coded, voice, runtime, model=request.model)


def _list(own: Encode, request: EncodeRequest, placed: Upright, runtime: Runtime) -> None:
    """Photos to a file for any viewer: a list that is not coded."""
    from ..recipe.encode import encode as encode_photos
    from ..recipe.export import exported, write_list

    voice, coding = own.voice, {*Coding.options(), "fast"}
    given = [name for name in (*request.given(), *own.given()) if name in coding or name == "report"]
    if given or request.mode not in (None, LIST):
        option = f"--{(given or ['mode'])[0].replace('_', '-')}"
        raise InputError(f"of .tsplat files, expected none with {own.output}", where=option)
    made = encode_photos(replace(request, mode=LIST), runtime, voice, keep=True, is_coded=False).gaussians
    assert made is not None
    export = ExportRequest(**placed.given())
    with named(placed.options()):
        gaussians = exported([("", made)], own.output, export, runtime, voice)
    for loss in write_list(own.output, gaussians, export):
        voice.say("notice", loss, own.output)
    size = Path(own.output).stat().st_size
    voice.done(f"{size} bytes, {gaussians.count} Gaussians of SH degree {gaussians.degree}", own.output)


def compress(args: Namespace) -> None:
    """Gaussians of any network to a .tsplat file."""
    own, reading = asked(args, Compress), asked(args, Reading)
    voice, runtime = own.voice, reading.runtime(own.voice)
    gaussians = reading.load(own.file, runtime, Stopwatch(), grid=own.grid)
    with within(own.file):
        request = asked(args, CompressRequest, gaussians)
    if gaussians.viewpoints and not (request.cameras or own.file.endswith(KEEPS_CAMERAS)):
        used = f"used as cameras of {len(gaussians.viewpoints)} photos"
        voice.say("notice", used, found_beside(Path(own.file)) or "")
    with within(own.file):
        coded = compress_gaussians(request, runtime, voice, keep=bool(own.report))
        _write(coded, own, runtime, model=reading.model)


def _write(coded: Encoded, own: Reported, runtime: Runtime, *, model: str | None) -> None:
    """Write the file and its report, and say what it is."""
    data, stats, voice = coded.data, coded.stats, own.voice
    with stats.watch.stage("write"):
        write_file(own.output, data)
    if own.report:
        from ..recipe.report import encode_report

        write_json(own.report, encode_report(coded, runtime, model=model))
    share = coded.raw_bytes / len(data)
    voice.done(f"{len(data)} bytes, 1/{share:.0f} of the raw Gaussians, {coded.seconds:.2f} s", own.output)
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
    count, psnr = compared(coded, runtime, model, voice)
    voice.done(
        f"{len(scene.frames)} views of {camera.width}x{camera.height}, {count} Gaussians,"
        f" {len(coded.data)} bytes, {coded.seconds:.1f} s; {psnr:.1f} dB at its own photos"
    )
    if psnr < LOW_DB:
        known = "not units, w2c, axes or overlap; photos may differ in light or time"
        cause = coded.doubts[0] if coded.doubts else known
        voice.say("doubt", f"{psnr:.1f} dB is low; likely cause: {cause}", scene.path)
