"""The convolutional feature extractor that both official networks share (after GMFlow, Xu et al. 2022).

Every norm is an InstanceNorm without affine parameters or running statistics, so norms own no tensors.
Facts: MVSplat and DepthSplat checkpoints; docs/MODELS.md, "MVSplat and DepthSplat".
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)


def normalize_images(images: Tensor) -> Tensor:
    """Images (…, 3, H, W) in [0, 1] to ImageNet's zero mean and unit variance, as every backbone here takes them."""
    mean = torch.tensor(IMAGENET_MEAN, dtype=images.dtype, device=images.device)[:, None, None]
    std = torch.tensor(IMAGENET_STD, dtype=images.dtype, device=images.device)[:, None, None]
    return (images - mean) / std


def _conv3x3(inputs: int, outputs: int, stride: int = 1) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, stride, padding=1, bias=False)


class ResidualBlock(nn.Module):
    """relu(shortcut(x) + y), y = relu(IN(conv(relu(IN(conv(x)))))); the second ReLU comes before the sum."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv1 = _conv3x3(inputs, outputs, stride)
        self.conv2 = _conv3x3(outputs, outputs)
        changes = stride != 1 or inputs != outputs
        self.downsample = nn.Sequential(nn.Conv2d(inputs, outputs, 1, stride)) if changes else None

    def forward(self, x: Tensor) -> Tensor:
        """(N, inputs, h, w) to (N, outputs, h / stride, w / stride)."""
        y = functional.relu(functional.instance_norm(self.conv1(x)))
        y = functional.relu(functional.instance_norm(self.conv2(y)))
        shortcut = x if self.downsample is None else functional.instance_norm(self.downsample(x))
        return functional.relu(shortcut + y)


class FeatureCNN(nn.Module):
    """7×7 stem at half resolution, three stages of two residual blocks, 1×1 output.

    Args:
        strides: of the first block of stages 1, 2 and 3. (1, 2, 1) is MVSplat, (1, 1, 2) DepthSplat with lowest
            resolution 1/4, (1, 2, 2) DepthSplat with lowest resolution 1/8.
    """

    WIDTHS = (64, 96, 128)

    def __init__(self, strides: tuple[int, int, int]) -> None:
        super().__init__()
        widths = (64, *self.WIDTHS)
        self.conv1 = nn.Conv2d(3, 64, 7, stride=2, padding=3, bias=False)
        self.layer1, self.layer2, self.layer3 = (
            nn.Sequential(
                ResidualBlock(widths[stage], widths[stage + 1], strides[stage]),
                ResidualBlock(widths[stage + 1], widths[stage + 1], 1),
            )
            for stage in range(3)
        )
        self.conv2 = nn.Conv2d(128, 128, 1)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Normalised images (N, 3, H, W) to maps of 64, 96 and 128 channels, finest first."""
        x = functional.relu(functional.instance_norm(self.conv1(images)))
        fine = self.layer1(x)
        middle = self.layer2(fine)
        return fine, middle, self.conv2(self.layer3(middle))
