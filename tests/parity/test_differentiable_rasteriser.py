"""The differentiable rasteriser draws what the runtime's does, and its gradients are those of the float64 reference."""

import numpy as np
import pytest
import torch
from reference.rasteriser import render_reference
from scenes import make_cameras
from torch import Tensor

from tinysplat import rasteriser
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.sh import C0
from tinysplat_runtime.render import render
from tinysplat_runtime.render.renderer import NEAR_PLANE
from tinysplat_runtime.scene.cameras import Camera

NAMES = ("means", "quats", "scales", "opacities", "colours")


def cloud(count: int, seed: int = 0, size: float = 0.08) -> dict[str, Tensor]:
    """Gaussians about a point three units before the origin's camera, some of them nearly opaque."""
    generator = torch.Generator().manual_seed(seed)
    normal = torch.randn(count, 10, generator=generator)
    uniform = torch.rand(count, 4, generator=generator)
    return {
        "means": normal[:, :3] * torch.tensor([0.7, 0.5, 0.5]) + torch.tensor([0.0, 0.0, 3.0]),
        "quats": torch.nn.functional.normalize(normal[:, 3:7], dim=1),
        "scales": size * torch.exp(0.5 * normal[:, 7:]),
        "opacities": uniform[:, 0],
        "colours": uniform[:, 1:],
    }


def draw(fields: dict[str, Tensor], camera: Camera) -> tuple[Tensor, Tensor]:
    return rasteriser.render(*(fields[name] for name in NAMES), camera)


def as_gaussians(fields: dict[str, Tensor]) -> Gaussians:
    arrays = {name: fields[name].detach().numpy() for name in NAMES}
    return Gaussians.unchecked(sh=((arrays.pop("colours") - 0.5) / C0)[:, None], **arrays)


def assert_draws_as_the_runtime(fields: dict[str, Tensor], camera: Camera) -> None:
    image, left = draw(fields, camera)
    want = render(as_gaussians(fields), camera, outputs=("rgb", "alpha"))
    for found, expected in ((image.numpy(), want["rgb"]), (1 - left.numpy(), want["alpha"])):
        error = np.abs(found - expected)
        assert np.mean(error > 1e-4) <= 1e-3 and error.max() <= 1 / 255 + 1e-4  # where rounding decides a threshold


@pytest.mark.parametrize(("size", "scale"), [((48, 64), 0.08), ((37, 150), 0.6), ((40, 40), 0.004)])
def test_pictures_are_those_of_the_runtime(size: tuple[int, int], scale: float) -> None:
    height, width = size
    camera = Camera([[60, 1.5, width / 2 + 3], [0, 55, height / 2 - 2], [0, 0, 1]], np.eye(4), width, height)
    assert_draws_as_the_runtime(cloud(800, size=scale), camera)


@pytest.mark.parametrize("hidden", ["before the near plane", "without opacity", "beside the picture"])
def test_what_shows_nowhere_changes_nothing_and_has_no_gradient(hidden: str) -> None:
    fields, camera = cloud(50), Camera([[16, 0, 8], [0, 16, 8], [0, 0, 1]], np.eye(4), 16, 16)
    if hidden == "before the near plane":
        fields["means"][:, 2] = 0.5 * NEAR_PLANE
    elif hidden == "without opacity":
        fields["opacities"][:] = 0
    else:
        fields["means"][:, 0] -= 50
    leaves = {name: value.requires_grad_() for name, value in fields.items()}
    image, left = draw(leaves, camera)
    assert float(image.detach().abs().max()) == 0 and float(left.detach().min()) == 1
    (image.sum() + left.sum()).backward()
    assert all(leaf.grad is not None and not leaf.grad.any() for leaf in leaves.values())


@pytest.mark.parametrize(("count", "size", "picture"), [(12, 0.25, (14, 16)), (300, 0.1, (40, 140))])
def test_gradients_are_finite_differences_of_the_float64_reference(
    count: int, size: float, picture: tuple[int, int]
) -> None:
    """Of a random sum of picture and transmittance, in one tile and in several; at the strongest, and others."""
    camera, rng = make_cameras(2, *picture)[0], np.random.default_rng(1)
    fields = cloud(count, size=size)
    fields["opacities"] = 0.3 + 0.4 * fields["opacities"]  # no alpha at the 0.99 where it bends
    weight = rng.normal(size=(*picture, 4))
    leaves = {name: value.clone().requires_grad_() for name, value in fields.items()}
    unit = torch.nn.functional.normalize(leaves["quats"], dim=1)
    image, left = draw({**leaves, "quats": unit}, camera)
    (torch.cat([image, left[..., None]], dim=2) * torch.from_numpy(weight)).sum().backward()

    def loss(values: dict[str, Tensor]) -> float:
        found = render_reference(as_gaussians(values), camera)
        return float((found["rgb"] * weight[..., :3]).sum() + ((1 - found["alpha"]) * weight[..., 3]).sum())

    exact, step = {name: value.double() for name, value in fields.items()}, 1e-6
    for name in NAMES:
        gradient = leaves[name].grad
        assert gradient is not None
        found = gradient.numpy().ravel()
        for k in {*np.argsort(-np.abs(found))[:3].tolist(), *rng.choice(found.size, 3, replace=False).tolist()}:
            ends = []
            for sign in (step, -step):
                moved = {**exact, name: exact[name].clone()}
                moved[name].view(-1)[k] += sign
                ends.append(loss(moved))
            expected = (ends[0] - ends[1]) / (2 * step)
            assert found[k] == pytest.approx(expected, rel=1e-3, abs=2e-4 * float(np.abs(found).max())), (name, k)
