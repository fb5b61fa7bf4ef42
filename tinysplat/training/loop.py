"""The training loop: deterministic in its step, stoppable at any time, resumable exactly."""

import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from tinysplat.measure.subjects.sources import EVAL_INDEX, FolderSource
from tinysplat.networks.edge import Edge
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.progress import working

from .config import Config, OptimiserSettings
from .data import SampleStream
from .losses import losses
from .photos import scene_folders
from .samples import Sample, psnr, render_outputs
from .state import TrainingState

CHECKPOINT = "edge.pt"
"""Of a run, in its folder."""

VALIDATION_KINDS = ("near", "wide")
VALIDATION_SIZE = (256, 256)
VALIDATION_STEPS = 500

SAVE_SECONDS = 240.0
"""Between checkpoints."""

CLIP = 1.0
"""Bound on the gradient's norm."""

Say = Callable[[str], None]


def use_bfloat16(network: Edge, device: torch.device) -> None:
    """Let the costly learned layers compute in bfloat16; geometry, and whatever reads their results, stays float32."""

    def narrowed(forward: Callable[..., Any]) -> Callable[..., Any]:
        def run(*maps: Tensor) -> Any:
            with torch.autocast(device.type, torch.bfloat16):
                computed = forward(*maps)
            return tuple(part.float() for part in computed) if isinstance(computed, tuple) else computed.float()

        return run

    for module in (network.refiner, network.unet, network.upsampling, network.fine, network.head):
        module.forward = narrowed(module.forward)  # type: ignore[method-assign]


def learning_rate(step: int, settings: OptimiserSettings) -> float:
    """Rate of step number `step`, counted from 0."""
    rate = settings.rate * min(1.0, (step + 1) / settings.warmup)
    left = (settings.steps - step) / max(settings.cooldown, 1)
    return rate if left >= 1 else rate * (0.02 + 0.98 * 0.5 * (1 - math.cos(math.pi * max(left, 0.0))))


def choose_device(name: str) -> torch.device:
    """The device called cpu, cuda or auto; InputError where there is no such device here."""
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    if name not in ("cpu", "cuda") or (name == "cuda" and not torch.cuda.is_available()):
        raise InputError(f"{name!r}, expected cpu, auto, or cuda where there is one", where="run.device")
    return torch.device(name)


def train(
    config: Config,
    folder: Path,
    *,
    resume: bool = False,
    start: Path | None = None,
    minutes: float | None = None,
    steps: int | None = None,
    say: Say = print,
) -> TrainingState:
    """Train until the configured step or for some minutes, and leave a checkpoint in a folder.

    Args:
        config: what to do.
        folder: made if need be.
        resume: go on from the folder's checkpoint.
        start: begin with the averaged weights of this checkpoint instead of new ones.
        minutes: stop after so long, in good order; None for no limit.
        steps: stop after so many, as if interrupted; None for no limit.
        say: takes lines of progress.

    Returns:
        The state at the end.

    Raises:
        InputError: nothing to train on, or no fitting checkpoint to resume.
    """
    if config.run.threads:
        torch.set_num_threads(config.run.threads)
    device = choose_device(config.run.device)
    checkpoint = folder / CHECKPOINT
    if resume:
        state = TrainingState.load(checkpoint, config, device)
    elif checkpoint.exists():
        raise InputError("there is a checkpoint already, expected --resume or another folder", where=str(checkpoint))
    else:
        state = TrainingState.fresh(config, device, start)
    use_bfloat16(state.network, device)
    stream = SampleStream(config.data)
    for line in stream.photos.skipped:
        say(f"skipped: {line}")
    folder.mkdir(parents=True, exist_ok=True)
    scenes = len(stream.photos.scenes)
    said = f"{scenes} scenes, {len(stream.photos.skipped)} photos skipped" if scenes else "scenes made on the way"
    say(f"{said}, from step {state.step} on {device}")
    run = _Run(config, folder, state, device, say)
    try:
        with working("training", quiet=False, note=run.standing):
            run.until(stream.follow(state.step * config.optimiser.batch), minutes, steps)
    finally:
        run.save()
    recent = [figures["loss"] for figures in run.recent if "loss" in figures]
    say(f"step {state.step}: {checkpoint}" + (f", loss {np.mean(recent):.4g}" if recent else ""))
    return state


class _Run:
    """A run in progress: the state, and when it was last saved."""

    def __init__(self, config: Config, folder: Path, state: TrainingState, device: torch.device, say: Say) -> None:
        self.config, self.folder, self.state, self.device, self.say = config, folder, state, device, say
        self.saved = self.started = time.monotonic()
        self.recent: list[dict[str, float]] = []
        self.first_step, self.last_step, self.end = state.step, config.optimiser.steps, math.inf

    def until(self, samples: Iterator[Sample], minutes: float | None, steps: int | None) -> None:
        """Steps until the configured number, or that of this run, is done or the time is up."""
        state = self.state
        self.end = math.inf if minutes is None else self.started + 60 * minutes
        if steps is not None:
            self.last_step = min(self.last_step, state.step + steps)
        while state.step < self.last_step and time.monotonic() < self.end:
            batch = [next(samples) for _ in range(self.config.optimiser.batch)]
            self.recent += train_step(state, batch, self.config, self.device)
            if state.step % self.config.run.log_steps == 0:
                self.log()
            if state.step % VALIDATION_STEPS == 0 and self.config.data.validation:
                self.validate()
            if time.monotonic() > self.saved + SAVE_SECONDS:
                self.save()

    def log(self) -> None:
        """Means of the figures since the last time."""
        names = sorted({name for figures in self.recent for name in figures})
        means = {n: float(np.mean([figures[n] for figures in self.recent if n in figures])) for n in names}
        self.recent.clear()
        text = ", ".join(f"{name} {value:.4g}" for name, value in means.items())
        self.say(f"step {self.state.step}, {self._minutes_left():.1f} minutes left: {text}")

    def standing(self) -> str:
        """Where the run is, for whoever waits."""
        left = f", {self._minutes_left():.1f} minutes left" if self.state.step > self.first_step else ""
        return f"step {self.state.step} of {self.last_step}{left}"

    def _minutes_left(self) -> float:
        """Until the last step at the pace so far, or until the time is up."""
        now = time.monotonic()
        pace = (now - self.started) / max(self.state.step - self.first_step, 1)
        return min((self.last_step - self.state.step) * pace, self.end - now) / 60

    def validate(self) -> None:
        """PSNR of the averaged weights on the validation windows."""
        samples = validation_samples(Path(self.config.data.validation), VALIDATION_KINDS, VALIDATION_SIZE)
        with torch.device(self.device):
            by_name = validate(self.state.averaged(), (sample.to(self.device) for sample in samples))
        means = {
            f"validation {kind}": float(np.mean([v for name, v in by_name.items() if name.endswith(kind)]))
            for kind in VALIDATION_KINDS
        }
        self.say(f"step {self.state.step}: " + ", ".join(f"{k} {v:.3f} dB" for k, v in {**means, **by_name}.items()))

    def save(self) -> None:
        """Write the checkpoint."""
        self.state.save(self.folder / CHECKPOINT, self.config)
        self.saved = time.monotonic()


def train_step(
    state: TrainingState, batch: list[Sample], config: Config, device: torch.device
) -> list[dict[str, float]]:
    """One step of AdamW on a batch; the figures of its samples.

    A step whose loss or gradient is not finite is counted and left out.
    """
    settings = config.optimiser
    for group in state.optimiser.param_groups:
        group["lr"] = learning_rate(state.step, settings)
    state.optimiser.zero_grad(set_to_none=True)
    figures = []
    is_finite = True
    with torch.device(device):
        for sample in batch:
            moved = sample.to(device)
            loss, terms = losses(state.network.predict(*moved.inputs()), moved, config.loss)
            terms["loss"] = float(loss.detach())
            if not torch.isfinite(loss):  # torch's gradient of a bilinear read at NaN writes out of bounds
                is_finite = False
                break
            (loss / len(batch)).backward()
            figures.append(terms)
    norm = torch.nn.utils.clip_grad_norm_(state.network.parameters(), CLIP)
    is_finite = is_finite and bool(torch.isfinite(norm))
    state.step += 1
    if is_finite:
        state.optimiser.step()
        state.update_average(settings.average)
    else:
        state.skipped += 1
    return figures


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
