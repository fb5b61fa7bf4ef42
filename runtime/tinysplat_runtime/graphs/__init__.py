"""ONNX artifacts: found, verified, opened, run."""
