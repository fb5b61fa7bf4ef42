"""How far one picture or set of Gaussians is from another.

Pictures are (H, W, 3) in [0, 1]; values outside are clipped, none are rounded to 8 bits. PSNR and SSIM are the
definitions of the evaluations that the paper quotes (pixelSplat, MVSplat, DepthSplat), so that figures compare:

    PSNR  −10·log10 of the mean squared error of one image; a set's figure is the mean over its images.
    SSIM  Wang et al. 2004 as scikit-image computes it with `gaussian_weights=True, win_size=11, data_range=1`:
          Gaussian window of 11 pixels with σ = 1.5, sample covariance, the border of 5 pixels left out, mean over the
          three channels. (3DGS's own script pads with zeros and uses the population covariance: about 1e-3 away.)
    FLIP  Andersson et al. 2020, by NVIDIA's package `flip-evaluator` at its default viewing distance (67 pixels per
          degree), mean over the pixels: 0 for what no eye tells apart.

Sharpness is how much of a photo's detail a picture shows, which PSNR and SSIM hardly see: their errors are least where
detail that lies a pixel beside is blurred.

Pixels whose reference is NaN do not count: what a photo's mask leaves out. In windows that reach into them the picture
is as the reference is.

LPIPS needs torch and weights and stands in `measure.lpips`.
"""

import math
from collections.abc import Callable, Mapping
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.decibels import decibels

SSIM_WINDOW = 11


def psnr(image: NDArray, reference: NDArray, mask: NDArray | None = None) -> float:
    """Peak signal-to-noise ratio in dB of values clipped to [0, 1].

    Args:
        image: (H, W, 3) floating point.
        reference: the same shape.
        mask: (H, W) bool, pixels that count; None for all.

    Returns:
        dB, at most `CEILING`; NaN where the mask leaves no pixel.

    Raises:
        InputError: shapes differ.
    """
    image, reference, counts = _pictures(image, reference)
    squared = (image - reference) ** 2
    if mask is not None or not counts.all():
        squared = squared[counts if mask is None else counts & mask]
    if squared.size == 0:
        return math.nan
    return decibels(float(squared.mean(dtype=np.float64)))


def ssim(image: NDArray, reference: NDArray) -> float:
    """Structural similarity, −1 to 1; the module's text has the definition.

    Args:
        image: (H, W, 3) floating point, sides of 11 or more.
        reference: the same shape.

    Raises:
        InputError: shapes differ, or a side is shorter than the window.
    """
    from skimage.metrics import structural_similarity

    x, y, counts = _pictures(image, reference)
    if min(x.shape[:2]) < SSIM_WINDOW:
        raise InputError(f"{x.shape[1]}x{x.shape[0]} pixels, expected sides of {SSIM_WINDOW} or more", where="image")
    measures = {"win_size": SSIM_WINDOW, "gaussian_weights": True, "data_range": 1, "channel_axis": -1}
    if counts.all():
        return float(structural_similarity(x, y, **measures))
    border = np.s_[SSIM_WINDOW // 2 : -(SSIM_WINDOW // 2)]
    values = structural_similarity(x, y, full=True, **measures)[1][border, border]
    return _mean(values, counts[border, border])


def flip(image: NDArray, reference: NDArray) -> float:
    """Mean FLIP error of (H, W, 3) floating point pictures in [0, 1], 0 to 1; the module's text has the definition.

    Raises:
        InputError: shapes differ.
    """
    from flip_evaluator import evaluate

    x, y, counts = _pictures(image, reference)
    errors, mean, _ = evaluate(y.astype(np.float32), x.astype(np.float32), "LDR", applyMagma=False)
    return float(mean) if counts.all() else _mean(errors, counts)


def sharpness(image: NDArray, reference: NDArray) -> float:
    """Mean length of a picture's gradient over that of its reference's, both (H, W, 3) floating point.

    Returns:
        1 where a picture is as sharp as the reference, less where it is softer; NaN of a reference of one colour.

    Raises:
        InputError: shapes differ.
    """
    *pictures, counts = _pictures(image, reference)
    counts = counts[1:, 1:] & counts[:-1, 1:] & counts[1:, :-1]
    shown, wanted = (_steepness(picture, counts) for picture in pictures)
    return shown / wanted if wanted else math.nan


def _steepness(picture: NDArray, counts: NDArray) -> float:
    lengths = np.hypot(np.diff(picture, axis=0)[:, 1:], np.diff(picture, axis=1)[1:])
    return float(lengths.mean()) if counts.all() else _mean(lengths, counts)


def _mean(values: NDArray, counts: NDArray) -> float:
    """Over pixels that count; NaN where none does."""
    return float(values[counts].mean()) if counts.any() else math.nan


METRICS: Mapping[str, Callable[[NDArray, NDArray], float]] = {
    "psnr": psnr,
    "ssim": ssim,
    **({"flip": flip} if find_spec("flip_evaluator") else {}),
    "sharpness": sharpness,
}
"""What pictures are judged by, FLIP where its package is installed; LPIPS joins them where its weights are at hand."""


def fitted(image: NDArray, reference: NDArray) -> NDArray:
    """A picture with the exposure of its reference: the gain and offset of each colour that fit best.

    How a photo that was left out was exposed is nobody's to know, so that a picture may be as good as its reference
    and yet darker.

    Args:
        image: (H, W, 3) floating point.
        reference: the same shape.

    Returns:
        (H, W, 3) float64 in [0, 1]; the picture itself where its reference knows no pixel.

    Raises:
        InputError: shapes differ.
    """
    shown, wanted, counts = _pictures(image, reference)
    if not counts.any():
        return shown
    for colour in range(3):
        seen, sought = shown[counts, colour], wanted[counts, colour]
        (gain, offset), *_ = np.linalg.lstsq(np.stack([seen, np.ones_like(seen)], axis=1), sought, rcond=None)
        shown[..., colour] = gain * shown[..., colour] + offset
    return shown.clip(0, 1)


def judged(image: NDArray, reference: NDArray) -> dict[str, float]:
    """`METRICS` of a picture as it is, and fitted to its reference: `fitted`, dB, and `fitted_ssim`, `fitted_flip`."""
    exposed = fitted(image, reference)
    figures = {name: metric(image, reference) for name, metric in METRICS.items()}
    figures["fitted"] = psnr(exposed, reference)
    return figures | {
        f"fitted_{name}": METRICS[name](exposed, reference) for name in ("ssim", "flip") if name in METRICS
    }


def _pictures(image: NDArray, reference: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Both as (H, W, 3) float64 in [0, 1], and (H, W) bool, which pixels count; the others are alike."""
    image, reference = np.asarray(image), np.asarray(reference)
    if image.shape != reference.shape or image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise InputError(f"shapes {image.shape} and {reference.shape}, expected two equal (H, W, 3)", where="image")
    shown, wanted = np.clip(image, 0, 1, dtype=np.float64), np.clip(reference, 0, 1, dtype=np.float64)
    counts = ~np.isnan(wanted[..., 0])
    return (shown, wanted, counts) if counts.all() else (shown, np.where(counts[..., None], wanted, shown), counts)
