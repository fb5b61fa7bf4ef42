"""An official network in torch and as ONNX artifacts: error against run time and memory, on the room.

Torch is the baseline that follows every artifact in every round, so that a ratio compares neighbours in time. Errors
are against the same network in float64, in units of each output's largest magnitude.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from tinysplat_runtime.graphs.artifacts import Artifact
from tinysplat_runtime.graphs.inference import open_graph
from tinysplat_runtime.scene.scenes import Scene

from ..checkpoints import LoadedNetwork, load_network
from ..networks.export_support import OUTPUT_NAMES, SceneNetwork
from .growth import write_room
from .inputs import Photos, Room
from .memory import Peak, measure_peak
from .network import contract_inputs
from .timing import Baseline, Effort, Figures, Row, Setting, Stage, Variant, measure

Arrays = dict[str, NDArray]

TORCH = "torch"
"""Name of the variant that needs no artifact."""


def run_torch(module: SceneNetwork, inputs: Arrays, dtype: torch.dtype = torch.float32) -> Arrays:
    """Outputs by name, computed in `dtype`, which the module must have."""
    with torch.inference_mode():
        outputs = module(*(torch.from_numpy(array).to(dtype) for array in inputs.values()))
    return {name: output.numpy() for name, output in zip(OUTPUT_NAMES, outputs, strict=True)}


def checkpoint_task(path: Path, threads: int, scene: Scene) -> None:
    """Load a checkpoint and predict a scene in torch: what a process of its own does for its peak memory."""
    torch.set_num_threads(threads)
    module = SceneNetwork(load_network(path).module)
    run_torch(module, contract_inputs(Photos(scene.images(), tuple(scene.cameras)), scene.depth_range()))


def errors_against(truth: Arrays) -> Callable[[Arrays], Figures]:
    """`max_means`, `mean_means` and so on: |found − truth| over the largest |truth| of the output."""

    def figures(found: Arrays) -> Figures:
        out: Figures = {}
        for name, want in truth.items():
            error = np.abs(found[name] - want) / np.abs(want).max()
            out |= {f"max_{name}": float(error.max()), f"mean_{name}": float(error.mean())}
        return out

    return figures


def official_stage(loaded: LoadedNetwork, models: Sequence[Path], source: Room, size: tuple[int, int],
                   threads: int) -> Stage:  # fmt: skip
    """Torch in float32, then every artifact.

    Args:
        loaded: the network, whose module ends up in float32.
        models: artifacts of `export/network.py`.
        source: the room with as many views as wanted.
        size: height and width of the photos, which the network must take as they are.
        threads: of torch and of onnxruntime.
    """
    torch.set_num_threads(threads)
    inputs = contract_inputs(source.context(*size), source.depth_range)
    module = SceneNetwork(loaded.module)
    figures = errors_against(run_torch(module.double(), inputs, torch.float64))
    run = partial(run_torch, module.float(), inputs)
    variants = [Variant(TORCH, run, figures, threads=threads)]
    for path in models:
        graph = open_graph(Artifact(path.stem, path), "network", threads=threads)
        settings: dict[str, Setting] = {"model": str(path), "file_bytes": path.stat().st_size}
        variants.append(
            Variant(path.stem, partial(graph.run, inputs), figures, settings, threads, Baseline(TORCH, run))
        )
    case = f"{source.name}, {source.views} views of {size[0]}×{size[1]}"
    return Stage(f"{loaded.name} ({loaded.variant})", case, variants)


def measure_official(checkpoint: Path, models: Sequence[Path], views: int, size: tuple[int, int], threads: int,
                     effort: Effort) -> Iterator[Row]:  # fmt: skip
    """Rows of torch and every artifact, with the peak memory of a fresh process that loads it and predicts once.

    Raises:
        InputError, ModelError: the checkpoint or an artifact is not what it should be.
    """
    source = Room(views)
    rows = measure(official_stage(load_network(checkpoint), models, source, size, threads), effort)
    with tempfile.TemporaryDirectory() as folder:
        write_room(Path(folder), source.context(*size))
        for row in rows:
            yield replace(row, peak_bytes=_peak(row, folder, checkpoint).total)


def _peak(row: Row, folder: str, checkpoint: Path) -> Peak:
    if row.variant == TORCH:
        return measure_peak("checkpoint", folder, str(checkpoint), row.threads)
    return measure_peak("network", folder, str(row.settings["model"]), row.threads)
