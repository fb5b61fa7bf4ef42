"""`tinysplat encode` and `compress`: photos or Gaussians in, a .tsplat file and what is said of it out."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict

from ..api import DEFAULT_MODEL, Runtime
from ..codec.encoder import EncodeStats
from ..codec.profiles import DEFAULT_PROFILE
from ..container.inspection import inspect_bytes
from ..errors import InputError, TinySplatError
from ..formats.table import load_gaussians, save_gaussians
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
from .reports import attribute_errors, file_report, write_json
from .scenes import named_scene, prepared
from .selfcheck import LOW_DB, likely_fault, own_psnr


def encode(args: Namespace) -> None:
    """Photos and cameras to a .tsplat file."""
    args.profile = _profile(args)
    if args.refine and args.mode in ("photos", "auto"):
        raise InputError(f"with --mode {args.mode}, whose files carry no Gaussians that were refined", where="--refine")
    check_coding(args)
    scene = prepared(args, named_scene(args))
    check_memory(scene)
    args.fault = None if args.quiet else likely_fault(scene)
    if args.fault:
        print(f"{scene.path}: warning: {args.fault}", file=sys.stderr)
    runtime, watch = Runtime(threads=args.threads, providers=providers(args)), Stopwatch()
    with working("network", quiet=args.quiet):
        gaussians = noted(args, runtime.predict(scene, args.model or DEFAULT_MODEL, watch=watch))
    if args.save_gaussians:
        for loss in save_gaussians(args.save_gaussians, gaussians):
            print(f"{args.save_gaussians}: {loss}", file=sys.stderr)
    refinement = RefineStats()
    gaussians = _refined(args, runtime, gaussians, scene, watch, refinement)
    _compress(args, runtime, gaussians, EncodeStats(watch=watch), scene, refinement)


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
        _compress(args, runtime, gaussians, stats, refinement=refinement)
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


def _compress(
    args: Namespace, runtime: Runtime, gaussians: Gaussians, stats: EncodeStats, scene: Scene | None = None,
    refinement: RefineStats | None = None,
) -> None:  # fmt: skip
    names = ("target_size", "target_psnr", "lossless", "drop_invalid")
    options = {name: getattr(args, name) for name in names}
    if args.like is not None:
        options["like"] = read_limited(args.like, MAX_FILE_BYTES)
    if scene is None:
        data = runtime.compress(gaussians, args.profile, args.qp, stats=stats, **options)
    else:
        model = args.model or DEFAULT_MODEL
        data = runtime.encode(
            scene, model, args.profile, args.qp, mode=args.mode, gaussians=gaussians, stats=stats, **options
        )
    with stats.watch.stage("write"):
        write_file(args.output, data)
    seconds = sum(stats.watch.seconds.values())
    if args.report:
        report = file_report(inspect_bytes(data), stats.watch)
        report["clipped"] = stats.clipped
        report["error_by_attribute"] = attribute_errors(
            gaussians, runtime.decompress(data, model=getattr(args, "model", None))
        )
        report["reason"] = stats.reason
        if args.refine and refinement is not None:
            report["refine"] = asdict(refinement)
        write_json(args.report, report)
    raw = sum(getattr(layer, name).nbytes for layer in gaussians.layers for name in FIELDS)
    say(args, f"{args.output}: {len(data)} bytes, 1/{raw / len(data):.0f} of the raw Gaussians, {seconds:.2f} s")
    if stats.reason:
        say(args, f"mode {stats.mode}: {stats.reason}")
    if scene is not None and not args.quiet:
        _report_own(args, scene, runtime.decompress(data, model=args.model), len(data), seconds)


def _report_own(args: Namespace, scene: Scene, decoded: Gaussians, size: int, seconds: float) -> None:
    """The line that `encode` ends with: what there is of what, and how like its own photos it looks."""
    camera, psnr = scene.cameras[0], own_psnr(decoded, scene.images(), args.threads)
    say(
        args, f"{len(scene.frames)} views of {camera.width}x{camera.height}, {decoded.count} Gaussians, {size} bytes,"
        f" {seconds:.1f} s; {psnr:.1f} dB at its own photos",
    )  # fmt: skip
    if psnr < LOW_DB:
        cause = args.fault or "none of the known (units, w2c, axes, overlap); photos may differ in light or time"
        print(f"{scene.path}: warning: {psnr:.1f} dB is low; likely cause: {cause}", file=sys.stderr)
