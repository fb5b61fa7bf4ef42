"""Official networks with deterministic weights, and every tensor that the fixtures hold, by the fixtures' names.

Intermediate tensors are read with hooks, so the networks carry nothing for the tests' sake.
"""

import json
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from tinysplat.networks import DepthSplat, MVSplat, build
from tinysplat.networks.adapter import PixelGaussians
from tinysplat_runtime.gaussian.quaternions import conjugate_quats, matrices_to_quats, multiply_quats

from .check_golden import load_fixture
from .det_weights import det_state_dict

FOLDER = Path(__file__).parent
MAPPING = json.loads((FOLDER / "sh_mapping.json").read_text())


def manifest(model: str) -> dict[str, list[int]]:
    """Shapes by tensor name of an official checkpoint, such as `depthsplat_base_dl3dv`, without its prefix."""
    entries = json.loads((FOLDER / "manifests" / f"{model}.json").read_text())["tensors"]
    return {name: entry["shape"] for name, entry in entries.items()}


def network_name(model: str) -> tuple[str, str]:
    """`depthsplat_base_dl3dv` to ("depthsplat-base", "dl3dv")."""
    *name, variant = model.split("_")
    return "-".join(name), variant


def deterministic_state(model: str) -> dict[str, Tensor]:
    """The state dict that the fixtures were made with."""
    return {name: torch.from_numpy(array) for name, array in det_state_dict(manifest(model)).items()}


def deterministic_network(model: str, **options: Any) -> MVSplat | DepthSplat:
    """An official network with the fixtures' weights."""
    network = build(*network_name(model), **options)
    network.load_state_dict(deterministic_state(model), strict=True)
    return network.requires_grad_(False)


def network_inputs(arrays: dict[str, NDArray]) -> list[Tensor]:
    """A fixture's inputs in the order of `forward`."""
    return [torch.from_numpy(arrays[name]) for name in ("image", "intrinsics", "extrinsics", "near", "far")]


@lru_cache(maxsize=1)
def run_fixture(fixture: str) -> dict[str, NDArray]:
    """Everything that a fixture compares, computed here."""
    inputs, _, meta = load_fixture(FOLDER / "golden" / f"{fixture}.npz")
    options = {"sh_degree": 4} if meta["model"].startswith("mvsplat") else {}
    if "march2025" in fixture:
        options["scale_rule"] = "2025-03"
    network = deterministic_network(meta["model"], **options)
    found = probe_mvsplat(network) if isinstance(network, MVSplat) else probe_depthsplat(network)
    tensors = network_inputs(inputs)
    gaussians = network(*tensors)
    probes = {f"mid/{name}": value.numpy() for name, value in found.items()}
    return {**probes, **outputs_as_official(gaussians, inputs, along_ray=isinstance(network, MVSplat))}


def outputs_as_official(gaussians: PixelGaussians, inputs: dict[str, NDArray], along_ray: bool) -> dict[str, NDArray]:
    """Outputs brought back to the official conventions, N = V·H·W."""
    c2w = inputs["extrinsics"]
    means, sh = gaussians.means.numpy(), gaussians.sh.numpy()
    length = np.linalg.norm(means - c2w[:, :, None, None, :3, 3], axis=-1)
    cameras = matrices_to_quats(c2w[..., :3, :3].astype(np.float64))[:, :, None, None]
    local = multiply_quats(conjugate_quats(cameras), gaussians.quats.numpy())
    kind = "deg4_consistent" if sh.shape[-2] == 25 else "deg2_exact"
    to_official = np.linalg.inv(np.array(MAPPING[f"official_to_standard_{kind}"]))
    harmonics = np.einsum("kj,bvhwjc->bvhwck", to_official, sh)

    def flat(array: NDArray) -> NDArray:
        return array.reshape(array.shape[0], -1, *array.shape[4:])

    return {
        "out/depth": length if along_ray else gaussians.depth.numpy(),
        "out/means": flat(means),
        "out/covariances": flat(gaussians.covariances().numpy()),
        "out/harmonics": flat(harmonics),
        "out/opacities": flat(gaussians.opacities.numpy()),
        "out/scales": flat(gaussians.scales.numpy()),
        "out/rotations_xyzw_cam": flat(np.roll(local, -1, axis=-1)),
    }


def _on_output(module: nn.Module, found: dict[str, Tensor], name: str, pick: Callable[[Any], Tensor]) -> None:
    module.register_forward_hook(lambda _module, _inputs, output: found.__setitem__(name, pick(output)))


def _on_input(module: nn.Module, found: dict[str, Tensor], name: str, pick: Callable[..., Tensor]) -> None:
    module.register_forward_pre_hook(lambda _module, inputs: found.__setitem__(name, pick(*inputs)))


def probe_mvsplat(network: MVSplat) -> dict[str, Tensor]:
    """Filled with the fixture's intermediate tensors when the network runs."""
    found: dict[str, Tensor] = {}
    predictor = network.depth_predictor
    _on_output(network.backbone.backbone, found, "cnn_features", lambda maps: maps[-1][None])
    _on_output(network.backbone.transformer, found, "transformer_features", lambda x: x[None])
    _on_input(predictor.corr_refine_net, found, "cost_volume_vb", lambda x, _views: x[:, :128])
    _on_input(predictor.refine_unet, found, "coarse_disp_full_vb", lambda x, _views: x[:, 35:36])
    _on_input(predictor.refine_unet, found, "match_prob_full_vb", lambda x, _views: x[:, 36:37])
    for module, name in {
        predictor.corr_refine_net: "corr_refine_out_vb",
        predictor.depth_head_lowres: "depth_logits_vb",
        predictor.proj_feature: "proj_feature_vb",
        predictor.refine_unet: "refine_out_vb",
        predictor.to_disparity: "delta_disp_density_vb",
        predictor.to_gaussians: "raw_gaussians_vb",
    }.items():
        _on_output(module, found, name, lambda x: x)
    return found


def probe_depthsplat(network: DepthSplat) -> dict[str, Tensor]:
    """Filled with the fixture's intermediate tensors when the network runs."""
    found: dict[str, Tensor] = {}
    predictor = network.depth_predictor
    for i in range(3):
        _on_output(predictor.backbone, found, f"cnn_features_{i}_low_to_high", lambda maps, i=i: maps[2 - i])
    for i in range(4):
        _on_input(predictor.upsampler, found, f"mono_intermediate_{i}", lambda mono, _maps, i=i: mono[i])
    for scale in range(network.config.scales):
        _probe_matching(network, scale, found)
    for module, name in {
        predictor.upsampler: "residual_disp",
        network.feature_upsampler: "feature_upsampler",
        network.gaussian_regressor: "gaussian_regressor",
        network.gaussian_head: "raw_gaussians",
    }.items():
        _on_output(module, found, name, lambda x: x)
    return found


def _probe_matching(network: DepthSplat, scale: int, found: dict[str, Tensor]) -> None:
    predictor = network.depth_predictor
    mono = network.depth_predictor.pretrained.size.channels >> scale
    parts = {
        "cost_volume": (128, 32)[scale],
        "cnn": (128, 96)[scale],
        "mv_features": 128 >> scale,
        "mono_features": mono,
    }
    start = 0
    for name, channels in parts.items():
        if name != "cnn":
            _on_input(
                predictor.regressor[scale],
                found,
                f"{name}_scale{scale}",
                lambda x, _views, start=start, channels=channels: x[:, start : start + channels],
            )
        start += channels
    _on_output(predictor.regressor[scale], found, f"regressor_out_scale{scale}", lambda x: x)
    _on_output(predictor.depth_head[scale], found, f"depth_logits_scale{scale}", lambda x: x)
    _on_output(predictor.depth_head[scale], found, f"match_prob_scale{scale}", lambda x: x.softmax(dim=1))
