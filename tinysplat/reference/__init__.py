"""Definitions in float64: slow or at chosen points only, written from the formulas and not from the runtime's code."""
