"""How many colour planes (k), and how many SH bands: what each costs in bytes and seconds, and what it gives in dB."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.analysis import coefficient_moment, color_planes
from tinysplat_runtime.codec.basis import mean_magnitude_weighting, reduce_basis, view_directions, weighted_spectrum
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, PAPER, find_profile
from tinysplat_runtime.gaussian.gaussians import Gaussians

from .codec import coding_figures
from .inputs import Case, truncated
from .judge import Judge
from .timing import Figures, Stage, Variant


def k_stage(case: Case, judge: Judge, runtime: Runtime, ks: Sequence[int]) -> Stage:
    """Profile `paper` with k planes; `psnr_vabr_alone` is what k planes would give if coding cost nothing."""
    variants = []
    for k in sorted({min(k, 3 * (case.gaussians.degree + 1) ** 2) for k in ks}):
        profile = replace(find_profile("paper"), settings=replace(PAPER, k=k))

        def encode(profile=profile) -> bytes:  # type: ignore[no-untyped-def]
            return encode_gaussians(
                case.gaussians, profile, 0, runtime.store, threads=runtime.threads, drop_invalid=True
            )

        def figures(data: bytes, k: int = k) -> Figures:
            alone = judge.figures(reduced(case.gaussians, k, runtime))["psnr_decoded_raw"]
            return {**coding_figures(data, case.gaussians, judge, runtime), "psnr_vabr_alone": alone}

        variants.append(Variant(f"k = {k}", encode, figures, {"k": k}, runtime.threads))
    return Stage("k", case.name, variants)


def degree_stage(case: Case, judge: Judge, runtime: Runtime) -> Stage:
    """The default profile on the same Gaussians with fewer SH bands; pictures against those of all bands."""
    variants = []
    for degree in range(case.gaussians.degree + 1):
        gaussians = truncated(case.gaussians, degree)

        def encode(gaussians: Gaussians = gaussians) -> bytes:
            return runtime.compress(gaussians, DEFAULT_PROFILE, drop_invalid=True)

        def figures(data: bytes, gaussians: Gaussians = gaussians) -> Figures:
            uncoded = judge.figures(gaussians)["psnr_decoded_raw"]
            return {**coding_figures(data, case.gaussians, judge, runtime), "psnr_bands_alone": uncoded}

        variants.append(Variant(f"SH degree {degree}", encode, figures, {"degree": degree}, runtime.threads))
    return Stage("SH degree", case.name, variants)


def reduced(gaussians: Gaussians, k: int, runtime: Runtime) -> Gaussians:
    """The paper's VABR forth and back with k components, in float32, without quantisation."""
    moment = coefficient_moment(runtime.store, gaussians)
    weighting = mean_magnitude_weighting(view_directions(gaussians.cameras), gaussians.degree)
    reduction = reduce_basis(weighted_spectrum(moment, weighting), weighting, k)
    planes = color_planes(runtime.store, gaussians, reduction.projection)
    sh = np.einsum("vkhw,dk->vhwd", planes, reduction.inverse.astype(np.float32))
    return replace(gaussians, sh=sh.reshape(gaussians.sh.shape))
