"""Pictures of Gaussians, rendered once, and whatever else is held against them and against photos."""

import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from numpy.typing import NDArray

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.scenes import Scene

from .metrics import judged, psnr

PictureMetric = Callable[[NDArray, NDArray], float]


class PictureJudge:
    """The judge of everything that stores, changes or approximates Gaussians.

    Attributes:
        gaussians: as they are.
        cameras: where pictures are taken.
        raw: (H, W, 3) float32 per camera, pictures of them.
    """

    def __init__(self, gaussians: Gaussians, cameras: Sequence[Camera], threads: int, **prepare: Any) -> None:
        """Render them as they are.

        `prepare` is what `Renderer` is told: `render.DEFINITION` for comparing ways to store the same Gaussians.
        """
        self.gaussians, self.cameras = gaussians, cameras
        self._renderer: Callable[[Gaussians], Renderer] = partial(Renderer, threads=threads, **prepare)
        self.raw = self.render(gaussians)[0]

    def render(self, gaussians: Gaussians) -> tuple[list[NDArray], float]:
        """Pictures (H, W, 3) float32 at the cameras, and the median of their seconds."""
        draw = self._renderer(gaussians).render
        images, seconds = [], []
        for camera in self.cameras:
            start = time.perf_counter()
            images.append(draw(camera))
            seconds.append(time.perf_counter() - start)
        return images, statistics.median(seconds)


def mean_psnr(images: Iterable[NDArray], references: Iterable[NDArray]) -> float:
    """Mean PSNR over pairs of pictures (H, W, 3) float, dB."""
    return statistics.fmean(psnr(a, b) for a, b in zip(images, references, strict=True))


def as_photos(gaussians: Gaussians, cameras: Sequence[Camera], threads: int | None = None) -> list[NDArray]:
    """(H, W, 3) float32 each, of Gaussians at photos' cameras, exposed as the nearest photos that they know."""
    draw = partial(Renderer(gaussians, threads).render, exposed=True)
    return [draw(camera) for camera in cameras]


def to_photos(pictures: Iterable[NDArray], targets: Scene) -> dict[str, float]:
    """Means of what pictures are judged by against photos left out (`metrics.judged`), and their worst dB."""
    scores = [judged(picture, frame.judged()) for picture, frame in zip(pictures, targets.frames, strict=True)]
    means = {name: statistics.fmean(score[name] for score in scores) for name in scores[0]}
    worst = {"worst": "psnr", "fitted_worst": "fitted"}
    return means | {name: min(score[of] for score in scores) for name, of in worst.items()}
