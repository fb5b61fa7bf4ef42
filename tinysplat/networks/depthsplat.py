"""DepthSplat (Xu et al., CVPR 2025): multi-view matching joined with monocular features, one Gaussian per pixel.

Module names are those of the official checkpoints (architecture of 2025), so that these load with `strict=True`.
Depth is z here, and every batch is B·V with the views of a scene next to each other.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import torch
from torch import Tensor, nn
from torch.nn import functional

from tinysplat_runtime.gaussian.sh import C0

from .adapter import PixelGaussians, absolute_scales, offset_rays, place_means, relative_scales, world_quats
from .cnn import FeatureCNN, normalize_images
from .cost_volume import inverse_depth_candidates, match_scores, nearest_others
from .dinov2 import SIZES, DINOv2, monocular_features, resize
from .dpt import DPTHead, Recipe
from .geometry import pixel_intrinsics
from .harmonics import HarmonicsToWorld
from .transformer import MultiViewTransformer
from .unet import GROUPS, RefinementNet, UNet

Padding: TypeAlias = Literal["zeros", "replicate"]

FEATURES = 128
MONO_REDUCTION = 8
MATCHED_VIEWS = 2
"""From four views on, each is matched with its two nearest neighbours only."""

CANDIDATES = (128, 32)
"""Inverse depths per pixel at the coarse scale, over the whole range, and at the fine one, around its result."""

FINE_REACH = (16, 15)
"""Half-steps of the coarse scale that the fine candidates reach below and above."""

SH_DEGREE = 2
HEAD_CHANNELS = (1, 2, 3, 4, 3 * (SH_DEGREE + 1) ** 2)
"""Opacity, offset, scale, quaternion xyzw, SH by colour."""

DPT_WIDTHS = {"S": (48, 96, 192, 384), "B": (96, 192, 384, 768), "L": (128, 256, 512, 1024)}
DPT_FEATURES = {"S": (32, 64), "B": (48, 96), "L": (64, 128)}
"""Channels of the fused map of the depth upsampler and of the feature upsampler."""

SCALE_RULES = ("2025-03", "2025-04")


@dataclass(frozen=True)
class DepthSplatConfig:
    """What distinguishes the released models.

    Attributes:
        vit: size of the monocular backbone, "S", "B" or "L".
        scales: 1, or 2 with a second plane sweep at twice the resolution.
        upsample_factor: image size over the finest matching resolution.
    """

    vit: str
    scales: int
    upsample_factor: int

    @property
    def lowest(self) -> int:
        """Image size over the coarsest feature size."""
        return self.upsample_factor * 2 ** (self.scales - 1)

    @property
    def recipe(self) -> Recipe:
        """Where the maps of the matching branch enter the DPT heads; mv0 is the coarse scale."""
        return {
            (4, 1): (("cnn0", "cnn1", "mono"), ("cnn2", "mono", "mv0", "disparity"), ("mono",)),
            (2, 2): (("cnn0", "cnn1", "mv1", "disparity", "mono"), ("cnn2", "mono", "mv0"), ("mono",)),
            (4, 2): (("cnn0", "mono"), ("cnn1", "mono", "mv1", "disparity"), ("cnn2", "mono", "mv0")),
            (8, 1): (("cnn0", "mono"), ("cnn1", "mono"), ("cnn2", "mono", "mv0", "disparity")),
        }[self.upsample_factor, self.scales]


def _conv(inputs: int, outputs: int, padding_mode: Padding = "zeros") -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, padding=1, padding_mode=padding_mode)


def _head(inputs: int, hidden: int, outputs: int, padding_mode: Padding = "zeros") -> nn.Sequential:
    return nn.Sequential(_conv(inputs, hidden, padding_mode), nn.GELU(), _conv(hidden, outputs, padding_mode))


def _dpt(config: DepthSplatConfig, has_disparity: bool) -> DPTHead:
    names = tuple(tuple(n for n in level if has_disparity or n != "disparity") for level in config.recipe)
    channels = {"cnn0": 64, "cnn1": 96, "cnn2": 128, "mv0": FEATURES, "mv1": FEATURES // 2, "disparity": 1}
    features = DPT_FEATURES[config.vit][0 if has_disparity else 1]
    inputs, widths = SIZES[config.vit].channels, DPT_WIDTHS[config.vit]
    return DPTHead(inputs, widths, features, (names[0], names[1], names[2]), channels, has_output=has_disparity)


class FeaturePyramid(nn.Module):
    """Features at their own and at twice their resolution, with half the channels."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        half = channels // 2
        up = nn.Sequential(nn.ConvTranspose2d(channels, half, 2, stride=2), nn.GELU(), _conv(half, half))
        self.stages = nn.ModuleList([nn.Identity(), up])

    def forward(self, x: Tensor) -> list[Tensor]:
        """(N, C, h, w) to (N, C, h, w) and (N, C/2, 2h, 2w)."""
        return [stage(x) for stage in self.stages]


@dataclass(frozen=True)
class Features:
    """Maps of all views, (B·V, C, h, w).

    Attributes:
        cnn: finest first.
        mv: transformer features per scale, coarse first.
        mono: four maps of the monocular backbone at 1/8.
        matched_mono: monocular features per scale, for matching.
    """

    cnn: tuple[Tensor, Tensor, Tensor]
    mv: list[Tensor]
    mono: list[Tensor]
    matched_mono: list[Tensor]

    def named(self) -> dict[str, Tensor]:
        """Features (V, C, h, w) by the names of the DPT recipes."""
        return {f"cnn{i}": x for i, x in enumerate(self.cnn)} | {f"mv{i}": x for i, x in enumerate(self.mv)}


@dataclass(frozen=True)
class SweepViews:
    """Cameras of B scenes for plane sweeps.

    Attributes:
        K: (B, V, 3, 3) normalised by image size.
        c2w: (B, V, 4, 4).
        near, far: (B, V).
        others: (B·V, M) views that each view is swept against.
    """

    K: Tensor
    c2w: Tensor
    near: Tensor
    far: Tensor
    others: Tensor

    def limits(self) -> tuple[Tensor, Tensor]:
        """Smallest and largest inverse depth, each (B·V, 1, 1, 1)."""
        return (1 / self.far).reshape(-1, 1, 1, 1), (1 / self.near).reshape(-1, 1, 1, 1)


class DepthPredictor(nn.Module):
    """Features, one or two plane sweeps with regularisation, and the depth upsampler."""

    def __init__(self, config: DepthSplatConfig) -> None:
        super().__init__()
        self.config = config
        vit = SIZES[config.vit]
        self.backbone = FeatureCNN(strides=(1, 1, 2) if config.lowest == 4 else (1, 2, 2))
        self.transformer = MultiViewTransformer(FEATURES)
        self.pretrained = DINOv2(vit)
        self.regressor, self.regressor_residual, self.depth_head = nn.ModuleList(), nn.ModuleList(), nn.ModuleList()
        if config.scales == 2:
            self.mv_pyramid, self.mono_pyramid = FeaturePyramid(FEATURES), FeaturePyramid(vit.channels)
        for scale in range(config.scales):
            width, candidates = FEATURES >> scale, CANDIDATES[scale]
            inputs = candidates + FeatureCNN.WIDTHS[2 - scale] + width + (vit.channels >> scale)
            unet = UNet(width, levels=3 + scale, post_norm=False)
            self.regressor.append(
                RefinementNet(_conv(inputs, width), nn.GroupNorm(GROUPS, width), nn.GELU(), unet, _conv(width, width))
            )
            self.regressor_residual.append(nn.Conv2d(inputs, width, 1))
            self.depth_head.append(_head(width, 2 * width, candidates, "replicate"))
        self.upsampler = _dpt(config, has_disparity=True)

    def features(self, images: Tensor, others: Tensor) -> Features:
        """Of images (B·V, 3, H, W) in [0, 1]."""
        normalized = normalize_images(images)
        cnn = self.backbone(normalized)
        mv = self.transformer(cnn[-1], others)
        mono = monocular_features(self.pretrained, normalized, MONO_REDUCTION)
        matched = mono[-1] if self.config.lowest == MONO_REDUCTION else resize(mono[-1], mv.shape[-2:])
        if self.config.scales == 1:
            return Features(cnn, [mv], mono, [matched])
        return Features(cnn, self.mv_pyramid(mv), mono, self.mono_pyramid(matched))

    def candidates(self, sweep: SweepViews, coarse: Tensor | None) -> Tensor:
        """Inverse depths: (B·V, 128, 1, 1) over the range, or (B·V, 32, 2h, 2w) around a coarse (B·V, 1, h, w)."""
        if coarse is None:
            return inverse_depth_candidates(sweep.near, sweep.far, CANDIDATES[0]).flatten(0, 1)[..., None, None]
        lowest, highest = sweep.limits()
        middle = functional.interpolate(coarse, scale_factor=2, mode="bilinear", align_corners=True)
        half_step = (highest - lowest) / (CANDIDATES[0] - 1) / 2
        start = torch.maximum(middle - FINE_REACH[0] * half_step, lowest)
        end = torch.minimum(middle + FINE_REACH[1] * half_step, highest)
        t = torch.linspace(0, 1, CANDIDATES[1], dtype=middle.dtype, device=middle.device)
        return start + t[:, None, None] * (end - start)

    def match(self, scale: int, features: Features, sweep: SweepViews, coarse: Tensor | None) -> tuple[Tensor, Tensor]:
        """One plane sweep: expected inverse depth (B·V, 1, h, w) and the candidates' probabilities (B·V, D, h, w)."""
        candidates = self.candidates(sweep, coarse)
        mv = features.mv[scale]
        K = pixel_intrinsics(sweep.K, *mv.shape[-2:]).flatten(0, 1)
        scores = match_scores(mv, K, sweep.c2w.flatten(0, 1), sweep.others, candidates)
        x = torch.cat([scores, features.cnn[2 - scale], mv, features.matched_mono[scale]], dim=1)
        refined = self.regressor[scale](x, sweep.near.shape[1]) + self.regressor_residual[scale](x)
        probabilities = self.depth_head[scale](refined).softmax(dim=1)
        return (probabilities * candidates).sum(dim=1, keepdim=True), probabilities

    def forward(self, images: Tensor, sweep: SweepViews) -> tuple[Tensor, Tensor, Features]:
        """Predict depth.

        Args:
            images: (B·V, 3, H, W) in [0, 1].
            sweep: the cameras.

        Returns:
            Depth (B·V, 1, H, W), largest match probability (B·V, 1, H, W), features.
        """
        features = self.features(images, sweep.others)
        disparity, probabilities = self.match(0, features, sweep, None)
        if self.config.scales == 2:
            disparity, probabilities = self.match(1, features, sweep, disparity)
        residual = self.upsampler(features.mono, {**features.named(), "disparity": disparity})
        lowest, highest = sweep.limits()
        full = resize(disparity, images.shape[-2:]) + residual
        depth = 1 / torch.minimum(torch.maximum(full, lowest), highest)
        confidence = probabilities.amax(dim=1, keepdim=True)
        confidence = functional.interpolate(confidence, scale_factor=self.config.upsample_factor, mode="nearest")
        return depth, confidence, features


class DepthSplat(nn.Module):
    """The complete network.

    Args:
        config: which of the released models.
        scale_rule: "2025-04" for checkpoints of April 2025, whose scales are in scene units; "2025-03" for those of
            March, whose scales are relative to the pixel's footprint. Their tensors look alike.
    """

    def __init__(self, config: DepthSplatConfig, scale_rule: str = "2025-04") -> None:
        super().__init__()
        self.config, self.scale_rule = config, scale_rule
        self.depth_predictor = DepthPredictor(config)
        self.feature_upsampler = _dpt(config, has_disparity=False)
        features = DPT_FEATURES[config.vit][1]
        channels = sum(HEAD_CHANNELS)
        self.gaussian_regressor = _head(3 + 1 + 1 + features, 64, 64)
        self.gaussian_head = _head(64 + 3 + features + 1, channels, channels, "replicate")
        self.harmonics = HarmonicsToWorld(SH_DEGREE)

    def forward(self, images: Tensor, K: Tensor, c2w: Tensor, near: Tensor, far: Tensor) -> PixelGaussians:
        """Predict one Gaussian per pixel.

        Args:
            images: (B, V, 3, H, W) in [0, 1], V ≥ 2, H and W multiples of 4 times the lowest resolution.
            K: (B, V, 3, 3) normalised by image size.
            c2w: (B, V, 4, 4) camera to world, rigid.
            near, far: (B, V) depth range, scene units; docs/MODELS.md has those of the released weights.
        """
        scenes, views = images.shape[:2]
        others = nearest_others(c2w, MATCHED_VIEWS)
        flat = images.flatten(0, 1)
        depth, confidence, features = self.depth_predictor(flat, SweepViews(K, c2w, near, far, others))
        fused = self.feature_upsampler(features.mono, features.named())
        regressed = self.gaussian_regressor(torch.cat([flat, depth, confidence, fused], dim=1))
        raw = self.gaussian_head(torch.cat([regressed, flat, fused, confidence], dim=1)).unflatten(0, (scenes, views))
        return self.gaussians(raw, images, depth[:, 0].unflatten(0, (scenes, views)), K, c2w)

    def gaussians(self, raw: Tensor, images: Tensor, depth: Tensor, K: Tensor, c2w: Tensor) -> PixelGaussians:
        """Raw channels (B, V, 37, H, W) at depth (B, V, H, W) to Gaussians; colour is a residual to the image's."""
        opacities, offsets, scales, quats, sh = raw.split(HEAD_CHANNELS, dim=2)
        sh = self.harmonics(sh, c2w[..., :3, :3])
        flat_colour = ((images - 0.5) / C0).permute(0, 1, 3, 4, 2)[..., None, :]
        return PixelGaussians(
            means=place_means(offset_rays(K, offsets), depth, c2w),
            quats=world_quats(quats, c2w),
            scales=absolute_scales(scales) if self.scale_rule == "2025-04" else relative_scales(scales, depth, K),
            opacities=opacities.sigmoid()[:, :, 0],
            sh=torch.cat([sh[..., :1, :] + flat_colour, sh[..., 1:, :]], dim=-2),
            depth=depth,
        )
