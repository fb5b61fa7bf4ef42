"""Parts of the official networks against plain statements of what they compute."""

import numpy as np
import pytest
import torch
from scenes import make_cameras
from torch import Tensor
from torch.nn import functional

from tinysplat.networks import build
from tinysplat.networks.cost_volume import MIN_Z, all_others, inverse_depth_candidates, match_scores
from tinysplat.networks.geometry import quats_to_matrices
from tinysplat.networks.harmonics import HarmonicsToWorld, coefficient_mask, rendered_basis
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.sh import sh_basis


def cameras(views: int, spacing: float = 0.2) -> tuple[Tensor, Tensor]:
    """K_unit (V, 3, 3) and c2w (V, 4, 4), float64."""
    made = make_cameras(views, 64, 96, spacing)
    stacked = (np.stack([c.K_unit for c in made]), np.stack([c.c2w for c in made]))
    return torch.from_numpy(stacked[0]), torch.from_numpy(stacked[1])


def scores_by_warping(features: Tensor, K: Tensor, c2w: Tensor, others: Tensor, disparities: Tensor) -> Tensor:
    """The cost volume as it is defined: warp the other view's features for every candidate, then multiply."""
    batch, channels, height, width = features.shape
    row, column = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    pixels = torch.stack([column, row, torch.ones_like(row)]).flatten(1).to(features)
    volume = torch.zeros(batch, disparities.shape[1], height, width, dtype=features.dtype)
    for i in range(batch):
        for j in others[i].tolist():
            pose = torch.linalg.inv(c2w[j]) @ c2w[i]
            for d, disparity in enumerate(disparities[i]):
                points = pose[:3, :3] @ torch.linalg.inv(K[i]) @ pixels / disparity.flatten() + pose[:3, 3:]
                x, y, z = K[i] @ points
                z = z.clamp_min(MIN_Z)
                grid = torch.stack([2 * x / z / (width - 1) - 1, 2 * y / z / (height - 1) - 1], dim=-1)
                warped = functional.grid_sample(features[j : j + 1], grid.view(1, height, width, 2), align_corners=True)
                volume[i, d] += (features[i] * warped[0]).sum(0) / channels**0.5 / others.shape[1]
    return volume


@pytest.mark.parametrize("per_pixel", [False, True])
def test_correlating_before_reading_equals_warping_features(per_pixel: bool) -> None:
    K, c2w = cameras(3)
    K = K * torch.tensor([12.0, 8.0, 1.0], dtype=K.dtype)[:, None]
    features = torch.randn(3, 6, 8, 12, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    candidates = inverse_depth_candidates(torch.tensor([0.3, 0.4, 0.5]).double(), torch.full((3,), 9.0).double(), 5)
    disparities = candidates[..., None, None]
    if per_pixel:
        disparities = disparities * torch.linspace(0.8, 1.2, 96, dtype=torch.float64).view(8, 12)
    others = all_others(c2w[None])
    found = match_scores(features, K, c2w, others, disparities)
    torch.testing.assert_close(found, scores_by_warping(features, K, c2w, others, disparities), atol=1e-10, rtol=0)


def random_rotations(count: int) -> Tensor:
    quats = torch.randn(count, 4, generator=torch.Generator().manual_seed(1))
    return quats_to_matrices(quats / quats.norm(dim=-1, keepdim=True))


@pytest.mark.parametrize("degree", [2, 4])
def test_harmonics_give_the_colour_that_the_official_basis_gives_in_the_camera(degree: int) -> None:
    """E rotates with the scene: Σ E_k(d) (D(R) h)_k = Σ E_k(Rᵀ d) h_k. O differs from E by a sign of its argument."""
    rotation = random_rotations(1)[0]
    functions = (degree + 1) ** 2
    raw = torch.randn(1, 1, 3 * functions, 1, 1, generator=torch.Generator().manual_seed(2))
    sh = HarmonicsToWorld(degree)(raw, rotation[None, None])[0, 0, 0, 0].double().numpy()  # (n, 3)
    directions = np.random.default_rng(0).standard_normal((50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    flip = np.array([-1, 1, -1])  # O_k(x, y, z) = E_k(−x, y, −z)
    in_camera = (directions * flip) @ rotation.double().numpy() * flip
    masked = raw.view(3, functions).double().numpy() * coefficient_mask(degree)
    wanted = rendered_basis(in_camera, degree) @ masked.T
    np.testing.assert_allclose(sh_basis(directions, degree) @ sh, wanted, atol=2e-5)


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        (("splatter-image",), "network"),
        (("mvsplat", "dl3dv"), "network"),
        (("depthsplat-large", "dl3dv"), "network"),
        (("depthsplat-small", "re10k", "2024-10"), "scale_rule"),
        (("mvsplat", "re10k", "2025-04", 2), "sh_degree"),
        (("depthsplat-small", "re10k", "2025-04", 3), "sh_degree"),
    ],
)
def test_networks_that_do_not_exist_are_refused_by_field(arguments: tuple[object, ...], field: str) -> None:
    with pytest.raises(InputError) as caught:
        build(*arguments)  # type: ignore[arg-type]
    assert caught.value.where == field
