"""What the commands of `cli/parser.py` do: files in, files out, results on standard output."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..api import DEFAULT_MODEL, SUFFIX, Runtime
from ..codec.encoder import EncodeStats
from ..codec.profiles import DEFAULT_PROFILE
from ..container.inspection import inspect_bytes
from ..errors import InputError, TinySplatError
from ..formats.table import load_gaussians, save_gaussians
from ..gaussian.gaussians import FIELDS, Gaussians
from ..graphs.artifacts import load_manifest
from ..refine.stats import RefineStats
from ..render import Renderer, between, orbit
from ..render.paths import outside
from ..render.video import write_video
from ..scene.cameras import Camera
from ..scene.images import png_bytes
from ..scene.intake.layouts import load_cameras, load_scene
from ..scene.scenes import Scene
from ..system.files import read_limited, write_atomically
from ..system.progress import progress, working
from ..system.stopwatch import Stopwatch, peak_rss_bytes
from .checks import check_coding, check_memory
from .convert import convert, selected, write
from .describe import describe_gaussians, gaussians_text
from .doctor import examine
from .doctor import text as doctor_text
from .files import (
    MAX_FILE_BYTES,
    STANDARD,
    decompress_named,
    file_limits,
    grid_option,
    is_in_part,
    limited_runtime,
    load_any,
    noted,
    providers,
    read_file,
    say,
    write_file,
)
from .scenes import named_scene, prepared
from .selfcheck import LOW_DB, likely_fault, own_psnr
from .view import view

DEEPEST = 65535
"""Largest value of a depth map's 16 bits."""

__all__ = ["compress", "convert", "decode", "doctor", "encode", "info", "models", "render", "view"]


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


def decode(args: Namespace) -> None:
    """A .tsplat file back to Gaussians."""
    runtime, watch = limited_runtime(args), Stopwatch()
    data = read_file(args.file)
    gaussians = decompress_named(runtime, data, args, watch)
    gaussians = noted(args, selected(args, gaussians))
    with watch.stage("write"):
        write(args, args.output, gaussians)
    if args.report:
        described = inspect_bytes(data, runtime.limits, is_prefix=is_in_part(args))
        _write_json(args.report, _report(described, watch))
    say(args, f"{args.output}: {gaussians.count} Gaussians of SH degree {gaussians.degree}")


def render(args: Namespace) -> None:
    """A picture or a video of Gaussians."""
    suffix = ".png" if args.output == STANDARD else Path(args.output).suffix.lower()
    if suffix not in (".png", ".mp4"):
        raise InputError(f"'{suffix}', accepted are .png and .mp4", where=args.output)
    wants_depth = args.depth or args.depth_colours
    if suffix == ".mp4" and wants_depth:
        raise InputError("a depth map is a picture; expected an output that ends in .png", where=args.output)
    if suffix == ".png" and args.path:
        raise InputError("a path makes a video; expected an output that ends in .mp4", where=args.output)
    watch = Stopwatch()
    gaussians = load_any(args, watch)
    # Loading compiled code takes longer than drawing one picture without it.
    compiled = None if suffix == ".mp4" else False
    renderer = Renderer(gaussians, args.threads, dilation=args.dilation, order=args.order, compiled=compiled)
    if suffix == ".png":
        camera = _chosen_camera(args.camera, gaussians)
        with watch.stage("render"):
            image = renderer.render(camera, args.size, outputs=("depth",) if wants_depth else ("rgb",))
        if wants_depth:
            image = depth_colours(image["depth"]) if args.depth_colours else _depth_map(args, image["depth"])
        write_file(args.output, png_bytes(image))
    else:
        path = _camera_path(args, gaussians)
        with watch.stage("render"):
            # libx264 codes on threads of its own while the next frame is drawn; drawing ahead of it gains nothing.
            frames = (renderer.render(camera, args.size) for camera in path)
            write_video(args.output, progress(frames, len(path), "render", quiet=args.quiet))
    if args.report:
        _write_json(args.report, _render_report(args, gaussians, watch))
    seconds = watch.seconds["render"]
    rate = "" if suffix == ".png" else f", {len(path)} frames, {len(path) / seconds:.1f} frames/s"
    say(args, f"{args.output}: {seconds:.3f} s{rate}")


def depth_colours(depth: NDArray) -> NDArray:
    """Depths z (H, W) as (H, W, 3) in [0, 1], even in 1/z: red near, blue far, black where nothing is."""
    seen = depth > 0
    inverse = np.divide(1, depth, out=np.zeros_like(depth), where=seen)
    far, near = np.percentile(inverse[seen], (2, 98)) if seen.any() else (0.0, 1.0)
    t = ((inverse - far) / max(near - far, 1e-12))[..., None]
    return np.clip(1.5 - 3 * np.abs(t - (0.75, 0.5, 0.25)), 0, 1).astype(np.float32) * seen[..., None]


def _depth_map(args: Namespace, depth: NDArray) -> NDArray:
    """Depths z in scene units as (H, W) uint16 of z · `--depth-scale`, 0 where nothing is seen."""
    scaled = np.rint(depth.astype(np.float64) * args.depth_scale)
    beyond = int((scaled > DEEPEST).sum())
    if beyond:
        reach = DEEPEST / args.depth_scale
        print(
            f"{args.output}: {beyond} pixels deeper than {reach:g} units written as {reach:g}; a smaller --depth-scale"
            " reaches farther", file=sys.stderr,
        )  # fmt: skip
    return np.where(scaled > 0, scaled.clip(1, DEEPEST), 0).astype(np.uint16)


def info(args: Namespace) -> None:
    """What a file holds."""
    if args.file != STANDARD and not args.file.lower().endswith(SUFFIX):
        about = describe_gaussians(args.file)
        print(json.dumps(about, indent=2) if args.json else gaussians_text(about))
        return
    data = read_file(args.file)
    try:
        described = inspect_bytes(data, file_limits(args))
    except TinySplatError as error:
        raise error.within(args.file) from None
    print(json.dumps(described, indent=2) if args.json else info_text(args.file, described))


def doctor(args: Namespace) -> None:
    """What is installed, and what is wrong with it; InputError where something is."""
    report = examine()
    print(json.dumps(report, indent=2) if args.json else doctor_text(report))
    if report["wrong"]:
        raise InputError(f"{len(report['wrong'])} things are wrong, the first: {report['wrong'][0]}", where="doctor")


def models(args: Namespace) -> None:
    """The networks and graphs at hand."""
    artifacts = load_manifest()
    if args.json:
        print(json.dumps({name: artifact.entry for name, artifact in artifacts.items()}, indent=2, ensure_ascii=False))
        return
    for name, artifact in artifacts.items():
        size = artifact.path.stat().st_size if artifact.path.is_file() else 0
        purpose = (artifact.entry or {}).get("purpose", "")
        print(f"{name:18} {artifact.role:10} {size / 1000:9.1f} KB  {purpose}")


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
        report = _report(inspect_bytes(data), stats.watch)
        report["clipped"] = stats.clipped
        report["error_by_attribute"] = _errors(gaussians, runtime.decompress(data, model=getattr(args, "model", None)))
        report["reason"] = stats.reason
        if args.refine and refinement is not None:
            report["refine"] = asdict(refinement)
        _write_json(args.report, report)
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


def _errors(gaussians: Gaussians, decoded: Gaussians) -> dict[str, dict[str, float]]:
    """Root mean square and largest error per attribute, world units; rotations as angles in degrees."""
    errors: dict[str, dict[str, float]] = {}
    for name in FIELDS:
        pairs = [
            (getattr(a, name).astype(np.float64), getattr(b, name).astype(np.float64))
            for a, b in zip(gaussians.layers, decoded.layers, strict=True)
        ]
        parts = [_angles(a, b) if name == "quats" else _padded(a, b) for a, b in pairs]
        values = np.concatenate([part.ravel() for part in parts])
        errors[name] = {"rmse": float(np.sqrt(np.mean(values**2))), "max": float(np.abs(values).max())}
    return errors


def _angles(a: NDArray, b: NDArray) -> NDArray:
    cosine = np.abs((a * b).sum(-1)) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1))
    return np.degrees(2 * np.arccos(np.clip(cosine, 0, 1)))


def _padded(a: NDArray, b: NDArray) -> NDArray:
    """Difference; SH coefficients that the file left out count as zeros."""
    if a.shape != b.shape:
        b = np.concatenate([b, np.zeros((*b.shape[:-2], a.shape[-2] - b.shape[-2], 3))], axis=-2)
    return a - b


def _report(described: dict[str, Any], watch: Stopwatch) -> dict[str, Any]:
    keys = (
        "mode",
        "bytes",
        "bytes_by_class",
        "metadata_bytes",
        "views",
        "height",
        "width",
        "gaussians",
        "sh_degree",
        "k",
    )
    return {
        **{key: described[key] for key in keys},
        "error_by_attribute": {},
        "clipped": {},
        "seconds": watch.seconds,
        "peak_rss_bytes": peak_rss_bytes(),
        "left_out": described["left_out"],
    }


def _render_report(args: Namespace, gaussians: Gaussians, watch: Stopwatch) -> dict[str, Any]:
    if Path(args.file).suffix.lower() == ".tsplat":
        data = read_limited(args.file, MAX_FILE_BYTES)
        return _report(inspect_bytes(data, file_limits(args), is_prefix=is_in_part(args)), watch)
    return {
        "gaussians": gaussians.count,
        "sh_degree": gaussians.degree,
        "seconds": watch.seconds,
        "peak_rss_bytes": peak_rss_bytes(),
    }


def _write_json(path: str, value: dict[str, Any]) -> None:
    write_atomically(path, (json.dumps(value, indent=2) + "\n").encode())


def _chosen_camera(text: str | None, gaussians: Gaussians) -> Camera:
    """`INDEX` of the file's own views, or `cameras.json:INDEX`."""
    source, _, index_text = (text or "0").rpartition(":")
    try:
        index = int(index_text)
    except ValueError:
        raise InputError(f"'{text}', expected INDEX or cameras.json:INDEX", where="--camera") from None
    cameras = load_cameras(source) if source else gaussians.cameras or (outside(gaussians),)
    if not 0 <= index < len(cameras):
        raise InputError(f"{index}, accepted are 0 to {len(cameras) - 1}", where="--camera")
    return cameras[index]


def _camera_path(args: Namespace, gaussians: Gaussians) -> list[Camera]:
    """Along the file's own views or those of `--camera`; around Gaussians without views, framed as `view` does it."""
    source = (args.camera or "").rpartition(":")[0]
    cameras = tuple(load_cameras(source)) if source else gaussians.cameras
    if args.camera and not source:
        raise InputError("a video takes all views, those of --camera cameras.json:INDEX", where="--camera")
    if not cameras and args.path == "between":
        raise InputError(
            f"{args.file} has no views to fly between; --path orbit, or --camera cameras.json:0", where="--path"
        )
    views = cameras or (outside(gaussians),)
    if args.path == "orbit" or not cameras:
        return orbit(views, args.frames, _median_depth(gaussians, views[0]))
    return between(views, args.frames)


def _median_depth(gaussians: Gaussians, camera: Camera) -> float:
    flat = gaussians.flat()
    z = (flat.means.astype(np.float64) + flat.origin - camera.centre) @ camera.rotation[2]
    return float(np.median(z[z > 0])) if (z > 0).any() else 1.0


def info_text(file: str, described: dict[str, Any]) -> str:
    """`inspect`'s object as the text that `info` prints."""
    d = described
    total = d["bytes"]
    lines = [
        f"{file}: {total} bytes, format {d['version']}, mode {d['mode']}, profile {d['profile']}, Q_g {d['qp']:g}",
        f"{d['views']} views of {d['width']}x{d['height']}" + _gaussians_text(d),
        *_network_lines(d),
        *(f"{name}: {text}" for name, text in d["notes"].items() if text),
        *([f"refined: {d['refined']}"] if d["refined"] else []),
        "",
        "class        bytes   share",
        *(f"{name:9} {n:8}  {n / total:6.1%}" for name, n in d["bytes_by_class"].items()),
        f"{'metadata':9} {d['metadata_bytes']:8}  {d['metadata_bytes'] / total:6.1%}",
        "",
        "view         bytes",
        *(f"{view:<9} {n:8}" for view, n in enumerate(d["bytes_by_view"])),
        "",
        "layer plane       coding    QP         step    bytes",
        *(_plane_text(plane) for plane in d["planes"]),
        "",
        "a prefix of  adds",
        *(f"{p['bytes']:11}  layer {p['layer']}: {', '.join(p['adds'])}" for p in d["prefixes"]),
    ]
    if d["left_out"]:
        lines += ["", "left out", *(f"  {_left_out_text(entry)}" for entry in d["left_out"])]
    return "\n".join(lines)


def _gaussians_text(d: dict[str, Any]) -> str:
    if d["gaussians"] is None:
        return ""
    return f", {d['gaussians']} Gaussians in {len(d['layers'])} layers, SH degree {d['sh_degree']}, k = {d['k']}"


def _network_lines(d: dict[str, Any]) -> list[str]:
    if d["network"] is None:
        return []
    network, photos = d["network"], d["photos"]
    return [
        f"network {network['name']}, sha256 {network['sha256']}, near {network['near']:g}, far {network['far']:g}",
        f"photos of {photos['width']}x{photos['height']} at QP {photos['qp']}: {photos['bytes']} bytes",
    ]


def _plane_text(plane: dict[str, Any]) -> str:
    if plane["coding"] == "constant":
        return f"{plane['layer']:5} {plane['name']:11} constant   –  = {plane['value']:<10.4g} {plane['bytes']:7}"
    coding = f"{plane['coding']:8} {plane['qp']:3} {plane['step']:12.4g}"
    return f"{plane['layer']:5} {plane['name']:11} {coding} {plane['bytes']:8}"


def _left_out_text(entry: dict[str, Any]) -> str:
    rest = ", ".join(
        f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in entry.items() if k not in ("layer", "what")
    )
    return f"layer {entry['layer']}: {entry['what']} ({rest})"
