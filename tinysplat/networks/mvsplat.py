"""MVSplat (Chen et al., ECCV 2024): multi-view features, plane sweep, depth refinement, one Gaussian per pixel.

Module names are those of the official checkpoints, so that these load with `strict=True`. What the network predicts
as depth is a distance along the unit ray, although its cost volume treats the same number as z; the output has z.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from .adapter import PixelGaussians, offset_rays, place_means, relative_scales, world_quats
from .cnn import FeatureCNN, normalize_images
from .cost_volume import all_others, inverse_depth_candidates, match_scores
from .geometry import pixel_intrinsics
from .harmonics import RENDERED_DEGREE, HarmonicsToWorld
from .transformer import MultiViewTransformer
from .unet import GROUPS, RefinementNet, UNet

FEATURES = 128
CANDIDATES = 128
REFINED = 32
SH_DEGREE = 4  # of the raw channels
REDUCTION = 4  # image size over feature size


def upsample(x: Tensor) -> Tensor:
    """Features (V, C, h, w) to image size, bilinear with corners aligned."""
    return functional.interpolate(x, scale_factor=REDUCTION, mode="bilinear", align_corners=True)


def _conv(inputs: int, outputs: int, size: int = 3) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, size, padding=size // 2)


class Backbone(nn.Module):
    """CNN and multi-view transformer."""

    def __init__(self) -> None:
        super().__init__()
        self.backbone = FeatureCNN(strides=(1, 2, 1))
        self.transformer = MultiViewTransformer(FEATURES)

    def forward(self, images: Tensor, others: Tensor) -> tuple[Tensor, Tensor]:
        """Images (B·V, 3, H, W) in [0, 1] to transformer and CNN features, both (B·V, 128, H/4, W/4)."""
        features = self.backbone(normalize_images(images))[-1]
        return self.transformer(features, others), features


class GaussianHead(nn.Sequential):
    """Raw channels of a Gaussian: offset (2), scale (3), quaternion xyzw (4), SH by colour (3 n).

    Args:
        inputs: channels that come in.
        sh_degree: coefficients above it are not computed, though the weights have them: n = (sh_degree + 1)².
    """

    GEOMETRY = (2, 3, 4)
    kept: Tensor

    def __init__(self, inputs: int, sh_degree: int) -> None:
        functions, geometry = (SH_DEGREE + 1) ** 2, sum(self.GEOMETRY)
        raw = geometry + 3 * functions
        super().__init__(_conv(inputs, 2 * raw), nn.GELU(), _conv(2 * raw, raw))
        colours = torch.arange(geometry, raw).reshape(3, functions)[:, : (sh_degree + 1) ** 2]
        self.register_buffer("kept", torch.cat([torch.arange(geometry), colours.flatten()]), persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """(N, inputs, H, W) to (N, 9 + 3n, H, W)."""
        weight, bias = (self.get_parameter(f"2.{name}")[self.kept] for name in ("weight", "bias"))
        return functional.conv2d(self[1](self[0](x)), weight, bias, padding=1)


class DepthPredictorMultiView(nn.Module):
    """Plane sweep, its regularisation, and refinement of inverse depth at full resolution, with the Gaussian head."""

    def __init__(self, sh_degree: int) -> None:
        super().__init__()
        self.corr_refine_net = RefinementNet(
            _conv(CANDIDATES + FEATURES, FEATURES),
            nn.GroupNorm(GROUPS, FEATURES),
            nn.GELU(),
            UNet(FEATURES, levels=3, post_norm=True),
            _conv(FEATURES, CANDIDATES),
        )
        self.regressor_residual = _conv(CANDIDATES + FEATURES, CANDIDATES, 1)
        self.depth_head_lowres = nn.Sequential(
            _conv(CANDIDATES, 2 * CANDIDATES), nn.GELU(), _conv(2 * CANDIDATES, CANDIDATES)
        )
        self.upsampler = nn.Sequential(_conv(2 * FEATURES, FEATURES))
        self.proj_feature = _conv(FEATURES, REFINED)
        self.refine_unet = RefinementNet(
            _conv(3 + REFINED + 2, REFINED),
            nn.GroupNorm(4, REFINED),
            nn.GELU(),
            UNet(REFINED, levels=5, post_norm=True),
        )
        self.to_disparity = nn.Sequential(_conv(REFINED, 2 * REFINED), nn.GELU(), _conv(2 * REFINED, 2))
        self.to_gaussians = GaussianHead(REFINED + 3 + FEATURES, sh_degree)

    def coarse(self, scores: Tensor, features: Tensor, candidates: Tensor, views: int) -> tuple[Tensor, Tensor]:
        """Expected inverse depth and the largest probability, both (B·V, 1, H, W).

        Args:
            scores: (B·V, 128, h, w) cost volume.
            features: (B·V, 128, h, w) of the transformer.
            candidates: (B·V, 128, 1, 1) inverse depths.
            views: V.
        """
        x = torch.cat([scores, features], dim=1)
        logits = self.depth_head_lowres(self.corr_refine_net(x, views) + self.regressor_residual(x))
        probabilities = logits.softmax(dim=1)
        disparity = (probabilities * candidates).sum(dim=1, keepdim=True)
        confidence = probabilities.amax(dim=1, keepdim=True)
        return upsample(disparity), functional.interpolate(confidence, scale_factor=REDUCTION, mode="nearest")

    def forward(
        self, images: Tensor, scores: Tensor, features: tuple[Tensor, Tensor], candidates: Tensor, views: int
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Predict inverse depth, opacity and raw Gaussian channels.

        Args:
            images: (B·V, 3, H, W) in [0, 1].
            scores: (B·V, 128, h, w) cost volume.
            features: of transformer and CNN, (B·V, 128, h, w).
            candidates: (B·V, 128, 1, 1) inverse depths, farthest first.
            views: V.

        Returns:
            Inverse depth (B·V, H, W), opacities (B·V, H, W), raw channels of `GaussianHead` (B·V, 9 + 3n, H, W).
        """
        disparity, confidence = self.coarse(scores, features[0], candidates, views)
        fine = functional.gelu(upsample(self.upsampler(torch.cat(features, dim=1))))
        refined = self.refine_unet(torch.cat([images, self.proj_feature(fine), disparity, confidence], dim=1), views)
        delta, density = self.to_disparity(refined).split(1, dim=1)
        disparity = torch.minimum(torch.maximum(disparity + delta, candidates[:, :1]), candidates[:, -1:])
        raw = self.to_gaussians(torch.cat([refined, images, fine], dim=1))
        return disparity[:, 0], density.sigmoid()[:, 0], raw


class MVSplat(nn.Module):
    """The complete network.

    Args:
        sh_degree: of the output. 3 is exact: the official rasterizer never sees degree 4. 4 keeps all coefficients, as
            the paper's d = 75 counts them, in the consistent basis.
    """

    def __init__(self, sh_degree: int = RENDERED_DEGREE) -> None:
        super().__init__()
        self.sh_degree = sh_degree
        self.backbone = Backbone()
        self.depth_predictor = DepthPredictorMultiView(sh_degree)
        self.harmonics = HarmonicsToWorld(sh_degree)

    def forward(self, images: Tensor, K: Tensor, c2w: Tensor, near: Tensor, far: Tensor) -> PixelGaussians:
        """Predict one Gaussian per pixel.

        Args:
            images: (B, V, 3, H, W) in [0, 1], V ≥ 2, H and W multiples of 16.
            K: (B, V, 3, 3) normalised by image size.
            c2w: (B, V, 4, 4) camera to world, rigid.
            near, far: (B, V) depth range, scene units; 1 and 100 for the released weights.
        """
        scenes, views = images.shape[:2]
        flat = images.flatten(0, 1)
        others = all_others(c2w)
        features = self.backbone(flat, others)
        candidates = inverse_depth_candidates(near, far, CANDIDATES).flatten(0, 1)[..., None, None]  # (B·V, 128, 1, 1)
        K_features = pixel_intrinsics(K, *features[0].shape[-2:]).flatten(0, 1)
        scores = match_scores(features[0], K_features, c2w.flatten(0, 1), others, candidates)
        disparity, opacities, raw = self.depth_predictor(flat, scores, features, candidates, views)
        raw = raw.unflatten(0, (scenes, views))
        length = 1 / disparity.unflatten(0, (scenes, views))  # along the ray
        offsets, scales, quats, sh = raw.split([*GaussianHead.GEOMETRY, 3 * (self.sh_degree + 1) ** 2], dim=2)
        rays = offset_rays(K, offsets)
        depth = length / rays.norm(dim=-1)
        return PixelGaussians(
            means=place_means(rays, depth, c2w),
            quats=world_quats(quats, c2w),
            scales=relative_scales(scales, length, K),
            opacities=opacities.unflatten(0, (scenes, views)),
            sh=self.harmonics(sh, c2w[..., :3, :3]),
            depth=depth,
        )
