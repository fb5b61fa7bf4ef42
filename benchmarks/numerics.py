"""Conditioning of the transforms: the tables and plots of docs/NUMERICS.md, anew.

    python benchmarks/numerics.py [--write] [--rounds 7]

Prints a JSON line per row; with --write, also puts tables and plots into docs/. About half a minute on one core.
Ends with status 1 if a row does not keep its bound.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from tinysplat.bench.timing import Effort
from tinysplat.numerics import pictures, projection, reduction, report
from tinysplat.numerics.rows import NumericRow, table
from tinysplat.numerics.speed import speed_rows
from tinysplat_runtime.graphs.inference import GraphStore

DOCS = Path(__file__).resolve().parents[1] / "docs"


def numeric_rows(store: GraphStore) -> list[NumericRow]:
    """Rows of all transforms that have a bound."""
    return [
        *projection.projection_rows(store),
        *projection.inverse_rows(store),
        *projection.rotation_rows(),
        *reduction.spectrum_rows(),
        *pictures.sh_rows(),
        *pictures.splat_rows(),
    ]


def main() -> int:
    """Measure, print and, if asked, write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--write", action="store_true", help="put tables and plots into docs/")
    parser.add_argument("--rounds", type=int, default=7, help="timed rounds of each variant")
    args = parser.parse_args()
    store = GraphStore(threads=1)
    rows, floors, planes = numeric_rows(store), list(reduction.floor_rows()), list(pictures.quantiser_rows())
    timed = speed_rows(store, Effort(args.rounds, 60.0))
    for row in (*rows, *floors, *planes):
        print(json.dumps(asdict(row), ensure_ascii=False))
    for line in timed:
        print(json.dumps(line.to_json(), ensure_ascii=False))
    if args.write:
        page = DOCS / "NUMERICS.md"
        for name in dict.fromkeys(row.transform for row in rows):
            report.put_table(page, name, table([row for row in rows if row.transform == name]))
        report.put_table(page, "floor", report.floor_table(floors))
        report.put_table(page, "quantiser", report.quantiser_table(planes))
        report.put_table(page, "speed", report.speed_table(timed))
        report.plot_speed(DOCS / "numerics_speed.png", timed)
        report.plot_errors(DOCS / "numerics_errors.png", rows)
    return int(not all(row.holds for row in rows))


if __name__ == "__main__":
    sys.exit(main())
