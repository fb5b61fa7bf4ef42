"""Other ways to store the same Gaussians: bytes, seconds and dB of SPZ, SOG, compressed PLY, float16 and PLY, and ours.

    python benchmarks/peers.py [--quick] [--threads N] [INPUT …]

One JSON line per case; a tool that is not there costs its line nothing but the reason. `pip install gaussforge` brings
SPZ, `npm install -g @playcanvas/splat-transform` SOG and compressed PLY, `pip install gsplat` the other rasteriser.
"""

from __future__ import annotations

from tinysplat.bench.lines import make_bench, parse_options, print_rows
from tinysplat.bench.sections import peer_section


def main() -> None:
    """Measure and print."""
    print_rows(peer_section(make_bench(parse_options(__doc__ or ""))))


if __name__ == "__main__":
    main()
