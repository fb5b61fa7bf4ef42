"""Which views a view is compared with, for the views of several scenes in one batch.

Tensors per view are (B·V, …), the views of a scene next to each other. A list of other views is an int64 tensor
(B·V, M) that indexes this batch: for each view the M views of its scene that it attends to and is swept against.
"""

from __future__ import annotations

import torch
from torch import Tensor


def all_others(c2w: Tensor) -> Tensor:
    """Every other view of the scene in increasing order: (B·V, V − 1) from c2w (B, V, 4, 4)."""
    scenes, views = c2w.shape[:2]
    own = torch.arange(views, device=c2w.device)[:, None]
    other = torch.arange(views - 1, device=c2w.device)[None]
    return _in_batch((other + (other >= own).long()).expand(scenes, views, views - 1), views)


def nearest_others(c2w: Tensor, count: int) -> Tensor:
    """The `count` other views whose camera centres are nearest, or all others where there are no more than `count`.

    Nearest first by Euclidean distance, but all others in increasing order. Equal distances stand as the sort leaves
    them. The distance is a norm of differences, as ONNX has no cdist.

    Args:
        c2w: (B, V, 4, 4).
        count: views wanted.

    Returns:
        (B·V, min(count, V − 1)).
    """
    views = c2w.shape[1]
    centres = c2w[..., :3, 3]
    distances = (centres[:, :, None] - centres[:, None]).norm(dim=-1)  # (B, V, V)
    index = torch.arange(views, dtype=c2w.dtype, device=c2w.device)
    keys = torch.where(index.max() > count, distances, index)
    keys = keys.masked_fill(index[:, None] == index, -1)  # the view itself comes first and is left out
    return _in_batch(keys.argsort(dim=-1)[..., 1:].narrow(-1, 0, torch.sym_min(views - 1, count)), views)


def _in_batch(others: Tensor, views: int) -> Tensor:
    first = torch.arange(others.shape[0], device=others.device)[:, None, None] * views
    return (others + first).flatten(0, 1)
