"""Bytes and fidelity of the modes: gaussians, photos, hybrid.

    python benchmarks/modes.py [--qp -4,4] [--per-scene N] [--modes photos] SCENE …

SCENE are folders with `eval_index.json`; of each, the first N windows of two photos at 256x256, network `sweep`. One
JSON line per file and one of means per mode and Q_g: bytes, PSNR of decoded to raw renders at the input views
(`raw_in`) and at held-out views (`raw_out`), of decoded renders to held-out photos (`photo`, beside `photo_raw` of the
raw Gaussians), and CPU seconds of decoding and of its network.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

import tinysplat_runtime as ts
from tinysplat.evaluation.scene_index import EVAL_INDEX, read_index
from tinysplat.metrics import psnr
from tinysplat_runtime.reports import Stopwatch

SIZE = (256, 256)


def measure(scene: ts.Scene, context: list[int], targets: list[int], modes: list[str], qps: list[float]) -> list[dict]:
    """One row per mode and Q_g of one window."""
    runtime = ts.Runtime()
    chosen, held_out = scene.views(context).resized(*SIZE), scene.views(targets).resized(*SIZE)
    raw = runtime.predict(chosen)
    photos = held_out.images()
    raw_in, raw_out = ([runtime.render(raw, camera) for camera in s.cameras] for s in (chosen, held_out))
    rows = []
    for mode in modes:
        for qp in qps:
            data = runtime.encode(chosen, qp=qp, mode=mode, gaussians=raw)
            watch, start = Stopwatch(), time.process_time()
            decoded = runtime.decompress(data, watch=watch)
            seconds = time.process_time() - start
            seen_in, seen_out = ([runtime.render(decoded, c) for c in s.cameras] for s in (chosen, held_out))
            row = {"scene": scene.name, "context": context, "mode": mode, "qp": qp, "bytes": len(data)}
            row["raw_in"] = _mean(seen_in, raw_in)
            row["raw_out"] = _mean(seen_out, raw_out)
            row["photo"], row["photo_raw"] = _mean(seen_out, photos), _mean(raw_out, photos)
            rows.append({**row, "decode_cpu_s": seconds, "network_s": watch.seconds.get("network", 0.0)})
            print(json.dumps(_rounded(rows[-1])), flush=True)
    return rows


def _mean(images: list, references: list) -> float:
    return float(np.mean([psnr(a, b) for a, b in zip(images, references, strict=True)]))


def _rounded(row: dict) -> dict:
    return {k: round(v, 3) if isinstance(v, float) else v for k, v in row.items()}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", nargs="+", type=Path)
    parser.add_argument("--qp", default="-8,0,8,16")
    parser.add_argument("--modes", default="gaussians,photos,hybrid")
    parser.add_argument("--per-scene", type=int, default=1)
    args = parser.parse_args()
    qps = [float(qp) for qp in args.qp.split(",")]
    rows: dict[tuple[str, float], list[dict]] = defaultdict(list)
    for folder in args.scenes:
        windows = [w for w in read_index(folder / EVAL_INDEX)["windows"] if len(w["context"]) == 2]
        for window in windows[: args.per_scene]:
            scene = ts.load_scene(folder)
            for row in measure(scene, window["context"], window["target"], args.modes.split(","), qps):
                rows[row["mode"], row["qp"]].append(row)
    for (mode, qp), group in rows.items():
        keys = [key for key, value in group[0].items() if isinstance(value, int | float) and key != "qp"]
        means = {key: float(np.mean([row[key] for row in group])) for key in keys}
        print(json.dumps({"case": f"modes/{mode}/{qp:g}", "windows": len(group), **_rounded(means)}))


if __name__ == "__main__":
    main()
