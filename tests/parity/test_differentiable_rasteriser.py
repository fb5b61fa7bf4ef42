"""The differentiable rasteriser draws what the runtime's does, and its gradients are those of what it draws."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scenes import make_cameras, make_gaussians
from torch import Tensor

from tinysplat.rasteriser import PinholeCamera
from tinysplat.rasteriser.compositing import composite
from tinysplat.rasteriser.projection import NEAR_PLANE, project
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.sh import C0
from tinysplat_runtime.render import render
from tinysplat_runtime.scene.cameras import Camera

BACKENDS = ("numba", "torch")
NAMES = ("means", "quats", "scales", "opacities", "colours")


def pinhole(camera: Camera, dtype: torch.dtype = torch.float32) -> PinholeCamera:
    K, c2w = (torch.from_numpy(np.array(array)).to(dtype) for array in (camera.K, camera.c2w))
    return PinholeCamera(K, c2w, camera.height, camera.width)


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


def draw(fields: dict[str, Tensor], camera: PinholeCamera, backend: str) -> tuple[Tensor, Tensor]:
    means, quats, scales, opacities, colours = (fields[name] for name in NAMES)
    return composite(project(means, quats, scales, camera), opacities, colours, camera, backend)


def assert_draws_as_the_runtime(fields: dict[str, Tensor], camera: Camera, backend: str) -> None:
    image, left = draw(fields, pinhole(camera), backend)
    means, quats, scales, opacities, colours = (fields[name].numpy() for name in NAMES)
    gaussians = Gaussians(means, quats, scales, opacities, ((colours - 0.5) / C0)[:, None])
    want = render(gaussians, camera, outputs=("rgb", "alpha"))
    for found, expected in ((image.numpy(), want["rgb"]), (1 - left.numpy(), want["alpha"])):
        error = np.abs(found - expected)
        assert np.mean(error > 1e-4) <= 1e-3 and error.max() <= 1 / 255 + 1e-4  # where rounding decides a threshold


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("size", "scale"), [((48, 64), 0.08), ((37, 50), 0.6), ((40, 40), 0.004)])
def test_pictures_are_those_of_the_runtime(backend: str, size: tuple[int, int], scale: float) -> None:
    height, width = size
    camera = Camera([[60, 1.5, width / 2 + 3], [0, 55, height / 2 - 2], [0, 0, 1]], np.eye(4), width, height)
    assert_draws_as_the_runtime(cloud(800, size=scale), camera, backend)


@pytest.mark.parametrize("backend", BACKENDS)
def test_pictures_of_pixel_grids_seen_from_the_side_are_those_of_the_runtime(backend: str) -> None:
    views = make_gaussians(2, 24, 32, degree=0)
    fields = {name: torch.from_numpy(np.array(getattr(views, name)).reshape(24 * 32 * 2, -1)) for name in NAMES[:3]}
    fields["quats"] = torch.nn.functional.normalize(fields["quats"], dim=1)
    fields["opacities"] = torch.from_numpy(np.array(views.opacities).reshape(-1))
    fields["colours"] = torch.from_numpy((0.5 + C0 * views.sh).reshape(-1, 3).clip(0))
    assert_draws_as_the_runtime(fields, make_cameras(3, 30, 40)[0], backend)


def test_what_stands_before_the_near_plane_is_not_drawn() -> None:
    fields = cloud(50)
    fields["means"][:, 2] = 0.5 * NEAR_PLANE
    camera = Camera([[16, 0, 8], [0, 16, 8], [0, 0, 1]], np.eye(4), 16, 16)
    image, left = draw(fields, pinhole(camera), "numba")
    assert float(image.abs().max()) == 0 and float(left.min()) == 1


def gradients(fields: dict[str, Tensor], camera: PinholeCamera, backend: str) -> dict[str, Tensor]:
    """Gradients of a random linear functional of picture and transmittance."""
    leaves = {name: value.clone().requires_grad_() for name, value in fields.items()}
    image, left = draw(leaves, camera, backend)
    generator = torch.Generator().manual_seed(1)
    weight = torch.randn(*left.shape, 4, generator=generator).to(image.dtype)
    ((image * weight[..., :3]).sum() + (left * weight[..., 3]).sum()).backward()
    return {name: leaf.grad for name, leaf in leaves.items() if leaf.grad is not None}


def test_gradients_are_those_of_finite_differences() -> None:
    # A footprint ends where alpha falls under 1/255, and alpha is cut at 0.99: there the picture jumps or bends. With
    # opacities around a half and float64 steps this small, no sample of this cloud stands on such a place.
    camera = pinhole(make_cameras(2, 14, 16)[0], torch.float64)
    fields = {name: value.double() for name, value in cloud(12, size=0.25).items()}
    fields["opacities"] = 0.3 + 0.4 * fields["opacities"]
    found = gradients(fields, camera, "torch")
    generator = torch.Generator().manual_seed(1)
    weight = torch.randn(14, 16, 4, generator=generator).double()
    step = 1e-7
    for name in NAMES:
        for k in range(0, fields[name].numel(), 5):
            values = []
            for sign in (1, -1):
                moved = {**fields, name: fields[name].clone()}
                moved[name].view(-1)[k] += sign * step
                image, left = draw(moved, camera, "torch")
                values.append(float((image * weight[..., :3]).sum() + (left * weight[..., 3]).sum()))
            expected = (values[0] - values[1]) / (2 * step)
            assert float(found[name].view(-1)[k]) == pytest.approx(expected, rel=1e-4, abs=1e-5), (name, k)


@pytest.mark.parametrize("size", [0.03, 0.3])
def test_compiled_gradients_are_those_of_torch(size: float) -> None:
    camera = pinhole(make_cameras(2, 40, 48)[0])
    fields = cloud(600, seed=2, size=size)
    found, expected = (gradients(fields, camera, backend) for backend in BACKENDS)
    for name in NAMES:
        scale = float(expected[name].abs().max())
        assert scale > 0
        torch.testing.assert_close(found[name], expected[name], rtol=1e-3, atol=1e-4 * scale)


def test_training_on_a_picture_finds_the_colours_that_made_it() -> None:
    camera = pinhole(make_cameras(2, 24, 32)[0])
    fields = cloud(60, seed=3, size=0.2)
    target, _ = draw(fields, camera, "numba")
    colours = torch.full_like(fields["colours"], 0.5).requires_grad_()
    optimiser = torch.optim.Adam([colours], lr=0.05)
    errors = []
    for _ in range(60):
        image, _ = draw({**fields, "colours": colours}, camera, "numba")
        loss = (image - target).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        errors.append(float(loss.detach()))
    assert errors[-1] < 0.01 * errors[0]
