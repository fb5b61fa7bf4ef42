"""Deterministic weights for parity tests.

``det_tensor(name, shape)`` is a pure function of the tensor's state-dict name
(without the checkpoint prefix ``encoder.``) and of its shape. The golden files
in ``golden/`` were produced with the reference networks filled this way, so no
weights have to be stored. Only the raw 64-bit output of the Philox generator
is used (no distribution code), so the values do not depend on the NumPy version.

    import json, torch
    from det_weights import det_state_dict
    manifest = json.load(open("manifests/mvsplat_re10k.json"))
    sd = det_state_dict({k: v["shape"] for k, v in manifest["tensors"].items()})
    model.load_state_dict({k: torch.from_numpy(v) for k, v in sd.items()}, strict=True)
"""

import re
import zlib

import numpy as np

# (regular expression, gain): first match wins; the gain multiplies 1/sqrt(fan_in).
GAINS = [
    # --- last layers that set the operating point of depth / opacity / scale ---
    (r"(^|\.)depth_head_lowres\.2\.weight$", 0.2),
    (r"(^|\.)to_disparity\.2\.weight$", 0.25),
    (r"(^|\.)to_gaussians\.2\.weight$", 1.5),
    (r"(^|\.)depth_head\.\d+\.2\.weight$", 0.5),
    (r"upsampler\.scratch\.output_conv\.4\.weight$", 0.1),
    (r"^gaussian_regressor\.2\.weight$", 0.8),
    (r"^gaussian_head\.2\.weight$", 0.6),
    # --- keep the fused feature pyramids from growing ---
    (r"\.scratch\.layer\d_rn\.weight$", 0.8),
    (r"\.resConfUnit\d\.conv[12]\.weight$", 0.7),
    (r"(^|\.)backbone\.conv2\.weight$", 0.6),
    # --- attention projections: sharper than flat ---
    (r"\.(q_proj|k_proj)\.weight$", 1.3),
    (r"\.qkv\.weight$", 1.3),
]
# (regular expression, base value) for one-dimensional scale vectors; default 1.0
SCALES = [(r"\.gamma$", 0.5), (r"(^|\.)transformer\.layers\.\d+\.\w+\.norm[12]\.weight$", 0.35)]
DEFAULT_GAIN_CONV = 1.2  # 4-D kernels
DEFAULT_GAIN_OTHER = 1.0  # linear layers and 1x1 1-D convolutions


def _uniform(name: str, n: int) -> np.ndarray:
    """n samples of a zero-mean, unit-variance uniform variable (float64)."""
    bits = np.random.Philox(key=zlib.crc32(name.encode("utf-8"))).random_raw(n)
    u = (bits >> np.uint64(11)).astype(np.float64) * (1.0 / (1 << 53))
    return (u - 0.5) * np.sqrt(12.0)


def gain_of(name: str, ndim: int) -> float:
    for pattern, gain in GAINS:
        if re.search(pattern, name):
            return gain
    return DEFAULT_GAIN_CONV if ndim == 4 else DEFAULT_GAIN_OTHER


def base_of(name: str) -> float:
    for pattern, base in SCALES:
        if re.search(pattern, name):
            return base
    return 1.0


def fan_in_of(name: str, shape) -> int:
    # Transposed convolutions (kernel == stride) store (in, out, k, k).
    if re.search(r"resize_layers\.[01]\.weight$", name):
        return int(shape[0])
    if re.search(r"pyramid\.stages\.\d+\.0\.weight$", name):
        return int(shape[0])
    return int(np.prod(shape[1:]))


def det_tensor(name: str, shape) -> np.ndarray:
    """float32 array of the given shape."""
    shape = tuple(int(s) for s in shape)
    u = _uniform(name, int(np.prod(shape)) if shape else 1).reshape(shape)
    if name.endswith(("pos_embed", "cls_token")):
        out = 0.1 * u
    elif len(shape) <= 1:
        out = 0.05 * u if name.endswith(".bias") else base_of(name) * (1.0 + 0.1 * u)
    else:
        out = gain_of(name, len(shape)) / np.sqrt(fan_in_of(name, shape)) * u
    return out.astype(np.float32)


def det_state_dict(shapes) -> dict:
    """shapes: mapping name -> shape. Returns name -> float32 array."""
    return {name: det_tensor(name, shape) for name, shape in shapes.items()}


if __name__ == "__main__":
    a = det_tensor("backbone.backbone.conv1.weight", (64, 3, 7, 7))
    print(a.shape, a.std(), a.ravel()[:4].tolist())
