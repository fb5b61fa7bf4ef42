"""Pictures of a case's raw Gaussians, rendered once, and whatever else is held against them and against photos."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.scene.cameras import Camera

from .metrics import psnr
from .subjects.cases import Case

PictureMetric = Callable[[NDArray, NDArray], float]


@dataclass(frozen=True, eq=False)
class Rendered:
    """A case's pictures of one set of Gaussians.

    Attributes:
        images: (H, W, 3) float32 per camera.
        seconds: median of one picture.
    """

    images: Sequence[NDArray]
    seconds: float


class PictureJudge:
    """The judge of everything that stores, changes or approximates a case's Gaussians.

    Attributes:
        raw: pictures of the Gaussians as they are.
    """

    def __init__(self, case: Case, threads: int, **prepare: Any) -> None:
        """Render the raw Gaussians at the case's cameras.

        `prepare` is what `Renderer` is told: `render.DEFINITION` for comparing ways to store the same Gaussians.
        """
        self.case = case
        self.renderer: Callable[[Gaussians], Renderer] = partial(Renderer, threads=threads, **prepare)
        self.raw = self.render(case.gaussians)

    def render(self, gaussians: Gaussians) -> Rendered:
        """Pictures at the case's cameras."""
        draw = self.renderer(gaussians).render
        images, seconds = [], []
        for camera in self.case.cameras:
            start = time.perf_counter()
            images.append(draw(camera))
            seconds.append(time.perf_counter() - start)
        return Rendered(images, statistics.median(seconds))

    def figures(self, decoded: Gaussians) -> dict[str, float]:
        """dB means over the case's cameras.

        Returns:
            `psnr_decoded_raw` against the raw Gaussians' pictures; where there are photos, `psnr` against them.
        """
        images = self.render(decoded).images
        decibels = {"psnr_decoded_raw": mean_psnr(images, self.raw.images)}
        pairs = [(a, b) for a, b in zip(images, self.case.photos, strict=True) if b is not None]
        return decibels | ({"psnr": mean_psnr(*zip(*pairs, strict=True))} if pairs else {})


def photo_psnr(gaussians: Gaussians, cameras: Sequence[Camera], photos: Iterable[NDArray], threads: int = 1) -> float:
    """Mean PSNR of Gaussians' pictures to photos (H, W, 3) float, dB."""
    return mean_psnr(map(Renderer(gaussians, threads).render, cameras), photos)


def mean_psnr(images: Iterable[NDArray], references: Iterable[NDArray]) -> float:
    """Mean PSNR over pairs of pictures (H, W, 3) float, dB."""
    return statistics.fmean(psnr(a, b) for a, b in zip(images, references, strict=True))


def rescaled(image: NDArray, height: int, width: int) -> NDArray:
    """A picture (H, W, 3) in [0, 1] at another size, float32 by Pillow's bicubic filter (a = −1/2), which is widened
    where the picture shrinks; edges to edges.
    """
    from PIL import Image

    channels = [Image.fromarray(np.ascontiguousarray(image[..., c], np.float32)) for c in range(3)]
    return np.stack([np.asarray(c.resize((width, height), Image.Resampling.BICUBIC)) for c in channels], axis=-1)
