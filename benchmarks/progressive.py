"""PSNR against bytes received: what a prefix of a file shows.

    python benchmarks/progressive.py [--profile balanced] [--points 16] -o FOLDER G.npz …

For every Gaussian file: PSNR of the prefix's render to the raw render, the mean over the input views, at the ends of
sections and at `points` sizes between. Writes FOLDER/progressive.json and FOLDER/progressive.png.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

import tinysplat_runtime as ts
from tinysplat.measure.metrics import psnr
from tinysplat_runtime.errors import FormatError


def measure(file: str, profile: str, points: int) -> dict:
    """The curve of one file: [bytes, dB] pairs, and where its sections end."""
    runtime = ts.Runtime()
    gaussians = ts.load_gaussians(file)
    data = runtime.compress(gaussians, profile)
    raw = [runtime.render(gaussians, camera) for camera in gaussians.cameras]
    prefixes = ts.inspect(data)["prefixes"]
    sizes = sorted({*(p["bytes"] for p in prefixes), *np.linspace(1, len(data), points + 1)[1:].astype(int).tolist()})
    curve = []
    for size in sizes:
        try:
            decoded = runtime.decompress(data, max_bytes=size)
        except FormatError:
            continue  # nothing to show yet
        images = [runtime.render(decoded, camera) for camera in gaussians.cameras]
        curve.append([size, round(float(np.mean([psnr(a, b) for a, b in zip(images, raw, strict=True)])), 2)])
    return {"file": Path(file).stem, "profile": profile, "bytes": len(data), "curve": curve, "prefixes": prefixes}


def plot(rows: list[dict], path: Path) -> None:
    """Curves of all files, with a mark at the end of every section."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7, 4.2))
    for row in rows:
        curve = np.array(row["curve"])
        (line,) = axes.plot(curve[:, 0] / 1000, curve[:, 1], label=f"{row['file']}, {row['bytes'] / 1000:.0f} KB")
        ends = {prefix["bytes"] for prefix in row["prefixes"]}
        marks = np.array([point for point in row["curve"] if point[0] in ends])
        axes.plot(marks[:, 0] / 1000, marks[:, 1], "o", color=line.get_color(), markersize=4)
    axes.set_xlabel("bytes received (KB)")
    axes.set_ylabel("PSNR to the raw render (dB)")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.tight_layout()
    figure.savefig(path, dpi=120)


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("files", nargs="+")
    parser.add_argument("--profile", default="balanced")
    parser.add_argument("--points", type=int, default=16)
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    rows = []
    for file in args.files:
        rows.append(measure(file, args.profile, args.points))
        print(json.dumps({key: rows[-1][key] for key in ("file", "bytes", "curve")}), flush=True)
    args.output.mkdir(parents=True, exist_ok=True)
    (args.output / "progressive.json").write_text(json.dumps(rows, indent=1) + "\n")
    plot(rows, args.output / "progressive.png")


if __name__ == "__main__":
    main()
