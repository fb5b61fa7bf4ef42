"""How far every tensor of every fixture is from the authors' implementation, beside what it may be off.

    PYTHONPATH=.:runtime:tests python -m golden.official.errors [FIXTURE …]

The status is 1 if a tensor is off.
"""

from __future__ import annotations

import sys
from pathlib import Path

from .check_golden import compare, load_fixture
from .networks import run_fixture

GOLDEN = Path(__file__).parent / "golden"


def main(fixtures: list[str]) -> int:
    """Print a line per tensor and one per fixture; 1 if a tensor is off."""
    failed = 0
    for fixture in fixtures or sorted(path.stem for path in GOLDEN.glob("*.npz")):
        _, expected, meta = load_fixture(GOLDEN / f"{fixture}.npz")
        rows = compare(expected, meta, run_fixture(fixture))
        print(f"{fixture}: {len(rows)} tensors")
        for name, status, largest, mean, atol in sorted(rows, key=lambda row: row[0].startswith("out/")):
            print(f"  {status:5s} {name:34s} largest {largest:.1e}  mean {mean:.1e}  atol {atol:.1e}")
        failed += sum(row[1] != "ok" for row in rows)
    print(f"{failed} tensors off")
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
