"""Official checkpoints of MVSplat and DepthSplat: read safely, recognised by their tensors, loaded strictly.

Trust boundary: a checkpoint is a pickle. It is read by torch's restricted unpickler (`weights_only=True`); what a
training framework left beside the tensors becomes an inert stand-in, and any other global is refused by name. Which
network a file is for follows from tensor names and shapes; which scale rule, from the file's hash (docs/MODELS.md).
"""

import hashlib
import pickle
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from tinysplat_runtime.errors import InputError

from .networks import OFFICIAL, DepthSplat, MVSplat, build

PREFIX = "encoder."
"""Of the networks' tensors in the authors' files."""

BYSTANDERS = ("lightning.", "lightning_fabric.", "pytorch_lightning.", "omegaconf.", "numpy.", "pathlib.", "argparse.",
              "typing.", "src.", "torch.optim.")  # fmt: skip
"""Packages whose objects a training run leaves beside the tensors; each is replaced by a stand-in that does nothing."""

FAMILIAR = 0.5
"""Share of a network's tensors that must be there by name before a file counts as an attempt at that network."""

LISTED = 3
"""Names listed per kind of difference."""


@dataclass(frozen=True)
class Release:
    """A checkpoint that the authors published.

    Attributes:
        title: the file's name without hash and ending.
        network: (name, variant) of `networks.build`.
        scale_rule: of DepthSplat.
        near, far: depth range that it is run with, scene units.
    """

    title: str
    network: tuple[str, str]
    scale_rule: str
    near: float
    far: float


def _depthsplat_releases() -> dict[str, Release]:
    rows = [
        ("small-re10k-256x256-view2", "small", "re10k", 100.0, "cfeab6b1", "20f39ed8"),
        ("base-re10k-256x256-view2", "base", "re10k", 100.0, "ca7b6795", "fbe87117"),
        ("large-re10k-256x256-view2", "large", "re10k", 100.0, "e0f0f27a", "8ee2ec2c"),
        ("base-re10k-256x448-view2", "base", "dl3dv", 100.0, "fea94f65", "76a0605a"),
        ("base-dl3dv-256x448-randview2-6", "base", "dl3dv", 200.0, "02c7b19d", "d94d996f"),
        ("small-re10kdl3dv-448x768-randview4-10", "small", "dl3dv", 200.0, "c08188db", "1e257b90"),
        ("base-re10kdl3dv-448x768-randview2-6", "base", "dl3dv", 200.0, "f8ddd845", "f40abc4f"),
    ]
    return {
        digest: Release(f"depthsplat-gs-{title}", (f"depthsplat-{size}", variant), rule, 0.5, far)
        for title, size, variant, far, april, march in rows
        for rule, digest in (("2025-04", april), ("2025-03", march))
    }


RELEASES = _depthsplat_releases()
"""DepthSplat's published files by the first eight digits of their SHA-256, which also end their names."""


class _StandIn:
    """Takes the place of an object that nothing here needs; accepts whatever a pickle does to it."""

    def __init__(self, *args: object, **kwargs: object) -> None: ...
    def __setstate__(self, state: object) -> None: ...
    def __setitem__(self, key: object, value: object) -> None: ...
    def append(self, item: object) -> None: ...
    def extend(self, items: object) -> None: ...


@dataclass(frozen=True)
class Checkpoint:
    """The tensors of a file.

    Attributes:
        path: the file.
        state: tensors by name, without `PREFIX`.
        digest: SHA-256 of the file, hexadecimal.
    """

    path: Path
    state: Mapping[str, Tensor]
    digest: str

    @property
    def release(self) -> Release | None:
        """The published file that this is, by its hash."""
        return RELEASES.get(self.digest[:8])


@dataclass(frozen=True)
class LoadedNetwork:
    """A network with its weights.

    Attributes:
        module: in evaluation mode, without gradients.
        name, variant, scale_rule: as given to `networks.build`.
        checkpoint: where the weights came from.
    """

    module: MVSplat | DepthSplat
    name: str
    variant: str
    scale_rule: str
    checkpoint: Checkpoint


def read_checkpoint(path: Path) -> Checkpoint:
    """Read the tensors of a checkpoint without running anything it holds.

    Args:
        path: a Lightning `.ckpt`, a `.pth` state dict, or `.safetensors` with the same names.

    Raises:
        InputError: no such file, no checkpoint, a damaged download, or a global that is not allowed.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError("no such file, expected a checkpoint (.ckpt, .pth or .safetensors)", where=str(path))
    content = _read_safetensors(path) if path.suffix == ".safetensors" else _read_pickle(path)
    digest = _sha256(path)
    _check_download(path, digest)
    if isinstance(content, dict) and "state_dict" not in content and isinstance(content.get("model"), dict):
        raise InputError(
            "holds a depth predictor only ('model'), expected a checkpoint with Gaussian heads (depthsplat-gs-…)",
            where=str(path),
        )
    state = content.get("state_dict", content) if isinstance(content, dict) else content
    if not isinstance(state, Mapping) or not any(isinstance(value, Tensor) for value in state.values()):
        raise InputError("holds no tensors by name, expected a state dict", where=str(path))
    if any(str(name).startswith(PREFIX) for name in state):
        state = {name: value for name, value in state.items() if str(name).startswith(PREFIX)}
    tensors = {str(name).removeprefix(PREFIX): value for name, value in state.items() if isinstance(value, Tensor)}
    return Checkpoint(path, tensors, digest)


def load_network(
    source: Path | Checkpoint, name: str | None = None, scale_rule: str | None = None, sh_degree: int | None = None
) -> LoadedNetwork:
    """Build the network that a checkpoint is for and load it strictly.

    Args:
        source: what `read_checkpoint` takes, or gave.
        name: the network expected; None accepts any known one.
        scale_rule: of DepthSplat; None takes it from the file's hash, and "2025-04" if that is not a published one.
        sh_degree: see `networks.build`.

    Raises:
        InputError: not a checkpoint, of another or an unknown network, or with tensors missing, unexpected or of
            another shape; names them.
    """
    checkpoint = source if isinstance(source, Checkpoint) else read_checkpoint(source)
    identified, variant = identify(checkpoint, name)
    rule = scale_rule or (checkpoint.release.scale_rule if checkpoint.release else "2025-04")
    module = build(identified, variant, rule, sh_degree)
    module.load_state_dict(checkpoint.state, strict=True)
    return LoadedNetwork(module.requires_grad_(False), identified, variant, rule, checkpoint)


def identify(checkpoint: Checkpoint, name: str | None = None) -> tuple[str, str]:
    """Name and variant of the network whose tensors these are.

    Args:
        checkpoint: what was read.
        name: the network expected; None for any.

    Raises:
        InputError: no known network fits exactly; compares with the one that comes closest.
    """
    shapes = {tensor: tuple(value.shape) for tensor, value in checkpoint.state.items()}
    fits = {key: _overlap(shapes, official_shapes(*key)) for key in OFFICIAL}
    best = max(fits, key=lambda key: fits[key])
    if fits[best] < FAMILIAR:
        known = ", ".join(f"{n} ({v})" for n, v in OFFICIAL)
        raise InputError(f"not a network known here; there are {known}", where=str(checkpoint.path))
    if name is not None and best[0] != name and not _difference(shapes, official_shapes(*best)):
        raise InputError(f"holds {best[0]} ({best[1]}), expected {name}", where=str(checkpoint.path))
    if name is not None and best[0] != name:
        best = max((key for key in OFFICIAL if key[0] == name), key=lambda key: fits[key])
    difference = _difference(shapes, official_shapes(*best))
    if difference:
        raise InputError(f"does not fit {best[0]} ({best[1]}): {difference}", where=str(checkpoint.path))
    return best


@lru_cache
def official_shapes(name: str, variant: str) -> Mapping[str, tuple[int, ...]]:
    """Shapes by name of every tensor in the state dict of a network; takes no memory for weights."""
    with torch.device("meta"):
        return {tensor: tuple(value.shape) for tensor, value in build(name, variant).state_dict().items()}


def _overlap(shapes: Mapping[str, tuple[int, ...]], wanted: Mapping[str, tuple[int, ...]]) -> float:
    """Share of the names that both have among those that either has, tensors of another shape counting half."""
    common = shapes.keys() & wanted.keys()
    same = sum(shapes[tensor] == wanted[tensor] for tensor in common)
    return (len(common) + same) / 2 / len(shapes.keys() | wanted.keys())


def _difference(shapes: Mapping[str, tuple[int, ...]], wanted: Mapping[str, tuple[int, ...]]) -> str:
    """What keeps tensors from loading strictly; empty if nothing."""
    reshaped = [
        f"{tensor} is {shapes[tensor]}, expected {shape}"
        for tensor, shape in wanted.items()
        if tensor in shapes and shapes[tensor] != shape
    ]
    kinds = {
        "missing": [tensor for tensor in wanted if tensor not in shapes],
        "unexpected": [tensor for tensor in shapes if tensor not in wanted],
        "of another shape": reshaped,
    }
    return "; ".join(
        f"{len(names)} {kind}: {', '.join(names[:LISTED])}{', …' if len(names) > LISTED else ''}"
        for kind, names in kinds.items()
        if names
    )


def _read_pickle(path: Path) -> Any:
    try:
        needed = torch.serialization.get_unsafe_globals_in_checkpoint(path)
    except (RuntimeError, ValueError, OSError, EOFError, pickle.UnpicklingError):
        raise InputError("not a torch checkpoint (a zip archive of torch.save)", where=str(path)) from None
    refused = [name for name in needed if not name.startswith(BYSTANDERS)]
    if refused:
        raise InputError(
            f"wants to load {', '.join(refused[:LISTED])}, which is not allowed; expected tensors and plain values",
            where=str(path),
        )
    stand_ins: list[Any] = [(_StandIn, name) for name in needed]
    try:
        with torch.serialization.safe_globals(stand_ins):
            return torch.load(path, map_location="cpu", weights_only=True, mmap=True)
    except (RuntimeError, ValueError, OSError, EOFError, pickle.UnpicklingError) as error:
        reason = str(error).strip().split("\n")[0][:200]
        raise InputError(f"cannot be read as a checkpoint: {reason}", where=str(path)) from error


def _read_safetensors(path: Path) -> dict[str, Tensor]:
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    try:
        return load_file(path)
    except (SafetensorError, OSError) as error:
        raise InputError(f"not a safetensors file: {error}", where=str(path)) from error


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def _check_download(path: Path, digest: str) -> None:
    """A published file's name ends in the start of its hash; refuse a copy that was cut short or altered."""
    named = re.search(r"-([0-9a-f]{8})$", path.stem)
    if named and named[1] in RELEASES and not digest.startswith(named[1]):
        raise InputError(
            f"SHA-256 starts with {digest[:8]}, expected {named[1]} as in the file's name; download it again",
            where=str(path),
        )
