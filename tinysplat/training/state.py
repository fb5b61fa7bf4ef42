"""A training run between two steps: weights, their average, optimiser and step; saved and restored."""

from __future__ import annotations

import io
import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from tinysplat.networks.edge import Edge
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.files import write_atomically

from .config import Config

ARCHITECTURE = "tinysplat edge 3"
"""Changes with every change of the network that old weights do not fit."""


@dataclass
class TrainingState:
    """A run between two steps.

    Attributes:
        network: with the weights that are trained.
        average: exponential moving average of the weights, by name: what is validated and exported.
        optimiser: AdamW with its moments.
        step: steps done.
        skipped: steps left out because their gradient was not finite.
    """

    network: Edge
    average: dict[str, Tensor]
    optimiser: torch.optim.AdamW
    step: int = 0
    skipped: int = 0

    @classmethod
    def fresh(cls, config: Config, device: torch.device, start: Path | None = None) -> TrainingState:
        """Initial weights from the seed, or the averaged ones of the checkpoint of another run.

        Raises:
            InputError: as `read_checkpoint`.
        """
        torch.manual_seed(config.data.seed)
        network = (Edge() if start is None else shipped_network(start)[0].train()).to(device)
        if config.optimiser.heads_alone:
            network.requires_grad_(False)
            for head in (network.fine, network.head, network.coarse):
                head.requires_grad_(True)
        trained = [parameter for parameter in network.parameters() if parameter.requires_grad]
        adamw = torch.optim.AdamW(trained, lr=config.optimiser.rate, weight_decay=1e-4, betas=(0.9, 0.98))
        return cls(network, {name: weights.clone() for name, weights in network.state_dict().items()}, adamw)

    def averaged(self) -> Edge:
        """The network with the averaged weights, for evaluation."""
        network = Edge().to(next(self.network.parameters()).device)
        network.load_state_dict(self.average)
        return network.eval()

    def update_average(self, decay: float) -> None:
        """Take the present weights into the average; early steps count more, so that it forgets the initial weights."""
        decay = min(decay, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            for name, value in self.network.state_dict().items():
                self.average[name].lerp_(value, 1 - decay)

    def save(self, path: Path, config: Config) -> None:
        """Write the run, atomically."""
        content = {
            "architecture": ARCHITECTURE,
            "config": config.as_dict(),
            "network": self.network.state_dict(),
            "average": self.average,
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
            "skipped": self.skipped,
        }
        buffer = io.BytesIO()
        torch.save(content, buffer)
        write_atomically(path, buffer.getvalue())

    @classmethod
    def load(cls, path: Path, config: Config, device: torch.device) -> TrainingState:
        """Continue a run.

        Raises:
            InputError: no such file, no checkpoint of this training, or of another architecture.
        """
        content = read_checkpoint(path, device)
        state = cls.fresh(config, device)
        state.network.load_state_dict(content["network"])
        state.average = content["average"]
        state.optimiser.load_state_dict(content["optimiser"])
        state.step, state.skipped = content["step"], content["skipped"]
        return state


def read_checkpoint(path: Path, device: torch.device | str = "cpu") -> dict[str, Any]:
    """What `TrainingState.save` wrote, by torch's restricted unpickler.

    Raises:
        InputError: no such file, no checkpoint of this training, or of another architecture.
    """
    if not path.is_file():
        raise InputError("no such file", where=str(path))
    try:
        content = torch.load(path, map_location=device, weights_only=True)
    except (pickle.UnpicklingError, RuntimeError, EOFError, ValueError, KeyError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"not a checkpoint of tinysplat.training ({reason[:80]})", where=str(path)) from None
    architecture = content.get("architecture") if isinstance(content, dict) else None
    if architecture != ARCHITECTURE:
        raise InputError(
            f"a checkpoint of {architecture or 'something else'}, expected {ARCHITECTURE}", where=str(path)
        )
    expected, stored = ({name: w.shape for name, w in m.items()} for m in (Edge().state_dict(), content["network"]))
    if stored != expected:  # what the analysis does may change under the same weights
        raise InputError("other sizes of the network than this version's", where=str(path))
    return content


def shipped_network(path: Path) -> tuple[Edge, int]:
    """The network of a checkpoint as it is exported, and the steps it has seen: averaged weights.

    Raises:
        InputError: as `read_checkpoint`.
    """
    content = read_checkpoint(path)
    network = Edge()
    network.load_state_dict(content["average"])
    return network.eval(), int(content["step"])
