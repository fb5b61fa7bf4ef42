"""The ONNX artifacts and `manifest.json`, installed as package data under the name `tinysplat_models`."""
