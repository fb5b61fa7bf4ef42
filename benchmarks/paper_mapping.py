"""What coding at 12 bits costs the profile `paper` against its ideal of 14 bits.

    python benchmarks/paper_mapping.py G.npz [G2.npz …]

Per class and in units of σ: the wanted quantiser step and the one reached, the rounding to 12-bit codes and to 14-bit
codes, and what HEVC loses on top. Rounding adds to HEVC's error in squares; the last column is by how much the mean
squared error grows because codes are 12 bits wide. One JSON line per class at the end.
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict

import numpy as np

from tinysplat_runtime.codec.analysis import project_layer
from tinysplat_runtime.codec.hevc import PlaneDecoder, encode_plane
from tinysplat_runtime.codec.paper import paper_colors, paper_plan
from tinysplat_runtime.codec.profiles import PAPER, find_profile
from tinysplat_runtime.codec.quantise import choose_code_map
from tinysplat_runtime.formats.table import load_gaussians
from tinysplat_runtime.graphs.inference import GraphStore


def measure(path: str, store: GraphStore, rows: dict[str, list[dict[str, float]]]) -> None:
    """Add one row per channel of a Gaussian file."""
    layer = load_gaussians(path)
    projected = project_layer(store, layer, drop_invalid=True, where=path)
    colors, reduction = paper_colors(store, layer, PAPER)
    plan = paper_plan(projected, colors, reduction, layer.degree, PAPER, 0)
    encoder = find_profile("paper").encoder
    for channel in plan.channels:
        low, high = channel.window
        if not high > low:
            continue
        values = np.clip(channel.values, low, high)
        sigma = float(channel.values.std(dtype=np.float64))
        code_map = choose_code_map(low, high, float(values.mean()), channel.step)
        codes, clipped = code_map.quantise(values)
        decoded = np.empty_like(codes)
        for view, plane in enumerate(codes):
            coded = encode_plane(plane, code_map.qp, encoder)
            PlaneDecoder(coded.parameter_sets, *plane.shape).decode_into(coded.payload, decoded[view])
        coding = float(((code_map.dequantise(decoded) - code_map.dequantise(codes)) ** 2).mean()) / sigma**2
        step_14 = channel.step / (64 * 2 ** ((PAPER.class_qp[channel.plane_class] - 4) / 6)) / sigma
        rounding_12, rounding_14 = (code_map.scale / sigma) ** 2 / 12, step_14**2 / 12
        ideal_coding = coding * (channel.step / code_map.step) ** 2
        rows[channel.plane_class.label].append(
            {
                "step_wanted": channel.step / sigma,
                "step_reached": code_map.step / sigma,
                "rounding_12": rounding_12**0.5,
                "rounding_14": rounding_14**0.5,
                "hevc": coding**0.5,
                "mse_growth": (coding + rounding_12) / (ideal_coding + rounding_14) - 1,
                "clipped": clipped,
            }
        )


def main() -> None:
    """Print the table."""
    rows: dict[str, list[dict[str, float]]] = defaultdict(list)
    store = GraphStore()
    for path in sys.argv[1:]:
        measure(path, store, rows)
    print("class     step wanted  reached  rounding 12 bit  14 bit   HEVC rmse  MSE growth   (σ)")
    for label, channels in rows.items():
        mean = {key: float(np.mean([c[key] for c in channels])) for key in channels[0]}
        print(
            f"{label:9} {mean['step_wanted']:10.4f} {mean['step_reached']:8.4f} {mean['rounding_12']:16.5f}"
            f" {mean['rounding_14']:7.5f} {mean['hevc']:11.4f} {mean['mse_growth']:11.2%}"
        )
        print(json.dumps({"case": f"paper_mapping/{label}", **{k: round(v, 6) for k, v in mean.items()}}))


if __name__ == "__main__":
    main()
