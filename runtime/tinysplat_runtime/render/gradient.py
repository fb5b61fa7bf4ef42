"""Gaussians that move: how well they draw a photo, and which way each of them would draw it better.

    field = MovableGaussians(gaussians, Crew(threads).map)
    gradients = {grid: grid.zeros() for grid in field.grids}
    error = field.measure(Target(camera, photo), gradients=gradients)     # adds to them
    field.values[:, grid.rows] -= …

A Gaussian moves along the ray of its own pixel alone, and may grow, fade and change its colour of SH degree 0
(`kernels_place.VALUES`). Needs numba (`tinysplat[fast]`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..gaussian.footprints import own_pixels
from ..gaussian.gaussians import Gaussians
from ..scene.cameras import Camera
from ..system import disk
from ..system.decibels import decibels
from . import kernels_chain, kernels_gradient, kernels_place
from .kernels_blend import Extent, Scratch
from .kernels_chain import Moved
from .kernels_gradient import PAIR, SUMS, Exposure, Sought
from .kernels_list import Listed, Visible
from .kernels_place import BASE, LOG_DEPTH, LOG_SIZE, LOGIT, SH_RED, VALUES
from .kernels_project import CHUNK, GEOMETRY, MEAN, OPACITY, OWN_PIXEL
from .lists import Chunks, SplatBuffers, TileLists, view_numbers
from .near import NearViews, Shares
from .prepare import ALPHA_MIN, BLOCK_SIZE, Block, principal_axes
from .project import View
from .renderer import NEAR_PLANE

_LEAST_OPACITY, _LARGEST_OPACITY = 1e-9, 1 - 1e-6


@dataclass(frozen=True, eq=False)
class Target:
    """A photo that is to be seen as gain · picture + offset, before a grey background.

    Attributes:
        camera: where it was taken.
        photo: (H, W, 3) float32 in [0, 1], of the camera's size; pixels whose red is NaN are left out.
        gain, offset: how it was exposed.
        nothing: (H, W) float32 shares of pixels in which nothing is, and `photo` is black; None where all is something.
        backdrop: how bright the background is; see `before`.
    """

    camera: Camera
    photo: NDArray
    gain: float = 1.0
    offset: float = 0.0
    nothing: NDArray | None = None
    backdrop: float = 0.0

    def before(self, backdrop: float) -> Target:
        """The photo with another background where nothing is, and where Gaussians are seen through."""
        if self.nothing is None or not backdrop:
            return replace(self, backdrop=backdrop)
        lit = np.float32(self.gain * backdrop + self.offset)
        return replace(self, photo=self.photo + lit * self.nothing[..., None], backdrop=backdrop)


@dataclass(frozen=True)
class PhotoError:
    """What a photo lacks.

    Attributes:
        absolute: Σ |error| over pixels and colours.
        squared: Σ error² of values clipped to [0, 1].
        by_gain: d `absolute` / d gain.
        by_offset: d `absolute` / d offset.
        known: how many pixels there are that the photo knows.
        alike: Σ SSIM over colours and blocks of pixels (`kernels_gradient.BLOCK`) times their pixels.
        compared: how many colours of pixels that were.
    """

    absolute: float
    squared: float
    by_gain: float
    by_offset: float
    known: float
    alike: float
    compared: float

    @property
    def psnr(self) -> float:
        """In dB; NaN where no pixel is known."""
        return decibels(self.squared / (3 * self.known)) if self.known else math.nan

    @property
    def ssim(self) -> float:
        """The mean over blocks; NaN where none is known."""
        return self.alike / self.compared if self.compared else math.nan


@dataclass(frozen=True, eq=False)
class Grid:
    """One view of one layer.

    Attributes:
        layer, view: which.
        rows: its Gaussians among all rows, in the order of its pixels.
        height, width: of the grid.
    """

    layer: int
    view: int
    rows: slice
    height: int
    width: int

    def zeros(self) -> NDArray:
        """(6, H·W or a little more) float32, for gradients of its Gaussians in the order of its pixels."""
        # A chunk more than there is, so that no part is contiguous: code is compiled for one layout.
        return np.zeros((VALUES, padded(self.height * self.width) + CHUNK), np.float32)


@dataclass(frozen=True, eq=False)
class _Piece:
    """Gaussians that are worked on together: a part of a grid.

    Attributes:
        grid: which.
        start: its first row.
        base: (chunks, 13, 128) float32, see `kernels_gradient`.
        centre: (3,) float64, of the own camera, relative to the Gaussians' origin.
        sh: (chunks, 3 S·128) float32.
        quats, scales: (n, 4) and (n, 3) float32 as they began, for what float32 is too narrow for.
    """

    grid: Grid
    start: int
    base: NDArray
    centre: NDArray
    sh: NDArray
    quats: NDArray
    scales: NDArray

    @property
    def rows(self) -> slice:
        return slice(self.start, self.start + CHUNK * len(self.base))


@dataclass(frozen=True, eq=False)
class _Placed:
    """A piece that is drawn.

    Attributes:
        piece: which.
        start: its first row among those that are drawn.
        geometry: (chunks, 14, 128) float32, as `kernels_project.project` takes it.
    """

    piece: _Piece
    start: int
    geometry: NDArray


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


class MovableGaussians:
    """Per-pixel Gaussians, their values, and what drawing them takes.

    Attributes:
        grids: every view of every layer.
        values: (6, rows) float32, see `kernels_place.VALUES`; grids begin at multiples of 128 rows, and rows that
            belong to none show nowhere.
    """

    def __init__(self, gaussians: Gaussians, run_jobs: Callable, dilation: str = "own") -> None:
        """Take Gaussians with cameras.

        Args:
            gaussians: per pixel; of a capture, those on disk are read again where they are needed.
            run_jobs: maps a function over a list, on any number of threads.
            dilation: as `renderer.render` has it.
        """
        self.origin = gaussians.origin
        self.grids = tuple(_grids(gaussians))
        self._near, self._dilation = NearViews.of(gaussians), dilation
        rows = padded(self.grids[-1].rows.stop)
        self.values = disk.zeros((VALUES, rows), views=len(gaussians.cameras))
        self._pieces = list[_Piece]()
        for number, layer in enumerate(gaussians.layers):
            self._take(layer, [grid for grid in self.grids if grid.layer == number], gaussians.cameras)
        self._run = run_jobs
        self._geometry = np.empty((0, GEOMETRY, CHUNK), np.float32)
        self._comparer = Comparer(0, run_jobs)

    def _take(self, layer: Gaussians, grids: Sequence[Grid], photos: Sequence[Camera]) -> None:
        """Make pieces of a layer's Gaussians."""
        chunks, views = padded(grids[0].height * grids[0].width) // CHUNK, len(grids)
        bases = disk.zeros((views, chunks, BASE, CHUNK))
        colours = disk.zeros((views, chunks, 3 * layer.sh.shape[-2] * CHUNK))
        for grid, base, sh in zip(grids, bases, colours, strict=True):
            pieces = list(self._cut(layer, grid, photos[grid.view], base, sh))
            self._pieces += pieces

    def _cut(self, layer: Gaussians, grid: Grid, photo: Camera, bases: NDArray, colours: NDArray) -> Iterator[_Piece]:
        """The pieces of a grid; its values, bases (chunks, 13, 128) and SH (chunks, 3 S·128) are filled in."""
        centre = layer.cameras[grid.view].centre - self.origin
        count = grid.height * grid.width
        means, quats, scales, opacities = (
            array[grid.view].reshape(count, *array.shape[3:])
            for array in (layer.means, layer.quats, layer.scales, layer.opacities)
        )
        sh = layer.sh[grid.view].reshape(count, -1)  # (n, 3 S), colours last
        pixels = own_pixels(means, self.origin, photo) * (self._dilation == "own")
        values = self.values[:, grid.rows]
        self.values[LOGIT, grid.rows.stop : padded(grid.rows.stop)] = -np.inf
        values[LOGIT] = logits_of(opacities)
        values[SH_RED:] = sh[:, :3].T
        for first in range(0, count, BLOCK_SIZE):
            part = slice(first, min(first + BLOCK_SIZE, count))
            base = np.concatenate(
                [(means[part] - centre).T, principal_axes(quats[part], scales[part]).reshape(9, -1), pixels[None, part]]
            )
            chunks = slice(first // CHUNK, padded(part.stop) // CHUNK)
            fill_chunks(bases[chunks], base)
            fill_chunks(colours[chunks].reshape(-1, sh.shape[1], CHUNK), sh[part].T)
            start = grid.rows.start + first
            yield _Piece(grid, start, bases[chunks], centre, colours[chunks], quats[part], scales[part])

    def gaussians(self, start: Gaussians) -> Gaussians:
        """`start`, which these were made of, as the values have it; what can show nowhere has opacity 0."""
        layers = []
        for number, layer in enumerate(start.layers):
            arrays = {name: getattr(layer, name) for name in ("means", "scales", "opacities", "sh")}
            fields: dict[str, Any] = {name: disk.zeros(array.shape) for name, array in arrays.items()}
            for grid in self.grids:
                if grid.layer == number:
                    self._fill(fields, layer, grid)
                    its = {name: array[grid.view, None] for name, array in fields.items()}
                    Gaussians(**its, quats=layer.quats[grid.view, None])  # refuses what float32 does not hold
            layers.append(layer.changed(**fields, extra_layers=()))
        return Gaussians.stacked(layers).with_notes(start.notes)

    def _fill(self, fields: dict[str, NDArray], layer: Gaussians, grid: Grid) -> None:
        """Write a grid's part of a layer's arrays."""
        view, values = grid.view, self.values[:, grid.rows].reshape(VALUES, grid.height, grid.width)
        centre = layer.cameras[view].centre - layer.origin
        away = np.exp(values[LOG_DEPTH].astype(np.float64))[..., None]
        grown = away * np.exp(values[LOG_SIZE].astype(np.float64))[..., None]
        opacities = opacities_of(values[LOGIT])
        fields["means"][view] = centre + away * (layer.means[view] - centre)
        fields["scales"][view] = grown * layer.scales[view]
        fields["opacities"][view] = np.where(opacities < ALPHA_MIN, 0, opacities)
        fields["sh"][view] = layer.sh[view]
        fields["sh"][view][..., 0, :] = np.moveaxis(values[SH_RED:], 0, -1)

    def measure(
        self,
        target: Target,
        *,
        shares: Shares | None = None,
        gradients: Mapping[Grid, NDArray] | None = None,
        weight: float = 1.0,
        shown: NDArray | None = None,
        most_left: float = 1.0,
        hidden: float = 0.0,
        structure: float = 0.0,
    ) -> PhotoError:
        """Draw a photo's picture and hold it against the photo.

        Args:
            target: the photo.
            shares: what of each view is drawn; without them, all of every view by depth.
            gradients: by grid, what gradients with respect to its part of `values` are added to, as `Grid.zeros` makes
                it; None, or a grid without any, asks for none.
            weight: what a unit of the loss counts in `gradients`.
            shown: (H, W, 4) float32, filled with the picture and its transmittance, but for tiles of which the photo
                knows nothing; or None.
            most_left: pixels of more transmittance than this, where `shown` is asked for, count nowhere.
            hidden: Gaussians whose middle lies behind others that leave less transmittance than this have no gradient
                there.
            structure: share of 1 − SSIM in the loss, beside |error|.
        """
        view = View.of(target.camera, self.origin, NEAR_PLANE)
        shares = shares or Shares.by_depth(np.ones(1 + self.grids[-1].view))
        pieces = self._placed([piece for piece in self._pieces if shares.whole[piece.grid.view] > 0])
        visible = self._run(lambda placed: self._project(placed, view, shares), pieces)
        exposure = Exposure(*map(np.float32, (target.gain, target.offset, weight, structure)))
        room = np.empty((0, 0, 0), np.float32) if shown is None else shown
        sought = Sought(target.photo, exposure, room, np.float32(most_left), np.float32(hidden), shares.has_front)
        add_up = partial(self._add_up, pieces, visible, view, gradients) if gradients else None
        return self._comparer.compare(visible, view, sought, add_up)

    def shares(self, camera: Camera, without: Iterable[int] = ()) -> Shares:
        """What a camera's picture is drawn with, of all views but some."""
        return Shares.by_depth(np.ones(1)) if self._near is None else self._near.shares(camera, without)

    def _placed(self, pieces: Sequence[_Piece]) -> list[_Placed]:
        """Places for what is drawn: few views of a capture are, and what drawing takes is as large as all they hold."""
        chunks = [0, *np.cumsum([len(piece.base) for piece in pieces]).tolist()]
        if len(self._geometry) < chunks[-1]:
            self._geometry = np.empty((chunks[-1], GEOMETRY, CHUNK), np.float32)
            self._comparer = Comparer(CHUNK * chunks[-1], self._run)
        starts = itertools.pairwise(chunks)
        return [
            _Placed(piece, CHUNK * first, self._geometry[first:stop])
            for piece, (first, stop) in zip(pieces, starts, strict=True)
        ]

    def _project(self, placed: _Placed, view: View, shares: Shares) -> Visible:
        piece, geometry = placed.piece, placed.geometry
        kernels_place.place(piece.base, piece.centre, self.values, piece.start, geometry, piece.sh)
        chunks = Chunks(placed.start, geometry.ravel(), piece.sh, lambda: self._block(placed))
        return self._comparer.buffers.project(chunks, view, shares.of(piece.grid.view, piece.grid.layer == 0))

    def _block(self, placed: _Placed) -> Block:
        """A piece as it stands, for the code that works in float64."""
        piece = placed.piece
        planes = placed.geometry.swapaxes(0, 1).reshape(GEOMETRY, -1)[:, : len(piece.quats)]
        log_depth, log_size = self.values[: LOG_SIZE + 1, piece.rows][:, : len(piece.quats)]
        nothing = np.zeros((0, 3, 0), np.float32)
        scales = piece.scales * np.exp(log_depth + log_size)[:, None]
        return Block(planes[MEAN : MEAN + 3], nothing, planes[OPACITY], nothing, piece.quats, scales, planes[OWN_PIXEL])

    def _add_up(
        self,
        pieces: list[_Placed],
        visible: list[Visible],
        view: View,
        gradients: Mapping[Grid, NDArray],
        lists: TileLists,
        pairs: NDArray,
    ) -> None:
        numbers = view_numbers(view)

        def add(number: int) -> None:
            placed, piece = pieces[number], pieces[number].piece
            first = piece.start - piece.grid.rows.start
            gradient = gradients[piece.grid][:, first : first + CHUNK * len(piece.base)]
            moved = Moved(placed.start, placed.geometry, piece.centre, self.values[:, piece.rows], gradient)
            records, seen, ends = self._comparer.buffers.records, visible[number], lists.starts[number]
            kernels_chain.add_up(records, seen, lists.tiles, ends, pairs, moved, numbers)

        self._run(add, [number for number, placed in enumerate(pieces) if placed.piece.grid in gradients])


def _grids(gaussians: Gaussians) -> Iterator[Grid]:
    first = 0
    for number, layer in enumerate(gaussians.layers):
        views, height, width = layer.opacities.shape
        for view in range(views):
            yield Grid(number, view, slice(first, first + height * width), height, width)
            first = padded(first + height * width)


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
