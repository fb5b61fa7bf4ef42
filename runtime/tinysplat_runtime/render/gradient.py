"""Pictures held against photos, tile by tile: what they lack, and the sums that gradients by Gaussian are made of.

Needs numba (`tinysplat[fast]`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..scene.cameras import Camera
from ..system.decibels import decibels
from . import kernels_gradient
from .kernels_blend import Extent, Scratch
from .kernels_gradient import PAIR, SUMS, Sought
from .kernels_list import Listed, Visible
from .kernels_project import CHUNK
from .lists import SplatBuffers, TileLists
from .project import View

_LEAST_OPACITY, _LARGEST_OPACITY = 1e-9, 1 - 1e-6


@dataclass(frozen=True, eq=False)
class Target:
    """A photo that a picture is to be like, before a grey background.

    Attributes:
        camera: where it was taken.
        photo: (H, W, 3) float32 in [0, 1], of the camera's size; pixels whose red is NaN are left out.
        nothing: (H, W) float32 shares of pixels in which nothing is, and `photo` is black; None where all is something.
        backdrop: how bright the background is; see `before`.
    """

    camera: Camera
    photo: NDArray
    nothing: NDArray | None = None
    backdrop: float = 0.0

    def before(self, backdrop: float) -> Target:
        """The photo with another background where nothing is, and where Gaussians are seen through."""
        if self.nothing is None or not backdrop:
            return replace(self, backdrop=backdrop)
        lit = np.float32(backdrop) * self.nothing[..., None]
        return replace(self, photo=self.photo + lit, backdrop=backdrop)


@dataclass(frozen=True)
class PhotoError:
    """What a photo lacks.

    Attributes:
        squared: Σ error² of values clipped to [0, 1], over pixels and colours.
        known: how many pixels there are that the photo knows.
    """

    squared: float
    known: float

    @property
    def psnr(self) -> float:
        """In dB; NaN where no pixel is known."""
        return decibels(self.squared / (3 * self.known)) if self.known else math.nan


class Comparer:
    """What holding pictures against photos takes.

    Attributes:
        buffers: of the splats.
    """

    def __init__(self, rows: int, run_jobs: Callable) -> None:
        """For at most so many Gaussians; `run_jobs` maps a function over a list, on any number of threads."""
        self.buffers, self._pairs = SplatBuffers(rows, run_jobs), np.empty((0, PAIR), np.float32)

    def compare(
        self,
        visible: Sequence[Visible],
        view: View,
        sought: Sought,
        add_up: Callable[[TileLists, NDArray], None] | None = None,
    ) -> PhotoError:
        """Hold what `buffers` have projected against a photo; `add_up` gets sums (pairs, 9) of lists' pairs."""
        sums = np.zeros((visible[0].counts.size, SUMS))

        def measure(tile: int, listed: Listed, extent: Extent, scratch: Scratch, pairs: NDArray) -> None:
            kernels_gradient.measure_tile(listed, extent, scratch, sought, sums[tile], pairs)

        self.walk(visible, view, measure, add_up)
        return PhotoError(*sums.sum(axis=0).tolist())

    def walk(
        self,
        visible: Sequence[Visible],
        view: View,
        work: Callable[[int, Listed, Extent, Scratch, NDArray], None],
        add_up: Callable[[TileLists, NDArray], None] | None = None,
    ) -> None:
        """Work on every tile: its number, list and place, the thread's scratch, and pairs.

        Pairs are (pairs, 9) for `add_up`, which gets them behind each of a few lists; (0, 9) where nobody adds up.
        """

        def work_on(tile: int, listed: Listed, extent: Extent, scratch: Scratch) -> None:
            work(tile, listed, extent, scratch, pairs)

        for lists in self.buffers.lists(visible, view):
            if add_up and len(self._pairs) < lists.rows.size:
                self._pairs = np.empty((int(lists.rows.size * 1.1), PAIR), np.float32)
            pairs = self._pairs if add_up else self._pairs[:0]
            self.buffers.work_on(lists, view, work_on)
            if add_up:
                add_up(lists, pairs)


def logits_of(opacities: NDArray) -> NDArray:
    """float64. Opacities near 0 and 1 are moved to where a logit is finite: below 1/255 nothing is drawn, and where
    alpha is cut at 0.99 nothing changes.
    """
    inside = opacities.astype(np.float64).clip(_LEAST_OPACITY, _LARGEST_OPACITY)
    return np.log(inside / (1 - inside))


def opacities_of(logits: NDArray) -> NDArray:
    """float64."""
    return 1 / (1 + np.exp(-logits.astype(np.float64)))


def padded(rows: int) -> int:
    """Rows of whole chunks that hold so many."""
    return -(-rows // CHUNK) * CHUNK


def fill_chunks(chunks: NDArray, planes: NDArray) -> None:
    """Write planes (planes, n) into zeros (chunks, planes, 128)."""
    count = planes.shape[1]
    whole = count // CHUNK
    chunks[:whole] = planes[:, : whole * CHUNK].reshape(len(planes), whole, CHUNK).swapaxes(0, 1)
    chunks[whole:, :, : count - whole * CHUNK] = planes[:, whole * CHUNK :]
