"""Write the fixtures' weights in the form of an official checkpoint, for trying the chain without the authors' files.

    PYTHONPATH=.:runtime:tests python -m golden.official.checkpoint mvsplat_re10k mvsplat.ckpt

Names are those of manifests/. Nothing is learned in these weights, so the pictures are noise.
"""

from __future__ import annotations

import sys
from pathlib import Path

import torch

from .networks import FOLDER, deterministic_state


def write_checkpoint(model: str, path: Path) -> None:
    """Write a model of manifests/, such as `depthsplat_small_re10k`, as a training run would."""
    torch.save({"state_dict": {f"encoder.{name}": tensor for name, tensor in deterministic_state(model).items()}}, path)


def main(arguments: list[str]) -> int:
    """`MODEL FILE` of the command line."""
    models = sorted(path.stem for path in (FOLDER / "manifests").glob("*.json"))
    if len(arguments) != 2 or arguments[0] not in models:
        print(f"usage: python -m golden.official.checkpoint MODEL FILE; MODEL is one of {', '.join(models)}")
        return 2
    write_checkpoint(arguments[0], Path(arguments[1]))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
