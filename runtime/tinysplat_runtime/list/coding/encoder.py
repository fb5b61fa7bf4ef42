"""A list to a file's bytes, as often as a search for a size or a quality wants.

Tiers (`levels`) are coded one after the other, with one grid, one set of gains and one basis of colours for all.
Positions go to a grid and into an octree, which sorts all else along a Morton curve; `channels` codes it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...codec.job import Job, check_qp
from ...codec.search import Coder
from ...container.cameras import rounded_cameras
from ...container.list import MAX_PER_BYTE, ListScene, Tier, list_rows, list_sections, range_fault
from ...container.writer import Head, write_container
from ...errors import InputError
from ...gaussian.curve import morton_keys
from ...gaussian.gaussians import FIELDS, Gaussians
from ...scene.neighbours import spread
from ...system.threads import Crew
from ..visible import taken, visible_rows
from .attributes import to_columns
from .channels import ChannelCoder, PlacedTier, Shapes, code_colours, code_shapes, decoded
from .grid import cells_in, grid_of, with_cell
from .levels import Tiers
from .octree import encode_points
from .rounding import Rounding
from .steps import Steps

MOST_VIEWPOINTS = 64
"""Cameras of photos that a file keeps; of more, those that lie far from one another."""


class ListEncoder(Coder):
    """Codes one set of Gaussians at any Q_g."""

    def __init__(
        self,
        job: Job,
        rounding: Rounding,
        *,
        tiers: Tiers | None = None,
        recolour: Callable[[Gaussians, NDArray], NDArray] | None = None,
    ) -> None:
        """Leave out what no renderer shows.

        Args:
            job: any Gaussians, with `tiers` a list, and how they are coded; its Q_g is not looked at.
            rounding: how coarsely.
            tiers: what a prefix shows first; None for one tier.
            recolour: gives SH (N, B, 3) to Gaussians as they are decoded, but with the colours that they had; told
                which of the job's they are.

        Raises:
            InputError: no Gaussian shows; or numbers beyond what a file can hold.
        """
        shown = visible_rows(flat := job.gaussians.flat())
        self._shown = np.flatnonzero(shown)
        self._gaussians = taken(flat, self._shown)
        self._job, self._recolour = job, recolour
        self.profile = job.profile
        self._tiers = tiers.of(shown) if tiers else Tiers.whole(self._gaussians.count)
        self._rounding, self._sizes = rounding, rounding.sizes(self._gaussians)
        # Order by weight leaves no blocks that have QPs of their own.
        self._settings = replace(job.profile.encoder, block_qps=False)

    def code(self, qp: float) -> bytes:
        """The file at Q_g.

        Raises:
            InputError: Q_g is beyond ±60, or a reader would refuse the file: numbers too large for it, or so many equal
                Gaussians that its bytes do not pay for them.
        """
        check_qp(qp)
        steps = self._rounding.at(qp)
        with self._job.stats.watch.stage("sort"):
            tiers = self._placed(steps)
        with self._job.stats.watch.stage("x265"):
            scene = self._coded(tiers, steps)
        fault = range_fault(scene)
        if fault is not None:
            raise InputError(fault[1], where=fault[0])
        pictures = [{c.channel.record.key: c.picture for c in tier.coded if c.picture} for tier in tiers]
        payloads = [{key: picture.payload for key, picture in own.items()} for own in pictures]
        sets = [next((picture.parameter_sets for picture in own.values()), b"") for own in pictures]
        with self._job.stats.watch.stage("write"):
            origin, viewpoints = self._gaussians.origin, spread(self._gaussians.viewpoints, MOST_VIEWPOINTS)
            cameras, notes = rounded_cameras(viewpoints, origin), self._gaussians.notes
            head, sections = Head(cameras, origin, self.profile.name, qp, notes), list_sections(scene, sets)
            data = write_container(head, sections, list(list_rows(scene, payloads)), len(scene.tiers), views=1)
        if scene.count > MAX_PER_BYTE * len(data):
            found = f"{scene.count} Gaussians come to {len(data)} bytes, which stand for {MAX_PER_BYTE} each at most"
            raise InputError(found, where="qp")
        return data

    def _placed(self, steps: Steps) -> list[PlacedTier]:
        """Tiers with their positions coded, each along the curve."""
        whole, space = grid_of(self._gaussians.means.astype(np.float64), self._sizes, steps.cell)
        placed = []
        for number, level in enumerate(self._tiers.levels):
            rows = np.flatnonzero(self._tiers.numbers == number)
            grid = with_cell(whole, whole.cell * level.cell, space)
            cells = cells_in(grid, space[rows])
            keys = morton_keys(cells)
            order = _settled_order(keys, self._gaussians, rows)
            points = encode_points(keys[order], int(cells.max()).bit_length() or 1)
            columns = to_columns(self._gaussians, rows[order])
            placed.append(PlacedTier(level, rows[order], replace(grid, **vars(points)), cells[order], columns))
        return placed

    def _coded(self, tiers: Sequence[PlacedTier], steps: Steps) -> ListScene:
        """The scene, and in each tier its channels in the order of records."""
        code = ChannelCoder(steps, self._settings, self._job.told.counted("coding", Crew(self._job.threads).map))
        shapes = code_shapes(tiers, code)
        palette = code_colours(tiers, code, *self._colours(tiers, shapes))
        growths = (0.0, *self._tiers.growths)
        coded = [
            Tier(len(tier.cells), tier.grid, tuple(c.channel for c in tier.coded), growth=growth)
            for tier, growth in zip(tiers, growths, strict=True)
        ]
        degree = math.isqrt(len(palette.mean) // 3) - 1
        return ListScene(degree, **vars(shapes), mean=palette.mean, basis=palette.basis, tiers=tuple(coded))

    def _colours(self, tiers: Sequence[PlacedTier], shapes: Shapes) -> tuple[NDArray, list[NDArray]]:
        """SH (N, B, 3), which make up for what all else lost, and which of them are each tier's."""
        sh, rows = self._gaussians.sh, [tier.rows for tier in tiers]
        if self._recolour is None:
            return sh, rows
        fields = decoded(tiers, shapes.size_middle, np.zeros(3, np.float32), np.zeros((3, 0), np.float16))
        fields["sh"] = sh[np.concatenate(rows)]
        shown = Gaussians.unchecked(**fields, origin=self._gaussians.origin)
        sh = self._recolour(shown, self._shown[np.concatenate(rows)])
        return sh, np.split(np.arange(len(sh)), np.cumsum([len(own) for own in rows])[:-1])


def _settled_order(keys: NDArray, gaussians: Gaussians, of: NDArray) -> NDArray:
    """Along the curve; of the Gaussians `of` (n,) integer, those of one cell by their numbers, so that the order they
    came in plays no part.
    """
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    is_same = ordered[1:] == ordered[:-1]
    tied = np.flatnonzero(np.append(is_same, False) | np.append(False, is_same))
    if len(tied):
        rows = order[tied]
        numbers = [getattr(gaussians, name)[of[rows]].reshape(len(rows), -1) for name in reversed(FIELDS)]
        order[tied] = rows[np.lexsort([*np.concatenate(numbers, axis=1).T, ordered[tied]])]
    return order
