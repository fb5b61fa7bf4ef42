"""ONNX artifacts: found, verified, opened, run."""

DEFAULT_MODEL = "edge"
"""The network where none is named."""
