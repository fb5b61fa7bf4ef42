"""An official network in torch and in its ONNX artifacts: error against run time and memory.

    python benchmarks/official.py CHECKPOINT [MODEL.onnx …] [--views 2] [--size 256x256] [--threads N] [--rounds 3]

One JSON line per variant, on the ray-traced room; nothing of it depends on what the weights have learned. Artifacts
come from `export/network.py`, with and without `--half-weights`. docs/MODELS.md, "Time and memory".
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tinysplat.bench.lines import print_rows
from tinysplat.bench.official import measure_official
from tinysplat.bench.timing import Effort
from tinysplat_runtime.cli.arguments import size
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.system.threads import available_cores


def parse_options() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("models", nargs="*", type=Path, metavar="MODEL.onnx")
    parser.add_argument("--views", type=int, default=2, metavar="N")
    parser.add_argument("--size", type=size, default=(256, 256), metavar="HxW")
    parser.add_argument("--threads", type=int, default=available_cores(), metavar="N", help="default: all cores")
    parser.add_argument("--rounds", type=int, default=3, metavar="N")
    return parser.parse_args()


def main() -> int:
    """Measure and print; the exit status is the command line's."""
    options = parse_options()
    effort = Effort(options.rounds, budget_s=float("inf"))
    try:
        print_rows(measure_official(options.checkpoint, options.models, options.views, options.size,
                                    options.threads, effort))  # fmt: skip
    except TinySplatError as error:
        print(f"official: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
