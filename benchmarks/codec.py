"""Encoding: profiles by Q_g and presets of libx265, in seconds, bytes and dB, each against libx265 alone.

    python benchmarks/codec.py [--quick] [--threads N] [INPUT …]

One JSON line per case. INPUT are scene folders with `eval_index.json` or Gaussian files; without any, made-up ones.
"""

from __future__ import annotations

from tinysplat.bench import codec
from tinysplat.bench.lines import make_bench, parse_options, print_rows
from tinysplat.bench.timing import measure


def main() -> None:
    """Measure and print."""
    bench = make_bench(parse_options(__doc__ or ""))
    for case in bench.cases:
        judge = bench.judge(case)
        stage, _ = codec.encode_stage(case, judge, bench.runtime, codec.all_profiles(), bench.plan.qps)
        print_rows(measure(stage, bench.plan.effort))
        presets = codec.preset_stage(case, judge, bench.runtime, bench.plan.presets, bench.plan.preset_qps)
        print_rows(measure(presets, bench.plan.effort))


if __name__ == "__main__":
    main()
