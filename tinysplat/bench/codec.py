"""Encoding and decoding: what profiles, presets, Q_g and threads cost in seconds, bytes and dB."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.hevc import EncoderSettings
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, PROFILES, Profile, find_profile
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.system.threads import available_cores

from ..measure.metrics import attribute_errors
from .inputs import Case
from .judge import Judge
from .streams import decode_alone, encode_alone, file_streams, recorded_planes
from .timing import Baseline, Figures, Stage, Variant

PRESETS: dict[str, tuple[str, ...]] = {
    "ultrafast": (),
    "ultrafast, min-cu-size=8": ("min-cu-size=8",),
    "superfast": (),
    "superfast, rdoq-level=2": ("rdoq-level=2",),
    "medium, rdoq-level=2": ("rdoq-level=2",),
    "veryslow, rdoq-level=2": ("rdoq-level=2",),
}
"""Presets of libx265 that the default profile's planes are coded with, the further parameters of each."""


def encode_stage(
    case: Case, judge: Judge, runtime: Runtime, profiles: Sequence[str], qps: Sequence[float]
) -> tuple[Stage, dict[str, bytes]]:
    """Every profile at every Q_g, each against libx265 alone on its own planes; and the files that come of it."""
    files: dict[str, bytes] = {}
    variants = []
    for name in profiles:
        for qp in qps:
            label = f"{name} qp {qp:g}"
            variant, files[label] = _variant(label, case, find_profile(name), qp, judge, runtime)
            variants.append(variant)
    return Stage("encode", case.name, variants), files


def preset_stage(
    case: Case, judge: Judge, runtime: Runtime, presets: Sequence[str], qps: Sequence[float] = (0.0,)
) -> Stage:
    """The default profile's planes by several presets of libx265."""
    profile = find_profile(DEFAULT_PROFILE)
    kept = tuple(p for p in profile.encoder.params if not p.startswith(("rdoq-level", "min-cu-size")))
    variants = []
    for name in presets:
        coder = replace(profile, encoder=EncoderSettings(name.partition(",")[0], (*PRESETS[name], *kept)))
        variants += [_variant(f"{name}; qp {qp:g}", case, coder, qp, judge, runtime)[0] for qp in qps]
    return Stage("preset", case.name, variants)


def decode_stage(case: Case, files: dict[str, bytes], threads: Sequence[int]) -> Stage:
    """Files to Gaussians, each against libavcodec alone on its own streams."""
    return Stage("decode", case.name, list(_decode_variants(files, threads)))


def cold_start_stage(case: Case, data: bytes, folder: Path) -> Stage:
    """`tinysplat decode` as a process of its own, from starting the interpreter to the written .npz."""
    source, target = folder / "cold.tsplat", folder / "cold.npz"
    source.write_bytes(data)
    command = [sys.executable, "-m", "tinysplat_runtime", "decode", str(source), "-o", str(target), "-q"]

    def run() -> None:
        subprocess.run(command, check=True, capture_output=True, timeout=120)

    variant = Variant("tinysplat decode", run, _sizes(len(data), len(file_streams(data))), threads=available_cores())
    return Stage("cold start", case.name, [variant])


def coding_figures(data: bytes, raw: Gaussians, judge: Judge, runtime: Runtime) -> Figures:
    """`bytes`, `k`, what the pictures lose, and the RMSE of every attribute in world units."""
    decoded = runtime.decompress(data)
    attributes = {f"rmse_{name}": error["rmse"] for name, error in attribute_errors(raw, decoded).items()}
    return {"bytes": len(data), "k": inspect_bytes(data)["k"], **judge.figures(decoded), **attributes}


def _variant(
    label: str, case: Case, profile: Profile, qp: float, judge: Judge, runtime: Runtime
) -> tuple[Variant, bytes]:
    def encode() -> bytes:
        return encode_gaussians(case.gaussians, profile, qp, runtime.store, threads=runtime.threads, drop_invalid=True)

    with recorded_planes() as planes:
        data = encode()
    figures = coding_figures(data, case.gaussians, judge, runtime) | {"planes": len(planes)}
    variant = Variant(
        label,
        encode,
        figures=lambda _: figures,
        settings={"profile": profile.name, "qp": qp, "preset": profile.encoder.preset},
        threads=runtime.threads,
        baseline=Baseline("libx265 alone", encode_alone(planes, runtime.threads)) if planes else None,
    )
    return variant, data


def _decode_variants(files: dict[str, bytes], threads: Sequence[int]) -> Iterator[Variant]:
    for count in threads:
        runtime = Runtime(threads=count)
        for label, data in files.items():
            streams = file_streams(data)
            yield Variant(
                f"{label}, {count} thread{'s' * (count > 1)}",
                _decoding(runtime, data),
                figures=_sizes(len(data), len(streams)),
                settings={"file": label},
                threads=count,
                baseline=Baseline("libavcodec alone", decode_alone(streams, count)) if streams else None,
            )


def _decoding(runtime: Runtime, data: bytes) -> Callable[[], object]:
    return lambda: runtime.decompress(data)


def _sizes(size: int, planes: int) -> Callable[[object], Figures]:
    return lambda _: {"bytes": size, "planes": planes}


def all_profiles() -> tuple[str, ...]:
    """Names of the profiles there are."""
    return tuple(PROFILES)
