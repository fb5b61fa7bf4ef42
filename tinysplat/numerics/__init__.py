"""Conditioning of the transforms: errors of plain float32, of what ships, and of float64, against 50 digits of mpmath.

`benchmarks/numerics.py` writes the tables and plots of docs/NUMERICS.md from here; `tests/unit/test_numerics.py` holds
every row to its bound.
"""
