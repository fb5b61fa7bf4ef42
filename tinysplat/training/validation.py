"""PSNR of a network in torch on the windows of evaluation scenes: what the log of training says."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import nn

from tinysplat.measure.subjects.sources import EVAL_INDEX, FolderSource
from tinysplat_runtime.errors import InputError

from .photos import scene_folders
from .samples import Sample, psnr, render_outputs


def validation_samples(folder: Path, kinds: Sequence[str], size: tuple[int, int]) -> Iterable[Sample]:
    """The first window of each kind of scene folders with `eval_index.json`, photos scaled to cover `size` and cropped.

    Args:
        folder: holds scene folders, or is one.
        kinds: kinds of window wanted.
        size: (height, width).

    Raises:
        InputError: no scene with an index.
    """
    folders = scene_folders(folder, EVAL_INDEX)
    if not folders:
        raise InputError(f"no scene folder with {EVAL_INDEX} to validate on", where=str(folder))
    for source in map(FolderSource, folders):
        windows, _ = source.windows()
        for kind in kinds:
            for window in [window for window in windows if window.kind == kind][:1]:
                shots = source.shots(window, size)
                context, targets = (
                    [(image, camera.K, camera.c2w) for image, camera in zip(views.images, views.cameras, strict=True)]
                    for views in (shots.context, shots.targets)
                )
                yield Sample.of(f"{source.name} {kind}", context, targets, (shots.near, shots.far))


def validate(network: nn.Module, samples: Iterable[Sample]) -> dict[str, float]:
    """Mean PSNR in dB by name of the samples, drawn by the differentiable rasteriser."""
    decibels = defaultdict(list)
    with torch.no_grad():
        for sample in samples:
            outputs = network(*sample.inputs())
            for target in sample.targets:
                decibels[sample.name].append(psnr(render_outputs(outputs, target.camera()), target.image))
    return {name: float(np.mean(values)) for name, values in decibels.items()}
