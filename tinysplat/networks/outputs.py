"""What the batched networks return: one Gaussian per pixel of every view, in the project's conventions."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from .algebra import quats_to_matrices


@dataclass(frozen=True)
class PixelGaussians:
    """Gaussians of B scenes with V views of H × W pixels; float32, world frame, scene units.

    Attributes:
        means: (B, V, H, W, 3) centres.
        quats: (B, V, H, W, 4) unit rotations, wxyz.
        scales: (B, V, H, W, 3) standard deviations along the local axes.
        opacities: (B, V, H, W) in [0, 1].
        sh: (B, V, H, W, S, 3) coefficients of the standard 3DGS basis.
        depth: (B, V, H, W) z in the camera frame of the own view.
    """

    means: Tensor
    quats: Tensor
    scales: Tensor
    opacities: Tensor
    sh: Tensor
    depth: Tensor

    def covariances(self) -> Tensor:
        """Σ = R diag(s)² Rᵀ, (B, V, H, W, 3, 3), scene units squared (Kerbl et al. 2023, eq. 6)."""
        half = quats_to_matrices(self.quats) * self.scales[..., None, :]
        return half @ half.transpose(-1, -2)
