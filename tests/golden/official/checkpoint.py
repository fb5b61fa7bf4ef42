"""The fixtures' weights in the form of an official checkpoint; nothing is learned in them."""

from pathlib import Path

import torch

from .networks import deterministic_state


def write_checkpoint(model: str, path: Path) -> None:
    """Write a model of manifests/, such as `depthsplat_small_re10k`, as a training run would."""
    torch.save({"state_dict": {f"encoder.{name}": tensor for name, tensor in deterministic_state(model).items()}}, path)
