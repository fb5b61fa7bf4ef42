"""Rate–distortion of the profiles, and of other formats, on Gaussian files: bytes against decoded-vs-raw PSNR.

    python benchmarks/rate_distortion.py G.npz … [--profiles paper,balanced] [--qps 0,6,12] [--peers] [-o FOLDER]
    python benchmarks/rate_distortion.py G.npz … --ablation

Pictures are taken at the cameras in a file's `target_K` and `target_c2w`, or else midway between its views. Writes
rate_distortion.json and rate_distortion.png, and prints bytes at equal dB, BD-rate against the first profile, bytes per
class, and processor seconds. `--ablation` takes the ideas of the profile `balanced` away one by one instead: a BD-rate
above 0 is what an idea gains.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from tinysplat.bench.inputs import truncated
from tinysplat.bench.peers import MAX_DEGREE, MissingToolError, peer_formats
from tinysplat.commands.eval import numbers, words
from tinysplat.evaluation import ideas
from tinysplat.evaluation.plots import Curve, save_curves
from tinysplat.evaluation.rate_distortion import Pictures, Point, bd_rate, bytes_at, measure_point, to_json
from tinysplat.evaluation.sources import FileSource
from tinysplat.evaluation.tables import ABSENT, format_table, number
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.profiles import PROFILES, Profile, find_profile
from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.gaussians import Gaussians
from tinysplat_runtime.inspection import inspect_bytes

EQUAL_DB = (38.0, 39.0, 40.0, 41.0)
Curves = dict[str, list[Point]]
Encode = Callable[[Gaussians], bytes]


def build_parser() -> argparse.ArgumentParser:
    """The script's options."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("files", nargs="+", metavar="G.npz", help="Gaussian files")
    parser.add_argument("--profiles", type=words, default=tuple(PROFILES), metavar="P,P", help="default: all")
    parser.add_argument("--qps", type=numbers, default=(0.0, 4.0, 8.0, 12.0, 16.0), metavar="Q,Q")
    parser.add_argument("--targets", type=int, default=3, metavar="N", help="pictures per file at most; default 3")
    parser.add_argument("--peers", action="store_true", help="SPZ and SOG too, where they are installed")
    parser.add_argument("--ablation", action="store_true", help="profile balanced without each of its ideas")
    parser.add_argument("--threads", type=int, default=None, metavar="N", help="default: all cores")
    parser.add_argument("-o", "--output", default="rate_distortion", metavar="FOLDER")
    return parser


def encoders(options: argparse.Namespace, runtime: Runtime) -> dict[str, Callable[[float], Encode]]:
    """What is compared, by name, the reference first: for each Q_g a way to code."""

    def of_profile(profile: Profile) -> Callable[[float], Encode]:
        return lambda qp: (
            lambda g: encode_gaussians(g, profile, qp, runtime.store, threads=runtime.threads, drop_invalid=True)
        )

    def of_change(change: ideas.Change) -> Callable[[float], Encode]:
        return lambda qp: lambda g: ideas.encode_changed(g, qp, runtime, change)

    if not options.ablation:
        return {name: of_profile(find_profile(name)) for name in options.profiles}
    return {
        "balanced": of_profile(PROFILES["balanced"]),
        "steps not measured": of_profile(ideas.without_measured_steps()),
        **{name: of_change(change) for name, change in ideas.CHANGES.items()},
    }


def curves_of(path: str, options: argparse.Namespace, runtime: Runtime) -> Curves:
    """All curves on one file."""
    source = FileSource(Path(path))
    case = source.load(source.windows()[0][0], "", (0, 0), runtime)
    pictures = Pictures(case.gaussians, case.cameras[: options.targets], runtime.threads)
    curves: Curves = {}
    for name, encode in encoders(options, runtime).items():
        curves[name] = []
        for qp in options.qps:
            point = measure_point(pictures, case.gaussians, qp, encode(qp), runtime.decompress, classes)
            curves[name].append(point)
            print(f"{source.name} {name} Q_g {qp:g}: {point.bytes} B, {point.psnr:.2f} dB", file=sys.stderr)
    if options.peers:
        curves |= peer_points(case.gaussians, pictures, runtime)
    return curves


def classes(data: bytes) -> dict[str, int]:
    """Bytes per class and of the metadata."""
    described = inspect_bytes(data)
    return {**described["bytes_by_class"], "metadata": described["metadata_bytes"]}


def peer_points(gaussians: Gaussians, pictures: Pictures, runtime: Runtime) -> Curves:
    """Formats that have no quality to choose: one point each, of SH cut to what they hold."""
    if gaussians.degree > MAX_DEGREE:
        gaussians = truncated(gaussians, MAX_DEGREE)
    points: Curves = {}
    for peer in peer_formats(runtime, sog_limit_s=600):
        if peer.name.startswith(("SPZ", "SOG")):
            try:
                points[peer.name] = [measure_point(pictures, gaussians, 0.0, peer.encode, peer.decode)]
            except MissingToolError as error:
                print(f"left out {peer.name}: {error}", file=sys.stderr)
    return points


def summary(curves: Mapping[str, Sequence[Point]]) -> str:
    """Tables: bytes at equal dB as shares of the reference's, BD-rate, seconds; and bytes per class."""
    reference = next(iter(curves.values()))
    rows, by_class = [], []
    for name, points in curves.items():
        sizes = [(bytes_at(points, db), bytes_at(reference, db)) for db in EQUAL_DB]
        cells = [ABSENT if a is None else f"{a / 1000:.1f}" + (f" ({a / b:.0%})" if b else "") for a, b in sizes]
        try:
            rate = f"{bd_rate(reference, points, (EQUAL_DB[0], EQUAL_DB[-1])):+.1%}"
        except InputError:
            rate = ABSENT
        times = [float(np.median([getattr(p, key) for p in points])) for key in ("encode_cpu_s", "decode_cpu_s")]
        rows.append([name, *cells, rate, *(number(t, 3) for t in times)])
        for point in points:
            if point.bytes_by_class:
                sizes_by_class = [number(n / 1000, 1) for n in point.bytes_by_class.values()]
                by_class.append([f"{name} Q_g {point.setting:g}", number(point.psnr, 2), *sizes_by_class])
    header = ["", *(f"KB at {db:g} dB" for db in EQUAL_DB), "BD-rate 38–41 dB", "encode CPU s", "decode CPU s"]
    labels = list(next(p.bytes_by_class for points in curves.values() for p in points if p.bytes_by_class))
    return format_table(header, rows) + "\n\n" + format_table(["KB", "dB", *labels], by_class)


def main() -> int:
    """Measure, print, write."""
    options = build_parser().parse_args()
    folder = Path(options.output)
    runtime = Runtime(threads=options.threads)
    try:
        results = {path: curves_of(path, options, runtime) for path in options.files}
    except (TinySplatError, OSError) as error:
        print(f"rate_distortion: {error}", file=sys.stderr)
        return 2
    folder.mkdir(parents=True, exist_ok=True)
    for path, curves in results.items():
        print(f"{Path(path).stem}\n{summary(curves)}\n")
    document = {Path(path).stem: {n: to_json(p) for n, p in curves.items()} for path, curves in results.items()}
    (folder / "rate_distortion.json").write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n")
    panels = {
        f"{Path(path).stem}: dB to the raw render": [
            Curve(name, [(p.bytes / 1000, p.psnr) for p in points]) for name, points in curves.items()
        ]
        for path, curves in results.items()
    }
    save_curves(folder / "rate_distortion.png", "decoded against raw", panels)
    return 0


if __name__ == "__main__":
    sys.exit(main())
