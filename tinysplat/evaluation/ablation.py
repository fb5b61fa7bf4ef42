"""What VPT and VABR are worth: the profile `paper` with one of them taken away, and with any number of components.

Every variant takes the real file of the profile `paper` and replaces one part, coded by the same rules: a class's α and
Q_c, the 14-bit window, 12-bit codes through the same encoder. Sizes are those of the real file less the planes that
are replaced, plus the planes that replace them.

    without VPT     x, y, z in the world with depth's α and Q_c in place of depth and offset; world scales and rotations
    without VABR    the first k SH coefficients (degree by degree, red, green, blue), or all, each a plane; one step
                    for all of them, from the one of largest σ, as VABR's components share one
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.analysis import project_layer
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.hevc import EncoderSettings, PlaneDecoder, encode_plane
from tinysplat_runtime.codec.profiles import PAPER, PROFILES, Profile
from tinysplat_runtime.codec.quantise import choose_code_map
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.planes import Channel, PlaneClass
from tinysplat_runtime.graphs.inference import GraphStore

_LEVELS = 1 << 14  # of the paper's integers
_HEVC_STEP_14_BITS = 64.0  # quantiser step in 14-bit codes at QP 4
_GEOMETRY = (PlaneClass.DEPTH, PlaneClass.OFFSET, PlaneClass.SCALE, PlaneClass.ROTATION)


@dataclass(frozen=True, eq=False)
class Variant:
    """A way to code, carried out.

    Attributes:
        gaussians: decoded.
        bytes: of the whole file.
        bytes_by_class: of its planes; `depth` has all of the position where there is no VPT.
    """

    gaussians: Gaussians
    bytes: int
    bytes_by_class: dict[str, int]


def paper_variant(gaussians: Gaussians, qp: float, runtime: Runtime, k: int | None = None) -> Variant:
    """The profile `paper` as it is, or with another number of colour planes.

    Args:
        gaussians: per pixel, with cameras.
        qp: Q_g.
        runtime: codes and decodes.
        k: colour planes; None for the paper's 6.
    """
    data, described = _coded(gaussians, qp, runtime, k)
    return Variant(runtime.decompress(data), len(data), described["bytes_by_class"])


def component_bytes(gaussians: Gaussians, qp: float, runtime: Runtime, k: int) -> list[int]:
    """Bytes of each of VABR's k components of layer 0; empty for SH degree 0, which has none."""
    _, described = _coded(gaussians, qp, runtime, k)
    if described["k"] == 0:
        return []
    planes = [plane for plane in described["planes"] if plane["layer"] == 0 and plane["class"] == "color"]
    return [plane["bytes"] for plane in planes]


def without_vpt(gaussians: Gaussians, qp: float, runtime: Runtime) -> Variant:
    """Geometry in the world's frame, colours and opacities as in the real file."""
    real = paper_variant(gaussians, qp, runtime)
    by_class = {**real.bytes_by_class, **dict.fromkeys((c.label for c in _GEOMETRY), 0)}
    layers = []
    for layer, decoded in zip(gaussians.layers, real.gaussians.layers, strict=True):
        arrays = {
            PlaneClass.DEPTH: layer.means, PlaneClass.SCALE: layer.scales,
            PlaneClass.ROTATION: _aligned_quats(layer.quats),
        }  # fmt: skip
        planes = {}
        for plane_class, array in arrays.items():
            channels = [_paper_channel(plane_class, i, array[..., i], qp) for i in range(array.shape[-1])]
            values, size = code_channels(channels, PROFILES["paper"].encoder, runtime.threads)
            by_class[plane_class.label] += size
            planes[plane_class] = np.stack(values, axis=-1)
        layers.append(
            replace(
                decoded, means=planes[PlaneClass.DEPTH], scales=np.maximum(planes[PlaneClass.SCALE], 0),
                quats=_nonzero(planes[PlaneClass.ROTATION]), extra_layers=(),
            )
        )  # fmt: skip
    return _variant(real, layers, by_class)


def without_vabr(gaussians: Gaussians, qp: float, runtime: Runtime, k: int | None = None) -> Variant:
    """SH coefficients as they are in place of components: the first k of them, or all; geometry as in the real file."""
    real = paper_variant(gaussians, qp, runtime)
    by_class = {**real.bytes_by_class, PlaneClass.COLOR.label: 0}
    layers = []
    for layer, decoded in zip(gaussians.layers, real.gaussians.layers, strict=True):
        flat = layer.sh.reshape(*layer.opacities.shape, -1)  # (V, H, W, d)
        kept = min(k or flat.shape[-1], flat.shape[-1])
        sigma = float(flat[..., :kept].std(axis=(0, 1, 2), dtype=np.float64).max())
        channels = [_paper_channel(PlaneClass.COLOR, i, flat[..., i], qp, sigma) for i in range(kept)]
        values, size = code_channels(channels, PROFILES["paper"].encoder, runtime.threads)
        by_class[PlaneClass.COLOR.label] += size
        coefficients = np.zeros_like(flat)
        coefficients[..., :kept] = np.stack(values, axis=-1)
        layers.append(replace(decoded, sh=coefficients.reshape(layer.sh.shape), extra_layers=()))
    basis = sum(2 * 3 * layer.sh.shape[-2] * PAPER.k for layer in gaussians.layers if layer.degree > 0)
    return _variant(real, layers, by_class, saved=basis)


def code_channels(channels: Sequence[Channel], encoder: EncoderSettings, threads: int) -> tuple[list[NDArray], int]:
    """Code channels through HEVC and back, as the codec does.

    Args:
        channels: of one size.
        encoder: libx265's settings.
        threads: planes at a time.

    Returns:
        (V, H, W) float32 per channel, and the bytes of all pictures.
    """
    with ThreadPoolExecutor(max_workers=threads) as pool:
        coded = list(pool.map(lambda channel: _code_channel(channel, encoder), channels))
    return [values for values, _ in coded], sum(size for _, size in coded)


def vpt_channels(gaussians: Gaussians, store: GraphStore) -> dict[str, dict[str, NDArray]]:
    """Layer 0's positions and scales before and after VPT, each (V, H, W) by name."""
    layer = gaussians.layers[0]
    projected = project_layer(store, layer, drop_invalid=True, where="layer 0")
    offset, scale = projected.planes(PlaneClass.OFFSET), projected.planes(PlaneClass.SCALE)
    return {
        "position before": {axis: layer.means[..., i] for i, axis in enumerate("xyz")},
        "position after": {
            "depth": projected.planes(PlaneClass.DEPTH)[:, 0], "offset x": offset[:, 0], "offset y": offset[:, 1]
        },
        "scale before": {f"s{i + 1}": layer.scales[..., i] for i in range(3)},
        "scale after": {f"ŝ{i + 1}": scale[:, i] for i in range(3)},
    }  # fmt: skip


def smoothness(values: NDArray) -> float:
    """Correlation of neighbouring samples (V, H, W), mean over both directions: what intra coding lives on."""
    pairs = ((values[:, :, 1:], values[:, :, :-1]), (values[:, 1:], values[:, :-1]))
    found = [np.corrcoef(a.ravel(), b.ravel())[0, 1] if a.std() > 0 and b.std() > 0 else 1.0 for a, b in pairs]
    return float(np.mean(found))


def _coded(gaussians: Gaussians, qp: float, runtime: Runtime, k: int | None) -> tuple[bytes, dict[str, Any]]:
    encoder = PROFILES["paper"].encoder
    settings = PAPER if k is None else replace(PAPER, k=k)
    data = encode_gaussians(
        gaussians, Profile("paper", encoder, settings), qp, runtime.store, threads=runtime.threads, drop_invalid=True
    )
    return data, inspect_bytes(data)


def _variant(real: Variant, layers: Sequence[Gaussians], by_class: dict[str, int], saved: int = 0) -> Variant:
    first, *rest = layers
    size = real.bytes + sum(by_class.values()) - sum(real.bytes_by_class.values()) - saved
    return Variant(replace(first, extra_layers=tuple(rest)), size, by_class)


def _paper_channel(
    plane_class: PlaneClass, index: int, values: NDArray, qp: float, sigma: float | None = None
) -> Channel:
    """A channel with the paper's step and window; values (V, H, W)."""
    values = np.ascontiguousarray(values)
    deviation = float(values.std(dtype=np.float64)) if sigma is None else sigma
    integer_step = deviation / PAPER.alpha[plane_class]
    step = integer_step * _HEVC_STEP_14_BITS * 2 ** ((PAPER.class_qp[plane_class] + qp - 4) / 6)
    low, high = float(values.min()), float(values.max())
    return Channel(plane_class, index, values, step, (low, min(high, low + (_LEVELS - 1) * integer_step)))


def _code_channel(channel: Channel, encoder: EncoderSettings) -> tuple[NDArray, int]:
    values, (low, high) = channel.values, channel.window
    mean = float(values.mean(dtype=np.float64))
    if not high > low or float(values.std(dtype=np.float64)) < channel.flat_share * channel.step:
        return np.full_like(values, mean), 0
    code_map = choose_code_map(low, high, mean, channel.step)
    codes, _ = code_map.quantise(values)
    decoded, size = np.empty_like(codes), 0
    for view, plane in enumerate(codes):
        coded = encode_plane(plane, code_map.qp, encoder)
        PlaneDecoder(coded.parameter_sets, *plane.shape).decode_into(coded.payload, decoded[view])
        size += len(coded.payload)
    return code_map.dequantise(decoded), size


def _aligned_quats(quats: NDArray) -> NDArray:
    """Unit quaternions (V, H, W, 4) with the sign nearer to their view's dominant one, as planes have them."""
    unit = quats / np.linalg.norm(quats, axis=-1, keepdims=True)
    flat = unit.reshape(len(unit), -1, 4).astype(np.float64)
    dominant = np.linalg.eigh(flat.swapaxes(1, 2) @ flat)[1][..., -1]  # (V, 4)
    side = np.einsum("vhwc,vc->vhw", unit, dominant)
    return unit * np.where(side < 0, -1, 1)[..., None].astype(np.float32)


def _nonzero(quats: NDArray) -> NDArray:
    is_zero = ~quats.any(axis=-1, keepdims=True)
    return np.where(is_zero, np.array([1, 0, 0, 0], np.float32), quats)
