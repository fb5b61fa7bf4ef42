"""Which views a view is compared with."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .geometry import relative_pose


@dataclass(frozen=True)
class ViewPairs:
    """Which views are compared: every view with its nearest others, as P = V·S pairs.

    Attributes:
        reference: (P,) int64 views whose depth is sought.
        source: (P,) int64 views that they are compared with.
        rotation, translation: (P, 3, 3), (P, 3) from reference to source frame.
        sources: S, the number of sources of a view.
    """

    reference: Tensor
    source: Tensor
    rotation: Tensor
    translation: Tensor
    sources: int

    @classmethod
    def build(cls, c2w: Tensor, K: Tensor) -> ViewPairs:
        """Pair each view with its nearest one or two others."""
        views = c2w.shape[0]
        sources = 2 - 2 // views  # one of two views, else two
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
