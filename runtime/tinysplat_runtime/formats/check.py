"""What a written Gaussian file lost: read again, and held against the Gaussians it was made of."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..gaussian.gaussians import Gaussians
from ..render import DEFINITION, Renderer
from ..render.paths import orbit, outside
from ..scene.cameras import Camera
from ..system.decibels import CEILING, mean_decibels
from ..system.evenly import evenly
from ..system.files import StrPath
from .table import load_gaussians

MAX_VIEWS = 6
"""Pictures compared at most; of scenes with more views, evenly chosen ones."""


@dataclass(frozen=True)
class Loss:
    """A file beside what it was made of.

    Attributes:
        bytes: of the file.
        psnr: dB of its pictures against the original's, the mean over the views; CEILING where all are equal.
        views: pictures that were compared.
    """

    bytes: int
    psnr: float
    views: int

    def __str__(self) -> str:
        beside = "equal to its source" if self.psnr == CEILING else f"{self.psnr:.2f} dB beside its source"
        return f"{self.bytes / 1e3:.1f} KB, {beside}, mean of {self.views} views"


def file_loss(path: StrPath, gaussians: Gaussians) -> Loss:
    """Read a Gaussian file again and compare its pictures with the original's.

    Args:
        path: a file made of `gaussians`.
        gaussians: the original; seen from its own views or its photos' places, or from around it where it has none.

    Raises:
        InputError: the file cannot be read.
    """
    views = _views(gaussians)
    # As defined: most formats keep no cameras, and what is drawn with their help would count as lost.
    ours, theirs = (
        Renderer(drawn.changed(viewpoints=()), None, compiled=False, **DEFINITION)
        for drawn in (gaussians, load_gaussians(path))
    )
    psnr = mean_decibels(map(theirs.render, views), map(ours.render, views))
    beside = Path(path).parent.glob("*.webp") if Path(path).suffix == ".json" else ()  # of a SOG folder
    return Loss(sum(part.stat().st_size for part in (Path(path), *beside)), psnr, len(views))


def _views(gaussians: Gaussians) -> Sequence[Camera]:
    seen_from = gaussians.cameras or gaussians.viewpoints
    if not seen_from:
        camera = outside(gaussians)
        means = gaussians.flat().means.astype(np.float64) + gaussians.origin
        depth = float(np.median((means - camera.centre) @ camera.c2w[:3, 2]))
        return orbit([camera], 4, depth)
    return [seen_from[v] for v in evenly(len(seen_from), MAX_VIEWS)]
