"""Official networks whose repeated parts are fewer, and their artifacts: every kind of part in a smaller graph.

    PYTHONPATH=.:runtime:tests python -m networks.shallow mvsplat_re10k FILE.onnx

A process of its own, because pytest's log capture makes torch write out everything that it traces.
"""

import sys
from dataclasses import replace
from pathlib import Path

from golden.official.networks import deterministic_network

from tinysplat.networks import DepthSplat, MVSplat


def shallow_network(model: str) -> MVSplat | DepthSplat:
    """One plain and one shifted transformer layer; four ViT blocks, each handing out its tokens."""
    network = deterministic_network(model)
    features = network.backbone if isinstance(network, MVSplat) else network.depth_predictor
    features.transformer.layers = features.transformer.layers[:2]
    if isinstance(network, DepthSplat):
        vit = network.depth_predictor.pretrained
        vit.blocks, vit.size = vit.blocks[:4], replace(vit.size, taken=(0, 1, 2, 3))
    return network


def main(model: str, path: str) -> None:
    """Write a model's artifact as `export/network.py` would."""
    from export.network import official_network, write_graph

    papers = {"licence": "none", "provenance": "deterministic weights"}
    write_graph(official_network(shallow_network(model), papers), Path(path))


if __name__ == "__main__":
    main(*sys.argv[1:])
