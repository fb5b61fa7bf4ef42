"""Which views a view is compared with."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .geometry import relative_pose, sweep_coefficients


@dataclass(frozen=True)
class ViewPairs:
    """Which views are compared: every view, or the first alone, with S others, as P = V·S pairs.

    Attributes:
        reference: (P,) int64 views whose depth is sought.
        source: (P,) int64 views that they are compared with.
        rotation, translation: (P, 3, 3), (P, 3) from reference to source frame.
        sources: S, the number of sources of a view.
        of_first: whether the depth of the first view alone is sought, V = 1.
    """

    reference: Tensor
    source: Tensor
    rotation: Tensor
    translation: Tensor
    sources: int
    of_first: bool = False

    @classmethod
    def nearest(cls, c2w: Tensor) -> ViewPairs:
        """Each view of c2w (V, 4, 4) with its nearest others, four at most, which are worth matching."""
        views = c2w.shape[0]
        return cls._closest(c2w, views - 1 - views // 6)  # of six views all but the farthest

    @classmethod
    def all(cls, c2w: Tensor) -> ViewPairs:
        """Each view of c2w (V, 4, 4) with every other: all may witness that space is free."""
        return cls._closest(c2w, c2w.shape[0] - 1)

    @classmethod
    def first(cls, c2w: Tensor) -> ViewPairs:
        """The first view of c2w (V, 4, 4) with every other."""
        source = torch.arange(1, c2w.shape[0])
        reference = torch.zeros_like(source)
        poses = relative_pose(c2w[reference], c2w[source])
        return cls(reference, source, *poses, c2w.shape[0] - 1, of_first=True)

    def own(self, values: Tensor) -> Tensor:
        """Of values (…, n) of all views those of the views whose depth is sought."""
        return values[:1] if self.of_first else values

    @classmethod
    def _closest(cls, c2w: Tensor, sources: int) -> ViewPairs:
        views = c2w.shape[0]
        centres = c2w[:, :3, 3]
        distance = (centres[:, None] - centres[None]).square().sum(dim=-1)
        itself = torch.eye(views, dtype=distance.dtype)
        chosen = torch.topk(distance + itself * 3e38, sources, dim=1, largest=False).indices  # (V, S)
        reference = torch.arange(views)[:, None].expand_as(chosen).reshape(-1)
        source = chosen.reshape(-1)
        return cls(reference, source, *relative_pose(c2w[reference], c2w[source]), sources)

    def by_view(self, values: Tensor) -> Tensor:
        """Values (P, …) of pairs as (V, S, …)."""
        return values.unflatten(0, (-1, self.sources))

    def sweep_terms(self, rays: Tensor, K_unit: Tensor) -> tuple[Tensor, Tensor]:
        """`sweep_coefficients` of every pair, of rays (V, 3, h, w) of the views whose depth is sought and K_unit of all
        (…, 3, 3): positions are in [0, 1].
        """
        return sweep_coefficients(rays[self.reference], K_unit[self.source], self.rotation, self.translation)
