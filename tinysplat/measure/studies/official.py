"""Is an official network the same as an artifact, and what does it cost? A checkpoint in torch and its ONNX artifacts
on the room: error against run time and memory.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.graphs.artifacts import Artifact
from tinysplat_runtime.graphs.inference import open_graph
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.system.threads import available_cores

from ..clock import Baseline, Effort, Figures, Variant, measure, measure_peak
from ..rows import Row
from ..show.tables import Column, View, small
from ..study import Run, Study
from ..subjects.cases import Photos, Shots, contract_inputs
from ..subjects.room import Room

Tensors = dict[str, NDArray]


def official_rows(run: Run) -> Iterator[Row]:
    """A checkpoint in torch and its ONNX artifacts, on the room: torch follows every artifact in every round.

    Errors are against the same network in float64, in units of each output's largest magnitude; peaks are those of a
    fresh process that loads it and predicts once. Nothing depends on what the weights have learned.

    Raises:
        InputError, ModelError: the checkpoint or an artifact is not what it should be.
    """
    import torch

    from tinysplat.checkpoints import load_network
    from tinysplat.networks.export_support import SceneNetwork

    options = run.options
    if options.checkpoint is None:
        raise InputError("needs --checkpoint FILE; its artifacts are named by --model", where="official")
    loaded = load_network(options.checkpoint)
    room, size = Room(next(iter(options.views), 2)), run.size
    torch.set_num_threads(run.threads)
    inputs = contract_inputs(room.shots(room.windows()[0][0], size))
    module = SceneNetwork(loaded.module)
    truth = run_torch(module.double(), inputs, torch.float64)
    torch_run = partial(run_torch, module.float(), inputs, torch.float32)
    errors = partial(_output_errors, truth)
    variants = [Variant("torch", torch_run, errors, threads=run.threads)]
    for path in map(Path, options.models):
        graph = open_graph(Artifact(path.stem, path), "network", threads=run.threads)
        setting = {"model": str(path), "file_bytes": path.stat().st_size}
        variants.append(
            Variant(path.stem, partial(graph.run, inputs), errors, setting, run.threads, Baseline("torch", torch_run))
        )
    subject = f"{loaded.name} ({loaded.variant}), room, {room.views} views of {size[0]}×{size[1]}"
    rows = measure("official", subject, variants, Effort(options.rounds or 3))
    with tempfile.TemporaryDirectory() as folder:
        room.write(Path(folder), size)
        for row in rows:
            if row.way == "torch":
                peak = measure_peak(f"{__name__}.checkpoint_task", options.checkpoint, run.threads, folder)
            else:
                peak = measure_peak("tinysplat.measure.tasks.predict", folder, row.setting["model"], run.threads)
            yield replace(row, costs={**row.costs, "peak_bytes": peak.total})


def run_torch(module: Any, inputs: Tensors, dtype: Any) -> Tensors:
    """Outputs of a `SceneNetwork` by name, computed in `dtype`, which the module must have."""
    import torch

    from tinysplat.networks.export_support import OUTPUT_NAMES

    with torch.inference_mode():
        outputs = module(*(torch.from_numpy(array).to(dtype) for array in inputs.values()))
    return {name: output.numpy() for name, output in zip(OUTPUT_NAMES, outputs, strict=True)}


def checkpoint_task(checkpoint: str, threads: str, folder: str) -> Callable[[], Any]:
    """Load a checkpoint and predict a scene in torch: a task of `measure_peak`."""
    import torch

    from tinysplat.checkpoints import load_network
    from tinysplat.networks.export_support import SceneNetwork

    scene = load_scene(folder)
    photos = Photos(scene.images(), tuple(scene.cameras))
    inputs = contract_inputs(Shots(photos, photos, *scene.depth_range()))

    def work() -> Tensors:
        torch.set_num_threads(int(threads) or available_cores())
        return run_torch(SceneNetwork(load_network(Path(checkpoint)).module), inputs, torch.float32)

    return work


def _output_errors(truth: Tensors, found: Tensors) -> Figures:
    """`max_means`, `mean_means` and so on: |found − truth| over the largest |truth| of the output."""
    out: Figures = {}
    for name, want in truth.items():
        error = np.abs(found[name] - want) / np.abs(want).max()
        out |= {f"max_{name}": float(error.max()), f"mean_{name}": float(error.mean())}
    return out


OFFICIAL = Study.of(
    "Official networks",
    official_rows,
    View(
        "official",
        "Official networks",
        "A checkpoint in torch and its ONNX artifacts. Errors against float64, relative to an output's largest value.",
        tuple(
            Column(f"max_{name}", f"largest, {name}", small) for name in ("means", "quats", "scales", "opacities", "sh")
        ),
        costs=("max_means",),
    ),
)
