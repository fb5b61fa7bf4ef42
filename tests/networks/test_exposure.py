"""One exposure for all photos: altered copies of a traced scene come back, and what is no evidence changes nothing."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from networks.two_planes import FAR, NEAR, network_inputs, row_of_cameras, trace
from torch import Tensor

from tinysplat.networks.edge import EdgeSettings
from tinysplat.networks.exposure import ExposureSettings, one_exposure
from tinysplat.networks.pairs import ViewPairs
from tinysplat.networks.sweep import InverseDepths

HEIGHT, WIDTH = 96, 128


def both(images: np.ndarray, views: int) -> tuple[Tensor, Tensor]:
    """What `one_exposure` makes of photos (V, H, W, 3), alike: to match with, and to show."""
    given = network_inputs(images, row_of_cameras(views, HEIGHT, WIDTH), NEAR, FAR)
    photos, K, c2w, near, far = (torch.from_numpy(array) for array in given.values())
    whole = InverseDepths(1 / far, 1 / near - 1 / far, 26)
    with torch.no_grad():
        matched, shown = one_exposure(
            photos, K, ViewPairs.nearest(c2w), whole, ExposureSettings(), EdgeSettings().analysis
        )
    return matched.permute(0, 2, 3, 1), shown.permute(0, 2, 3, 1)


@pytest.mark.parametrize("views", [2, 4])
def test_photos_of_one_exposure_stay_as_they_are(views: int) -> None:
    scene = trace(views, HEIGHT, WIDTH)
    for found in both(scene.images, views):
        assert float((found - torch.from_numpy(scene.images)).abs().max()) < 2e-3


@pytest.mark.parametrize("gain", [(0.7, 0.7, 0.7), (0.6, 0.8, 0.7), (1.0, 1.0, 0.6)])
def test_a_darker_photo_takes_the_first_ones_exposure(gain: tuple[float, float, float]) -> None:
    scene = trace(3, HEIGHT, WIDTH)
    altered = scene.images.copy()
    altered[1] *= np.float32(gain)
    found = both(altered, 3)[1]
    before = np.abs(altered - scene.images).mean(axis=(1, 2, 3))
    after = (found - torch.from_numpy(scene.images)).abs().mean(dim=(1, 2, 3))
    assert float(after[0]) < 1e-6  # the first photo leads
    assert float(after[1]) < 0.15 * before[1] and float(after[2]) < 0.01


def test_photos_to_match_with_have_one_exposure_to_a_percent_where_those_to_show_keep_theirs() -> None:
    scene = trace(5, HEIGHT, WIDTH)
    altered = scene.images * np.float32([1.0, 0.95, 0.9, 0.85, 0.8])[:, None, None, None]
    matched, shown = both(altered, 5)
    assert float((matched - torch.from_numpy(scene.images)).abs().mean()) < 0.01
    assert float((shown - torch.from_numpy(altered)).abs().mean()) < 0.01
