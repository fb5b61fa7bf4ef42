"""Steps down a gradient are those of torch's Adam."""

from __future__ import annotations

import numpy as np
import torch

from tinysplat_runtime.list.training import kernels


def test_steps_are_those_of_torchs_adam_and_end_at_the_limits() -> None:
    rng = np.random.default_rng(3)
    values, first, second = rng.normal(size=40).astype(np.float32), *np.zeros((2, 40), np.float32)
    leaf = torch.tensor(values, requires_grad=True)
    optimiser = torch.optim.Adam([leaf], lr=0.05, betas=(0.9, 0.99), eps=2e-3)
    for count in range(1, 6):
        gradient = rng.normal(size=40).astype(np.float32)
        kernels.adam(values, gradient, first, second, (0.05, 0.9, 0.99, 2e-3, float(count), -9.0, 9.0))
        leaf.grad = torch.tensor(gradient)
        optimiser.step()
    np.testing.assert_allclose(values, leaf.detach().numpy(), atol=1e-6)
    outside = np.array([-3.0, 0.0, 3.0], np.float32)
    for slope, wanted in ((1, [-3.0, -0.5, 2.5]), (-1, [-2.5, 0.5, 3.0])):
        state = outside.copy()
        kernels.adam(
            state, np.full(3, slope, np.float32), *np.zeros((2, 3), np.float32), (0.5, 0.9, 0.99, 0.0, 1.0, -1.0, 1.0)
        )
        np.testing.assert_allclose(state, wanted, atol=1e-6)
