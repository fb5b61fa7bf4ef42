"""Growth: seconds and peak memory of network, encode, decode and render by views, pixels and Gaussians, and the slopes.

    python benchmarks/growth.py [--quick] [--threads N] [--tasks TASK …]      TASK: plane network encode decode render

One JSON line per point, then one per fitted line.
"""

from __future__ import annotations

from tinysplat.bench.growth import TASKS
from tinysplat.bench.lines import make_bench, parse_options, print_line, print_rows
from tinysplat.bench.report import growth_fits
from tinysplat.bench.sections import growth_section


def main() -> None:
    """Measure and print."""
    options = parse_options(__doc__ or "", TASKS)
    rows = print_rows(growth_section(make_bench(options), options.tasks))
    for fit in growth_fits(rows):
        print_line(fit)


if __name__ == "__main__":
    main()
