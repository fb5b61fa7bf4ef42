"""Gaussians drawn from many views, with what each of them does to the pictures (`kernels`)."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import Gaussians
from ..render.compiled import pack
from ..render.kernels_blend import Extent, Listed, Scratch, Visible
from ..render.kernels_project import CHUNK
from ..render.lists import Chunks, SplatBuffers
from ..render.prepare import parts
from ..render.project import View
from ..render.renderer import NEAR_PLANE
from ..scene.cameras import Camera
from . import kernels


class Pictures:
    """Views of Gaussians, as 3DGS defines their drawing, before black.

    Attributes:
        cameras: of the views.
        wanted: (H, W, 4) float32 of each, filled by the first `measure`: what later pictures are held against.
    """

    def __init__(self, cameras: Sequence[Camera], run_jobs: Callable) -> None:
        """`run_jobs` maps a function over a list, on any number of threads."""
        self.cameras = tuple(cameras)
        self.wanted: list[NDArray] = []
        self._run, self._local = run_jobs, threading.local()

    @property
    def values(self) -> int:
        """Numbers that errors are summed over: three a pixel."""
        return sum(3 * camera.width * camera.height for camera in self.cameras)

    def measure(self, gaussians: Gaussians) -> Iterator[tuple[NDArray, float]]:
        """By view: (N, 6) float32 sums of `kernels`, and the squared error of the picture.

        Args:
            gaussians: (N,), each of opacity 1/255 or more. The first ones are what is wanted.
        """
        packed: list[Chunks] = []
        for part in parts(gaussians):
            first = packed[-1].first + CHUNK * len(packed[-1].sh) if packed else 0
            packed.append(pack(part, first))
        buffers = SplatBuffers(packed[-1].first + CHUNK * len(packed[-1].sh), self._run)
        is_first = not self.wanted
        for number, camera in enumerate(self.cameras):
            if is_first:
                self.wanted.append(np.empty((camera.height, camera.width, kernels.CHANNELS), np.float32))
            view = View.of(camera, gaussians.origin, NEAR_PLANE)
            sums, error = self._of_view(packed, buffers, view, self.wanted[number], is_first)
            yield sums[: gaussians.opacities.size], error

    def _of_view(
        self, packed: list[Chunks], buffers: SplatBuffers, view: View, wanted: NDArray, is_first: bool
    ) -> tuple[NDArray, float]:
        def project(chunks: Chunks) -> Visible:
            chunks.is_coloured[:] = 0
            return buffers.project(chunks, view, 0.0, 0.0)

        def score(tile: int, listed: Listed, extent: Extent, scratch: Scratch) -> None:
            errors[tile] = kernels.score_tile(
                buffers.records, lists.rows, listed, extent, scratch, self._walk(), wanted, is_first, pairs
            )

        def add_up(block: tuple[Visible, NDArray]) -> None:
            kernels.add_up(block[0], lists.tiles, block[1], pairs, sums)

        visible = self._run(project, packed)
        sums, errors = np.zeros((len(buffers.records), kernels.SUMS), np.float32), np.zeros(visible[0].counts.size)
        for lists in buffers.lists(visible, view):
            pairs = np.empty((lists.rows.size, kernels.SUMS), np.float32)
            buffers.work_on(lists, view, score)
            self._run(add_up, list(zip(visible, lists.starts, strict=True)))
        return sums, float(errors.sum())

    def _walk(self) -> NDArray:
        if not hasattr(self._local, "walk"):
            self._local.walk = np.empty(kernels.WALK_STATE, np.float32)
        walk: NDArray = self._local.walk
        return walk
