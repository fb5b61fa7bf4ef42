"""Decoding: files of every profile, on one thread and on all, each against libavcodec alone; and the peak memory.

    python benchmarks/decode.py [--quick] [--threads N] [INPUT …]

One JSON line per case. INPUT are scene folders with `eval_index.json` or Gaussian files; without any, made-up ones.
"""

from __future__ import annotations

from dataclasses import replace

from tinysplat.bench import codec
from tinysplat.bench.lines import make_bench, parse_options, print_rows
from tinysplat.bench.memory import peak_of_file
from tinysplat.bench.timing import measure


def main() -> None:
    """Measure and print."""
    bench = make_bench(parse_options(__doc__ or ""))
    for case in bench.cases:
        files = {
            profile: bench.runtime.compress(case.gaussians, profile, drop_invalid=True)
            for profile in codec.all_profiles()
        }
        rows = measure(codec.decode_stage(case, files, bench.thread_counts), bench.plan.effort)
        print_rows(
            replace(row, peak_bytes=peak_of_file(files[str(row.settings["file"])], row.threads).total) for row in rows
        )


if __name__ == "__main__":
    main()
