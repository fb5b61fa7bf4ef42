"""Metrics are the definitions that published figures use, and say nothing where they know nothing."""

import math

import numpy as np
import pytest
import torch
from scenes import make_photo, refusing
from skimage.metrics import peak_signal_noise_ratio, structural_similarity
from torch import nn

from tinysplat.measure.lpips import Lpips, LpipsFiles
from tinysplat.measure.metrics import METRICS, fitted, flip, judged, psnr, sharpness, ssim
from tinysplat_runtime.errors import InputError


def photo(height: int = 40, width: int = 52, seed: int = 0) -> np.ndarray:
    return make_photo(height, width, seed).astype(np.float32) / 255


def noisy(image: np.ndarray, sigma: float, seed: int = 1) -> np.ndarray:
    return (image + np.random.default_rng(seed).normal(0, sigma, image.shape)).astype(np.float32)


# ---- pictures ----------------------------------------------------------------------------------------------------


def test_psnr_is_scikit_images_on_clipped_values():
    image, reference = noisy(photo(), 0.3), photo()
    clipped = np.clip(image, 0, 1)
    assert (clipped != image).any()
    assert psnr(image, reference) == pytest.approx(peak_signal_noise_ratio(reference, clipped, data_range=1), abs=1e-5)


def test_psnr_of_equal_pictures_is_the_ceiling_and_of_no_pixels_nan():
    assert psnr(photo(), photo()) == 150
    assert math.isnan(psnr(photo(), photo(), np.zeros((40, 52), bool)))


@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.2])
@pytest.mark.parametrize("size", [(11, 11), (40, 52), (64, 33)])
def test_ssim_is_scikit_images_with_the_settings_of_pixelsplat(size, sigma):
    reference = photo(*size)
    image = np.clip(noisy(reference, sigma), 0, 1)
    theirs = structural_similarity(reference, image, win_size=11, gaussian_weights=True, channel_axis=2, data_range=1.0)
    assert ssim(image, reference) == pytest.approx(theirs, abs=1e-5)


def test_sharpness_is_the_share_of_a_photos_gradients_that_a_picture_has():
    reference = 0.25 + 0.5 * photo()
    rough = noisy(reference, 0.1).clip(0, 1)
    assert sharpness(reference, reference) == 1
    assert sharpness((reference + 1) / 2, reference) == pytest.approx(0.5)
    assert sharpness(reference, rough) < 0.9 and sharpness(reference, rough) * sharpness(rough, reference) == 1
    assert math.isnan(sharpness(reference, np.full_like(reference, 0.3)))


def test_flip_is_nothing_of_equal_pictures_and_grows_with_what_eyes_see():
    pytest.importorskip("flip_evaluator")
    errors = [flip(noisy(photo(), sigma), photo()) for sigma in (0, 0.02, 0.1, 0.4)]
    assert errors[0] == 0 and (np.diff(errors) > 0).all() and errors[-1] < 1


@pytest.mark.parametrize("metric", METRICS.values())
@pytest.mark.parametrize("other", [(40, 51, 3), (40, 52), (40, 52, 4)])
def test_pictures_of_unlike_shapes_are_refused(metric, other):
    with pytest.raises(InputError):
        metric(photo(), np.zeros(other, np.float32))


def test_ssim_refuses_pictures_smaller_than_its_window():
    with refusing(InputError, "11"):
        ssim(photo(10, 30), photo(10, 30))


# ---- LPIPS -------------------------------------------------------------------------------------------------------

VGG = (64, 64, "M", 128, 128, "M", 256, 256, 256, "M", 512, 512, 512, "M", 512, 512, 512)


def make_backbone() -> nn.Sequential:
    """torchvision's `features` with random weights, written down a second time."""
    torch.manual_seed(0)
    layers: list[nn.Module] = []
    width = 3
    for entry in VGG:
        if entry == "M":
            layers.append(nn.MaxPool2d(2, 2))
        else:
            layers += [nn.Conv2d(width, int(entry), 3, padding=1), nn.ReLU()]
            width = int(entry)
    return nn.Sequential(*layers)


TAPS = (3, 8, 15, 22, 29)


def make_weights() -> tuple[nn.Sequential, dict[str, torch.Tensor], dict[str, torch.Tensor]]:
    features = make_backbone()
    state = {f"features.{name}": value for name, value in features.state_dict().items()}
    widths = [features[tap - 1].out_channels for tap in TAPS]
    linear = {f"lin{i}.model.1.weight": torch.rand(1, width, 1, 1) for i, width in enumerate(widths)}
    return features, {**state, "classifier.6.bias": torch.zeros(3)}, linear


@torch.no_grad()
def reference_lpips(features: nn.Sequential, linear: dict[str, torch.Tensor], a, b) -> float:
    """Zhang et al. 2018, equation 1, layer by layer."""
    mean, deviation = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    x, y = (((torch.from_numpy(p) - mean) / deviation).permute(2, 0, 1)[None] for p in (a, b))
    total, layer = 0.0, 0
    for index, module in enumerate(features):
        x, y = module(x), module(y)
        if index in TAPS:
            difference = nn.functional.normalize(x, dim=1) - nn.functional.normalize(y, dim=1)
            total += float((difference**2 * linear[f"lin{layer}.model.1.weight"]).sum(1).mean())
            layer += 1
    return total


def save_weights(folder):
    features, backbone, linear = make_weights()
    files = LpipsFiles(folder / "backbone.pth", folder / "linear.pth")
    torch.save(backbone, files.backbone)
    torch.save(linear, files.linear)
    return files, features, backbone, linear


def test_lpips_follows_its_definition(tmp_path):
    files, features, _, linear = save_weights(tmp_path)
    metric = Lpips(files)
    a, b = photo(48, 40), np.clip(noisy(photo(48, 40), 0.2), 0, 1)
    # ImageNet's moments are given to three digits on either scale: a relative 1e-3 between the two forms.
    assert metric(a, b) == pytest.approx(reference_lpips(features, linear, a, b), rel=5e-3)
    assert metric(a, a) == 0
    assert metric(a, b) == metric(np.where(b == 1, 1.5, b), a)


def test_lpips_reads_files_and_names_what_does_not_fit(tmp_path):
    files, _, backbone, _ = save_weights(tmp_path)
    metric = Lpips(files)
    with pytest.raises(InputError):
        metric(photo(8, 40), photo(8, 40))
    with refusing(InputError, "lin0.model.1.weight"):
        Lpips(LpipsFiles(files.backbone, files.backbone))
    torch.save({**backbone, "features.2.weight": torch.zeros(2, 2)}, files.backbone)
    with refusing(InputError, "backbone.pth 2.weight 2 64, 64, 3, 3"):
        Lpips(files)
    files.backbone.write_bytes(b"not weights")
    with refusing(InputError, "backbone.pth"):
        Lpips(files)


def test_pixels_whose_reference_is_nan_do_not_count() -> None:
    rng = np.random.default_rng(0)
    reference = rng.uniform(0.2, 0.8, (40, 30, 3))
    image = reference + 0.05 * rng.normal(size=reference.shape)
    left_out = reference.copy()
    left_out[:, 15:] = np.nan
    spoilt = image.copy()
    spoilt[:, 15:] = rng.uniform(size=spoilt[:, 15:].shape)
    for name, metric in METRICS.items():
        assert metric(image, left_out) == pytest.approx(metric(image[:, :15], reference[:, :15]), rel=0.1), name
        if name in ("psnr", "sharpness"):
            assert metric(spoilt, left_out) == metric(image, left_out), name
    assert np.isnan(psnr(image, np.full_like(reference, np.nan)))


def test_a_picture_that_differs_by_exposure_alone_is_as_good_as_its_photo_once_fitted() -> None:
    reference = 0.25 + 0.5 * photo()
    darker = reference * [0.5, 0.6, 0.4] + [0.05, 0.0, 0.1]
    assert psnr(darker, reference) < 20 and np.abs(fitted(darker, reference) - reference).max() < 1e-6
    assert judged(darker, reference)["fitted"] > 100 and judged(darker, reference)["fitted_ssim"] > 0.999
    masked = reference.copy()
    masked[:20] = np.nan
    assert psnr(fitted(darker, masked), reference) > 100
