"""What training minimises.

photometric: L1, gradient L1 and the logarithm of the squared error of rendered target views.
depth: cross-entropy of the candidates' logits at half resolution, and smooth L1 of the final depth, where it is known.
rate: what the planes cost to code, as total variation in quantiser steps: Σ_planes mean log2(1 + |∇plane| / step).
"""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from tinysplat.networks.edge import Prediction
from tinysplat_runtime.codec.adaptive import class_step
from tinysplat_runtime.codec.profiles import ADAPTIVE
from tinysplat_runtime.gaussian.planes import PlaneClass

from .samples import Sample, psnr, render_outputs

DEPTH_STEP = 1e-3
"""Quantiser step of inverse depth, relative to its mean: `balanced` at Q_g 0, see docs/FORMAT.md."""

FOOTPRINT_STEP, OPACITY_STEP, COLOUR_STEP = (
    class_step(ADAPTIVE, plane_class) for plane_class in (PlaneClass.SCALE, PlaneClass.OPACITY, PlaneClass.COLOR)
)
"""Steps of the other planes: the codec's own."""

ERROR_FLOOR = 1e-4
"""Squared error, 40 dB, below which its logarithm pulls no harder."""

LARGEST_ERROR = 4.0
"""Depth errors beyond this many candidates pull no harder."""

L1, GRADIENT, DECIBEL = 0.5, 0.25, 0.3
"""Weights of the photometric term; that of the squared error's logarithm lets every picture count alike, however hard
it is."""


@dataclass(frozen=True)
class LossWeights:
    """Factors of the other terms.

    Attributes:
        logits: cross-entropy of candidates.
        depth: smooth L1 of the final depth, candidates.
        rate: bits per pixel, roughly.
    """

    logits: float = 0.01
    depth: float = 0.02
    rate: float = 0.002


def losses(prediction: Prediction, sample: Sample, weights: LossWeights) -> tuple[Tensor, dict[str, float]]:
    """The loss (scalar) of a sample, and figures for the log: its terms, PSNR, and the share of good depths."""
    terms: dict[str, Tensor] = {}
    figures: dict[str, float] = {}
    rendered = [(render_outputs(prediction.outputs, target.camera()), target.image) for target in sample.targets]
    terms["photometric"] = torch.stack([photometric(a, b) for a, b in rendered]).mean()
    terms["rate"] = weights.rate * rate(prediction)
    if sample.depth is not None:
        truth, known = candidate_truth(prediction, sample.depth)
        terms["logits"] = weights.logits * candidate_entropy(prediction.logits, truth, known)
        error = (prediction.level * (prediction.depths.count - 1) - truth).abs()
        robust = functional.smooth_l1_loss(
            error.clamp_max(LARGEST_ERROR), torch.zeros_like(error), reduction="none", beta=0.5
        )
        terms["depth"] = weights.depth * (robust * known).sum() / known.sum().clamp_min(1)
        figures["within one candidate"] = float(((error < 1) * known).sum() / known.sum().clamp_min(1))
    for picture, image in rendered:
        kind = _kind(image.shape[-1] / sample.images.shape[-1])
        figures[f"PSNR {kind}"] = psnr(picture.detach(), image)
    figures.update({name: float(term.detach()) for name, term in terms.items()})
    return torch.stack(list(terms.values())).sum(), figures


def _kind(zoom: float) -> str:
    """Of a target that is drawn at a multiple of the views' size, for the log."""
    return "smaller" if zoom < 1 else "same size" if zoom == 1 else "enlarged"


def photometric(image: Tensor, target: Tensor) -> Tensor:
    """Weighted L1, L1 of the differences' gradients, and logarithm of the squared error of pictures (3, H, W)."""
    error = image - target
    slopes = (error[:, 1:] - error[:, :-1]).abs().mean() + (error[:, :, 1:] - error[:, :, :-1]).abs().mean()
    decibel = torch.log(error.square().mean() / ERROR_FLOOR + 1)
    return L1 * error.abs().mean() + DECIBEL * decibel + GRADIENT * slopes


def candidate_truth(prediction: Prediction, depth: Tensor) -> tuple[Tensor, Tensor]:
    """Exact depth (V, H, W) in candidates, (V, 1, H, W), and 1 where it is known and within the swept range."""
    depths = prediction.depths
    last = depths.count - 1
    offset, span = depths.offset[:, None, None, None], depths.span[:, None, None, None]
    truth = (1 / depth[:, None].clamp_min(1e-6) - offset) / span * last
    known = (depth[:, None] > 0) & (truth > -0.5) & (truth < last + 0.5)
    return truth.clamp(0, last), known.float()


def candidate_entropy(logits: Tensor, truth: Tensor, known: Tensor) -> Tensor:
    """Cross-entropy of logits (V, D, h, w) with the two candidates about the truth at twice the resolution."""
    truth, known = truth[:, :, 1::2, 1::2], known[:, :, 1::2, 1::2]
    below = truth.floor().clamp_max(logits.shape[1] - 2)
    above_share = truth - below
    log_p = torch.log_softmax(logits, dim=1)
    index = below.long()
    entropy = -(1 - above_share) * log_p.gather(1, index) - above_share * log_p.gather(1, index + 1)
    return (entropy * known).sum() / known.sum().clamp_min(1)


def rate(prediction: Prediction) -> Tensor:
    """Bits per Gaussian of the first layer (scalar), roughly: total variation of its planes in quantiser steps."""
    inverse_depth = prediction.depths.at(prediction.level)
    planes = torch.cat(
        [
            inverse_depth / (DEPTH_STEP * inverse_depth.detach().mean(dim=(1, 2, 3), keepdim=True)),
            prediction.footprint / FOOTPRINT_STEP,
            prediction.opacity / OPACITY_STEP,
            prediction.colours / COLOUR_STEP,
        ],
        dim=1,
    )
    across, down = planes[..., 1:] - planes[..., :-1], planes[..., 1:, :] - planes[..., :-1, :]
    bits = (torch.log2(1 + d.abs()).mean(dim=(0, 2, 3)).sum() for d in (across, down))
    return 0.5 * torch.stack(list(bits)).sum()
