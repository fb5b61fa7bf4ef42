"""From the official networks' SH coefficients in the camera frame to the standard 3DGS basis in the world.

The networks predict coefficients of e3nn's real harmonics E (polar axis y), rotated to the world by e3nn's D(R), and
their rasterizer evaluates them with its own polynomials O. With S the standard basis of
`tinysplat_runtime.gaussian.sh`:

    E_k(x, y, z) = (−1)^k S_k(z, x, y)      O_k(x, y, z) = S_k(z, x, y), but for one polynomial, see `rendered_basis`

The missing sign between E and O is a property of the released weights: D must come from E, the mapping from O. Both
follow here from the polynomials, as h_std = M D(R) mask h_raw, without Euler angles and so without branches.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from tinysplat_runtime.gaussian.sh import C0, sh_basis, sh_terms

N_DIRECTIONS = 64
"""Points of the spiral that bases are compared on; any set of 25 in general position would do."""

INDEX_14 = 1.445305721320277
"""The rasterizer has INDEX_14 · z (z² − x²) at index 14, where y (z² − x²) would be consistent."""

RENDERED_DEGREE = 3
"""The rasterizer stops here; coefficients of degree 4 never reach an image."""


def spiral_directions() -> NDArray:
    """Unit vectors (N_DIRECTIONS, 3) float64 spread evenly over the sphere on a golden spiral."""
    index = np.arange(N_DIRECTIONS)
    z = 1 - (2 * index + 1) / N_DIRECTIONS
    angle = index * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)


def rendered_basis(directions: NDArray, degree: int) -> NDArray:
    """O of unit vectors (N, 3): factors of the coefficients in the official rasterizer, (N, B) float64.

    For degree 4, which it never evaluates, the consistent polynomials of all degrees.
    """
    basis = sh_basis(directions[:, [2, 0, 1]], degree)
    if degree == RENDERED_DEGREE:
        x, _, z = directions.T
        basis[:, 14] = INDEX_14 * z * (z * z - x * x)
    return basis


def official_to_standard(degree: int) -> NDArray:
    """M (B, B) float64, B = (degree + 1)², with h_std = M h_official: the same colour in every direction.

    Exact up to degree 3; for degree 4 exact as a change between the consistent bases.
    """
    directions = spiral_directions()
    solved = np.linalg.lstsq(sh_basis(directions, degree), rendered_basis(directions, degree), rcond=None)[0]
    return np.where(np.abs(solved) < 1e-12, 0.0, solved)


def coefficient_mask(degree: int) -> NDArray:
    """Factors (B,) float64 on the raw coefficients, 1 at degree 0 and 0.1 · 0.25^l above; B = (degree + 1)²."""
    degrees = np.concatenate([np.full(2 * l + 1, l) for l in range(degree + 1)])  # noqa: E741
    return np.where(degrees == 0, 1.0, 0.1 * 0.25**degrees)


class HarmonicsToWorld(nn.Module):
    """Mask, rotation to the world and change to the standard basis as one matrix per view.

    D(R) is found on fixed directions U: E(U Rᵀ) = E(U) D(R)ᵀ, hence D(R)ᵀ = pinv(E(U)) E(U Rᵀ); entries between
    different degrees are 0 and set so.

    Args:
        degree: of the coefficients that come in and go out.
    """

    directions: Tensor
    fit: Tensor
    blocks: Tensor
    signs: Tensor
    mapping: Tensor
    mask: Tensor

    def __init__(self, degree: int) -> None:
        super().__init__()
        self.degree = degree
        directions = spiral_directions()
        functions = (degree + 1) ** 2
        signs = (-1.0) ** np.arange(functions)
        l = np.sqrt(np.arange(functions)).astype(int)  # noqa: E741
        constants = {
            "directions": directions,
            "fit": np.linalg.pinv(sh_basis(directions[:, [2, 0, 1]], degree) * signs),
            "blocks": l[:, None] == l[None],
            "signs": signs,
            "mapping": official_to_standard(degree),
            "mask": coefficient_mask(degree),
        }
        for name, value in constants.items():
            self.register_buffer(name, torch.tensor(value, dtype=torch.float32), persistent=False)

    def matrices(self, rotation: Tensor) -> Tensor:
        """M D(R) mask (…, n, n) for camera-to-world rotations R (…, 3, 3)."""
        turned = self.directions @ rotation.transpose(-1, -2)  # (…, N, 3)
        x, y, z = turned.unbind(-1)
        basis = torch.stack([torch.full_like(x, C0), *sh_terms(z, x, y, self.degree)], dim=-1) * self.signs
        rotation_of_sh = (self.fit @ basis).transpose(-1, -2) * self.blocks  # D(R), (…, n, n)
        return self.mapping @ rotation_of_sh * self.mask

    def forward(self, raw: Tensor, rotation: Tensor) -> Tensor:
        """Raw coefficients (B, V, 3n, H, W), by colour, and rotations (B, V, 3, 3) to sh (B, V, H, W, n, 3).

        One product for the three colours, which also interleaves them: a transpose of the result would cost more.
        """
        world = self.matrices(rotation).transpose(-1, -2)[:, :, None, :, :, None]  # (B, V, 1, n in, n out, 1)
        colours = torch.eye(3, dtype=raw.dtype, device=raw.device)[:, None, None]  # (3 in, 1, 1, 3 out)
        product = raw.flatten(3).transpose(2, 3) @ (world * colours).flatten(2, 3).flatten(3)  # (B, V, HW, 3n)
        return product.unflatten(3, (-1, 3)).unflatten(2, raw.shape[-2:])
