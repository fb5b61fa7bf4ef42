"""`tinysplat encode` and `compress`: photos or Gaussians in, a .tsplat file and what is said of it out."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

from ..api import DEFAULT_MODEL, Runtime
from ..codec.encoder import EncodeStats
from ..codec.modes import DEFAULT_MODE
from ..codec.profiles import DEFAULT_PROFILE
from ..container.inspection import inspect_bytes
from ..errors import InputError, TinySplatError
from ..formats.table import load_gaussians, save_gaussians
from ..gaussian.difference import attribute_errors
from ..gaussian.gaussians import FIELDS, Gaussians
from ..refine.stats import RefineStats
from ..scene.intake.layouts import load_cameras, load_scene
from ..scene.scenes import Scene
from ..system.files import read_limited
from ..system.progress import progress, working
from ..system.stopwatch import Stopwatch
from .checks import check_coding, check_memory
from .files import (
    MAX_FILE_BYTES,
    grid_option,
    limited_runtime,
    load_any,
    noted,
    providers,
    say,
    write_file,
)
from .reports import file_report, write_json
from .scenes import named_scene, prepared
from .selfcheck import LOW_DB, doubts, own_psnr


@dataclass(frozen=True)
class Coded:
    """What came of coding.

    Attributes:
        runtime: that coded.
        gaussians: what went in, where a report is to be made of it: of large photos they take gigabytes.
        raw_bytes: of their arrays.
        data: the file's bytes.
        stats, refinement: what was measured on the way.
        scene: the photos, where there were some.
        doubts: what is likely wrong with them, a line each.
    """

    runtime: Runtime
    gaussians: Gaussians | None
    raw_bytes: int
    data: bytes
    stats: EncodeStats
    refinement: RefineStats
    scene: Scene | None = None
    doubts: tuple[str, ...] = ()

    @property
    def seconds(self) -> float:
        """Of all stages."""
        return sum(self.stats.watch.seconds.values())

    @property
    def photos(self) -> Scene:
        """The scene of Gaussians that came from photos."""
        assert self.scene is not None
        return self.scene


def encode(args: Namespace) -> None:
    """Photos and cameras to a .tsplat file."""
    check_encoding(args)
    coded = encoded(args, Runtime(threads=args.threads, providers=providers(args.provider)))
    _write(args, coded)
    if not args.quiet:
        with working("render at the photos' views", quiet=False):
            decoded = coded.runtime.decompress(coded.data, model=args.model)
            psnr = own_psnr(decoded, coded.photos.images(), args.threads)
        _report_own(args, coded, decoded, psnr)


def check_encoding(args: Namespace) -> None:
    """Set the profile; InputError where options of `encode` contradict each other or lie out of range."""
    args.profile = _profile(args)
    if args.refine and args.mode in ("photos", "auto"):
        raise InputError(f"with --mode {args.mode}, whose files carry no Gaussians that were refined", where="--refine")
    check_coding(args)


def encoded(args: Namespace, runtime: Runtime) -> Coded:
    """What the options of `encode` make of a scene; nothing is written but `--save-gaussians`."""
    scene = prepared(args, named_scene(args))
    model, whole = args.model or DEFAULT_MODEL, args.mode != DEFAULT_MODE
    check_memory(scene, runtime.enlarger(scene, model, whole=whole), mode=args.mode, refined=bool(args.refine))
    found = [] if args.quiet else doubts(scene)
    for doubt in found:
        print(f"{scene.path}: warning: {doubt}", file=sys.stderr)
    stats, refinement = EncodeStats(), RefineStats()
    with working("network", quiet=args.quiet):
        gaussians = noted(args, runtime.predict(scene, model, whole=whole, watch=stats.watch))
    if args.save_gaussians:
        for loss in save_gaussians(args.save_gaussians, gaussians):
            print(f"{args.save_gaussians}: {loss}", file=sys.stderr)
    gaussians = _refined(args, runtime, gaussians, scene, stats.watch, refinement)
    with working("coding", quiet=args.quiet):
        data = runtime.encode(
            scene, args.model or DEFAULT_MODEL, args.profile, args.qp, mode=args.mode, gaussians=gaussians,
            stats=stats, **_coding_options(args),
        )  # fmt: skip
    kept = gaussians if args.report else None
    return Coded(runtime, kept, _raw_bytes(gaussians), data, stats, refinement, scene, tuple(found))


def compress(args: Namespace) -> None:
    """Gaussians of any network to a .tsplat file."""
    args.profile = _profile(args)
    if args.mode != "gaussians":
        raise InputError(f"'{args.mode}' needs photos, and Gaussians come with none; use encode", where="--mode")
    if bool(args.refine) != bool(args.photos):
        given, missing = ("--refine", "--photos SCENE") if args.refine else ("--photos", "--refine STEPS")
        raise InputError(f"needs {missing} too", where=given)
    check_coding(args)
    grid = grid_option(args.grid)
    cameras = load_cameras(args.cameras) if args.cameras else None
    if grid or cameras:
        gaussians = load_gaussians(args.gaussians, grid=grid, cameras=cameras)
    else:
        args.file = args.gaussians
        gaussians = load_any(args, Stopwatch())
    gaussians = noted(args, gaussians)
    runtime, stats, refinement = limited_runtime(args), EncodeStats(), RefineStats()
    try:
        if args.photos:
            gaussians = _refined(args, runtime, gaussians, load_scene(args.photos), stats.watch, refinement)
        with working("coding", quiet=args.quiet):
            data = runtime.compress(gaussians, args.profile, args.qp, stats=stats, **_coding_options(args))
        _write(args, Coded(runtime, gaussians, _raw_bytes(gaussians), data, stats, refinement))
    except TinySplatError as error:
        raise error.within(args.gaussians) from None


def _profile(args: Namespace) -> str:
    """The profile asked for, or the default; InputError where the rest of the command leaves it no say."""
    for option in ("lossless", "like"):
        if args.profile and getattr(args, option):
            raise InputError(f"given with --{option}, which leaves it no say; expected one of them", where="--profile")
    return args.profile or DEFAULT_PROFILE


def _refined(
    args: Namespace, runtime: Runtime, gaussians: Gaussians, scene: Scene, watch: Stopwatch, stats: RefineStats
) -> Gaussians:
    """The Gaussians after `--refine`, if that was asked for."""
    if not args.refine:
        return gaussians

    def show(steps: Iterable[int], total: int | None, note: Callable[[], str]) -> Iterator[int]:
        return progress(steps, total, "refine", quiet=args.quiet, note=note)

    steps, seconds = args.refine.steps, args.refine.seconds
    with watch.stage("refine"):
        gaussians = runtime.refine(
            gaussians, scene, steps, seconds=seconds, profile=args.profile, qp=args.qp, stats=stats, show=show
        )
    if not args.quiet:
        print(stats.text)
    return gaussians


def _coding_options(args: Namespace) -> dict[str, Any]:
    names = ("target_size", "target_psnr", "lossless", "drop_invalid")
    like = {} if args.like is None else {"like": read_limited(args.like, MAX_FILE_BYTES)}
    return {**{name: getattr(args, name) for name in names}, **like}


def _write(args: Namespace, coded: Coded) -> None:
    """Write the file and its report, and say what it is."""
    data, stats = coded.data, coded.stats
    with stats.watch.stage("write"):
        write_file(args.output, data)
    if args.report:
        write_json(args.report, report(args, coded))
    share = coded.raw_bytes / len(data)
    say(args, f"{args.output}: {len(data)} bytes, 1/{share:.0f} of the raw Gaussians, {coded.seconds:.2f} s")
    if stats.reason:
        say(args, f"mode {stats.mode}: {stats.reason}")
    elif stats.mode == "free":
        say(
            args,
            "mode free: Gaussians that belong to no pixels; --grid V,H,W and --cameras cameras.json say whose they are",
        )


def _raw_bytes(gaussians: Gaussians) -> int:
    return sum(getattr(layer, name).nbytes for layer in gaussians.layers for name in FIELDS)


def report(args: Namespace, coded: Coded) -> dict[str, Any]:
    """What `--report` writes."""
    assert coded.gaussians is not None
    # Gaussians of no pixels come back in another order, and not all of them.
    is_free = coded.stats.mode == "free"
    decoded = None if is_free else coded.runtime.decompress(coded.data, model=getattr(args, "model", None))
    return {
        **file_report(inspect_bytes(coded.data), coded.stats.watch),
        "clipped": coded.stats.clipped,
        "error_by_attribute": attribute_errors(coded.gaussians, decoded) if decoded else {},
        "reason": coded.stats.reason,
        **({"refine": asdict(coded.refinement)} if args.refine else {}),
    }


def _report_own(args: Namespace, coded: Coded, decoded: Gaussians, psnr: float) -> None:
    """The line that `encode` ends with: what there is of what, and how like its own photos it looks."""
    scene, camera = coded.photos, coded.photos.cameras[0]
    say(
        args, f"{len(scene.frames)} views of {camera.width}x{camera.height}, {decoded.count} Gaussians,"
        f" {len(coded.data)} bytes, {coded.seconds:.1f} s; {psnr:.1f} dB at its own photos",
    )  # fmt: skip
    if psnr < LOW_DB:
        known = "none of the known (units, w2c, axes, overlap); photos may differ in light or time"
        cause = coded.doubts[0] if coded.doubts else known
        print(f"{scene.path}: warning: {psnr:.1f} dB is low; likely cause: {cause}", file=sys.stderr)
