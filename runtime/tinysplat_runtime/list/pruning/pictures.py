"""Gaussians drawn from many views, with what each of them does to the pictures (`kernels`)."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...gaussian.gaussians import Gaussians
from ...render.compiled import pack
from ...render.kernels_blend import Extent, Picture, Scratch, composite_tile
from ...render.kernels_list import Listed, Visible
from ...render.kernels_project import CHUNK
from ...render.lists import Chunks, SplatBuffers, TileLists
from ...render.prepare import parts
from ...render.project import View
from ...render.renderer import NEAR_PLANE
from ...scene.cameras import Camera
from ...system import disk
from ...system.decibels import decibels
from . import kernels


class _Drawn(NamedTuple):
    """A view, and what of all Gaussians it shows."""

    buffers: SplatBuffers
    view: View
    visible: list[Visible]


class Pictures:
    """Views of Gaussians, as 3DGS defines their drawing, before black.

    Attributes:
        cameras: of the views.
        wanted: (H, W, 3) float32 by view, filled when it is first measured: what later pictures are held against.
    """

    def __init__(self, cameras: Sequence[Camera], run_jobs: Callable) -> None:
        """`run_jobs` maps a function over a list, on any number of threads."""
        self.cameras = tuple(cameras)
        self.wanted: dict[int, NDArray] = {}
        self._run, self._store = run_jobs, disk.zeros((self.values,))

    @property
    def values(self) -> int:
        """Numbers that errors are summed over: three a pixel."""
        return sum(3 * camera.width * camera.height for camera in self.cameras)

    def measure(self, gaussians: Gaussians, views: Sequence[int]) -> Iterator[NDArray]:
        """By view: (N, 5) float32 sums of `kernels`.

        Args:
            gaussians: (N,), each of opacity 1/255 or more. The first ones that a view shows are what is wanted of it.
            views: numbers of cameras.
        """
        for number, drawn in self._drawn(gaussians, views):
            yield self._sums(drawn, number)[: gaussians.opacities.size]

    def keep(self, gaussians: Gaussians) -> None:
        """Take the pictures of (N,) Gaussians as those that are wanted."""
        for number, drawn in self._drawn(gaussians, range(len(self.cameras))):
            self._place(number)[:] = self._shown(drawn, number)

    def errors(self, gaussians: Gaussians) -> Iterator[float]:
        """By view: Σ of squared errors of red, green and blue of at most 1."""
        for number, drawn in self._drawn(gaussians, range(len(self.cameras))):
            apart = np.minimum(self._shown(drawn, number), 1) - np.minimum(self.wanted[number], 1)
            yield float(np.square(apart, dtype=np.float64).sum())

    def psnr(self, gaussians: Gaussians) -> float:
        """dB over all views; 150 where none differs."""
        return decibels(sum(self.errors(gaussians)) / self.values)

    def _drawn(self, gaussians: Gaussians, views: Sequence[int]) -> Iterator[tuple[int, _Drawn]]:
        """What views show, one after the other; each takes the place of the one before."""
        packed: list[Chunks] = []
        for part in parts(gaussians):
            first = packed[-1].first + CHUNK * len(packed[-1].sh) if packed else 0
            packed.append(pack(part, first))
        buffers = SplatBuffers(packed[-1].first + CHUNK * len(packed[-1].sh), self._run)
        for number in views:
            view = View.of(self.cameras[number], gaussians.origin, NEAR_PLANE)

            def project(chunks: Chunks, view: View = view) -> Visible:
                return buffers.project(chunks, view)

            yield number, _Drawn(buffers, view, self._run(project, packed))

    def _place(self, number: int) -> NDArray:
        """Where a view's picture is kept."""
        sizes = [3 * camera.width * camera.height for camera in self.cameras[: number + 1]]
        shape = self.cameras[number].height, self.cameras[number].width, 3
        self.wanted[number] = self._store[sum(sizes[:-1]) : sum(sizes)].reshape(shape)
        return self.wanted[number]

    def _sums(self, drawn: _Drawn, number: int) -> NDArray:
        """The first pictures are what is wanted."""
        buffers = drawn.buffers
        is_first = number not in self.wanted
        if is_first:
            self._place(number)
        wanted, sums = self.wanted[number], np.zeros((len(buffers.records), kernels.SUMS), np.float32)
        for lists in buffers.lists(drawn.visible, drawn.view):
            pairs = np.empty((lists.rows.size, kernels.SUMS), np.float32)

            def score(tile: int, listed: Listed, extent: Extent, scratch: Scratch, pairs: NDArray = pairs) -> None:
                kernels.score_tile(listed, extent, scratch, wanted, is_first, pairs)

            def add_up(block: tuple[Visible, NDArray], lists: TileLists = lists, pairs: NDArray = pairs) -> None:
                kernels.add_up(block[0], lists.tiles, block[1], pairs, sums)

            buffers.work_on(lists, drawn.view, score)
            self._run(add_up, list(zip(drawn.visible, lists.starts, strict=True)))
        return sums

    def _shown(self, drawn: _Drawn, number: int) -> NDArray:
        buffers, camera = drawn.buffers, self.cameras[number]
        shape = camera.height, camera.width
        picture = Picture(np.empty((*shape, 3), np.float32), np.empty(shape, np.float32), np.empty((0, 0), np.float32))

        def show(_: int, listed: Listed, extent: Extent, scratch: Scratch) -> None:
            composite_tile(listed, extent, scratch, picture, False)

        for lists in buffers.lists(drawn.visible, drawn.view):
            buffers.work_on(lists, drawn.view, show)
        return picture.colour
