"""The whole way from Gaussians to a picture as compiled code, chosen where numba is installed (`tinysplat[fast]`).

The definitions are those of `project.py` and `composite.py`, the pictures the same to 1e-5, in a fraction of the time.
A frame takes two passes, both of them over pieces that threads share: blocks of Gaussians are projected and listed by
the tiles of pixels that they reach; then every tile sorts its own list by depth and blends it. No stage waits for one
thread alone, which a sort of all splats would.

Only the loops in `kernels_*.py` need numba; `Renderer` imports this module where it is.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from . import kernels_blend, kernels_list
from .composite import Canvas
from .kernels_blend import Extent, Picture, Scratch
from .kernels_list import Listed
from .kernels_project import AXES, CHUNK, GEOMETRY, MEAN, OPACITY, OWN_PIXEL
from .lists import Chunks, SplatBuffers
from .prepare import Part
from .project import View, may_show

Packed = partial[Chunks]


class Rasteriser:
    """Draws the same Gaussians again and again.

    Between frames it keeps the packed Gaussians, and buffers as large as what frames have shown.
    """

    def __init__(self, parts: Sequence[Part], keeps: bool, run_jobs: Callable) -> None:
        """Parts are packed when a frame needs them first, or, unless it `keeps` them, what shows of them for every
        frame. `run_jobs` maps over a list.
        """
        longest = CHUNK * max(-(-part.size // CHUNK) for part in parts)
        self._parts, self._run = parts, run_jobs
        self._packed = cache(lambda number: pack(parts[number], number * longest))
        self._keeps = keeps
        self._buffers = SplatBuffers(len(parts) * longest if keeps else 0, run_jobs, only_shown=True)

    def draw(self, drawn: Sequence[int], view: View, fronts: NDArray, opaque: NDArray, with_depth: bool) -> Canvas:
        """Draw a frame of some parts; `fronts` and `opaque` are those of `NearViews.shares`."""
        canvas = Canvas(view.camera.height, view.camera.width, with_depth)
        picture, has_front = Picture(canvas.colour, canvas.left, canvas.depth[0]), bool(fronts.any())
        if self._keeps:
            self._buffers.clear()
            buffers, packed = self._buffers, [partial(self._packed, number) for number in drawn]
        else:
            buffers, packed = self._shown(drawn, view)

        def project(number_and_chunks: tuple[int, Packed]) -> kernels_list.Visible:
            number, chunks = number_and_chunks
            of = self._parts[number]
            return buffers.project(chunks(), view, fronts[of.view] if of.is_surface else 0.0, opaque[of.view])

        def blend(_: int, listed: Listed, extent: Extent, scratch: Scratch) -> None:
            kernels_blend.composite_tile(listed, extent, scratch, picture, has_front)

        visible = self._run(project, list(zip(drawn, packed, strict=True)))
        for lists in buffers.lists(visible, view):
            buffers.work_on(lists, view, blend)
        if with_depth:
            canvas.depth[1] = np.float32(1) - canvas.left
        return canvas

    def _shown(self, drawn: Sequence[int], view: View) -> tuple[SplatBuffers, list[Packed]]:
        """Buffers for what of parts may show, and this alone, to be packed where it is projected and not longer."""
        parts = [self._parts[number] for number in drawn]
        shown = self._run(lambda part: may_show(part, view), parts)
        ends = np.cumsum([CHUNK * -(-np.count_nonzero(keep) // CHUNK) for keep in shown]).tolist()
        packed: list[Packed] = [partial(pack, *of) for of in zip(parts, [0, *ends[:-1]], shown, strict=True)]
        return SplatBuffers(ends[-1], self._run, only_shown=True), packed


def pack(of: Part, first: int, keep: NDArray | None = None) -> Chunks:
    """A part as loops take it, or its Gaussians `keep`, (n,) bool; `first` is the row of its first record."""
    block = of.block(keep)
    chunks, functions = -(-block.size // CHUNK), block.sh.shape[0]
    planes = np.zeros((GEOMETRY, chunks * CHUNK), np.float32)
    planes[OPACITY] = -np.inf
    planes[MEAN:AXES, : block.size] = block.means
    planes[AXES:OPACITY, : block.size] = block.axes.reshape(9, -1)
    planes[OPACITY, : block.size] = block.log_opacities
    if block.own_pixels is not None:
        planes[OWN_PIXEL, : block.size] = block.own_pixels
    sh = np.zeros((3 * functions, chunks * CHUNK), np.float32)
    sh[:, : block.size] = block.sh.reshape(3 * functions, -1)
    geometry, sh = (_by_chunk(planes, chunks) for planes in (planes, sh))
    return Chunks(first, geometry.ravel(), sh, partial(of.outline, keep))


def _by_chunk(planes: NDArray, chunks: int) -> NDArray:
    """(planes, chunks·128) to (chunks, planes·128)."""
    by_chunk = np.ascontiguousarray(planes.reshape(len(planes), chunks, CHUNK).swapaxes(0, 1))
    return by_chunk.reshape(chunks, len(planes) * CHUNK)
