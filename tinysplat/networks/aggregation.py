"""Edge-aware aggregation without learned weights: box means, semi-global path costs, confidence-weighted filling.

Path costs follow Hirschmüller, "Stereo Processing by Semiglobal Matching and Mutual Information" (2008), eq. 13. The
recursion along a path is an ONNX Scan in an exported graph and a loop in eager torch, the same arithmetic.
"""

from collections.abc import Callable

import torch
from torch import Tensor
from torch._higher_order_ops.scan import scan
from torch.nn import functional

STEP, JUMP = 0.15, 0.6
"""Penalties for a change of one candidate between neighbours on a path, and for a larger one where colour is even."""

EDGE, FILL_EDGE = 12.0, 12.0
"""How fast the latter, and a neighbour's weight in filling, fall with a difference of colour."""

CONTRAST_WINDOW, CONTRAST_FLOOR = 9, 0.03
"""Of local contrast: side of its window, pixels, and what is added to the deviation there."""

UNREACHABLE = 1e3
"""Cost beyond the first and the last candidate; costs proper are of the order of one."""


def box_mean(images: Tensor, size: int) -> Tensor:
    """Mean over size × size pixels (odd size), borders replicated; (N, C, h, w) to the same."""
    half = size // 2
    rows = functional.avg_pool2d(functional.pad(images, (half, half, 0, 0), mode="replicate"), (1, size), 1)
    return functional.avg_pool2d(functional.pad(rows, (0, 0, half, half), mode="replicate"), (size, 1), 1)


def box_minimum(images: Tensor, size: int) -> Tensor:
    """Minimum over size × size pixels (odd size); (N, C, h, w) to the same."""
    return -functional.max_pool2d(-images, size, stride=1, padding=size // 2)


def local_contrast(gray: Tensor) -> Tensor:
    """Gray values (N, 1, h, w) less their local mean, over their local standard deviation plus `CONTRAST_FLOOR`."""
    mean = box_mean(gray, CONTRAST_WINDOW)
    variance = (box_mean(gray * gray, CONTRAST_WINDOW) - mean * mean).clamp_min(0)
    return (gray - mean) / (torch.sqrt(variance) + CONTRAST_FLOOR)


def path_costs(cost: Tensor, guide: Tensor) -> Tensor:
    """Semi-global aggregation along the four axis directions.

    L(p, d) = C(p, d) + min(L(q, d), L(q, d ± 1) + STEP, min L(q, ·) + jump(p, q)) − min L(q, ·) with q before p on the
    path; jump(p, q) = max(JUMP · exp(−EDGE · |guide(p) − guide(q)|), STEP).

    Args:
        cost: (V, D, h, w) matching costs, of the order of one.
        guide: (V, C, h, w) colours; the largest channel difference counts.

    Returns:
        (V, D, h, w): Σ L over the four paths, less 3 C so that the cost itself counts once.
    """
    across = _jump_penalties(guide)  # between columns, (V, h, w - 1)
    down = _jump_penalties(guide.transpose(2, 3)).transpose(1, 2)  # (V, h - 1, w)
    vertical = _both_ways(cost.permute(2, 0, 3, 1).contiguous(), down.permute(1, 0, 2)[..., None])  # (h, V, w, D)
    horizontal = _both_ways(cost.permute(3, 0, 2, 1).contiguous(), across.permute(2, 0, 1)[..., None])  # (w, V, h, D)
    return vertical.permute(1, 3, 0, 2) + horizontal.permute(1, 3, 2, 0) - 3 * cost


def _jump_penalties(guide: Tensor) -> Tensor:
    difference = (guide[..., 1:] - guide[..., :-1]).abs().amax(dim=1)
    return (JUMP * torch.exp(-EDGE * difference)).clamp_min(STEP)


def _both_ways(cost: Tensor, jump: Tensor) -> Tensor:
    """Path costs along axis 0 in both directions, added: cost (L, N, M, D), jump (L − 1, N, M, 1)."""

    def advance(before: Tensor, here: Tensor, penalty: Tensor) -> Tensor:
        lowest = before.amin(dim=-1, keepdim=True)
        excess = before - lowest
        beside = functional.pad(excess, (1, 1), value=UNREACHABLE)
        beside = torch.minimum(beside[..., 2:], beside[..., :-2]) + STEP
        return here + torch.minimum(torch.minimum(excess, beside), penalty)

    start = torch.zeros_like(cost[:1, :, :, :1]).expand_as(jump[:1])
    forward = _recur(advance, cost, torch.cat([start, jump]), reverse=False)
    backward = _recur(advance, cost, torch.cat([jump, start]), reverse=True)
    return forward + backward


def _recur(
    advance: Callable[[Tensor, Tensor, Tensor], Tensor], cost: Tensor, penalty: Tensor, *, reverse: bool
) -> Tensor:
    """state ← advance(state, cost[i], penalty[i]) along axis 0 from a zero state; all states."""
    state = cost.new_zeros(cost.shape[1:])
    if torch.compiler.is_compiling():

        def body(before: Tensor, here: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
            after = advance(before, *here)
            return after, after.clone()

        return scan(body, state, (cost, penalty), reverse=reverse)[1]
    states = torch.empty_like(cost)
    length = cost.shape[0]
    for i in reversed(range(length)) if reverse else range(length):
        state = advance(state, cost[i], penalty[i])
        states[i] = state
    return states


def fill_uncertain(values: Tensor, confidence: Tensor, guide: Tensor, dilations: tuple[int, ...]) -> Tensor:
    """Replace values of low confidence by confident ones nearby of similar colour.

    An à-trous joint bilateral filter: each pass takes the weighted mean of 3 × 3 pixels `dilation` apart, weights
    exp(−FILL_EDGE · Σ|Δguide|) · confidence, and blends it in where confidence lies below one half. What a pass has
    filled counts as confident in the next.

    Args:
        values: (V, 1, h, w).
        confidence: (V, 1, h, w) in (0, 1].
        guide: (V, C, h, w) colours.
        dilations: distance between the pixels of each pass.

    Returns:
        (V, 1, h, w) filled values.
    """
    height, width = guide.shape[2:]
    keep = confidence > 0.5
    filled, trust = values, confidence
    for dilation in dilations:
        stacked = functional.pad(torch.cat([guide, filled, trust], dim=1), (dilation,) * 4, mode="replicate")
        total, weights = torch.zeros_like(values), torch.zeros_like(values)
        for row in (0, dilation, 2 * dilation):
            for column in (0, dilation, 2 * dilation):
                part = stacked[:, :, row : row + height, column : column + width]
                similarity = torch.exp(-FILL_EDGE * (part[:, :-2] - guide).abs().sum(dim=1, keepdim=True))
                weight = similarity * part[:, -1:]
                total, weights = total + weight * part[:, -2:-1], weights + weight
        filled = torch.where(keep, values, total / weights.clamp_min(1e-8))
        trust = torch.maximum(trust, 0.1 * weights.clamp_max(9))
    return filled
