"""Ways to store a case's Gaussians, each with the settings that its curve runs through: profiles and modes of ours, and
the formats that `tinysplat convert` writes.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, Profile, find_profile
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats import SH_BITS
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians

from .subjects.cases import Case

MODES = ("photos",)
FORMATS = ("spz", "sog")

NO_SETTING = 0.0
"""Of a format that has no quality to choose: its curve is a point."""


@dataclass(frozen=True, eq=False)
class Way:
    """One way to store Gaussians.

    Attributes:
        name: unique among those compared.
        settings: Q_g, or NO_SETTING alone.
        encode: a case at a setting, to bytes.
        decode: a case's bytes, to Gaussians.
        refuses: why it cannot store a case, or an empty line.
        classes: bytes by class, of what is a `.tsplat` file.
    """

    name: str
    settings: tuple[float, ...]
    encode: Callable[[Case, float], bytes]
    decode: Callable[[Case, bytes], Gaussians]
    refuses: Callable[[Case], str] = lambda _: ""
    classes: Callable[[bytes], Mapping[str, int]] = lambda _: {}


def profile_way(profile: Profile | str, settings: Sequence[float], runtime: Runtime, name: str = "") -> Way:
    """A profile of ours over Q_g."""
    chosen = find_profile(profile) if isinstance(profile, str) else profile

    def encode(case: Case, qp: float) -> bytes:
        return encode_gaussians(case.gaussians, chosen, qp, runtime.store, threads=runtime.threads, drop_invalid=True)

    return own_way(name or chosen.name, settings, encode, runtime)


def mode_way(mode: str, settings: Sequence[float], runtime: Runtime) -> Way:
    """A mode whose files carry the photos, over Q_g, with the default profile."""

    def encode(case: Case, qp: float) -> bytes:
        assert case.shots is not None and case.shots.scene is not None
        return runtime.encode(case.shots.scene, case.model, DEFAULT_PROFILE, qp, mode=mode, gaussians=case.gaussians)

    def refuses(case: Case) -> str:
        return "" if case.shots is not None and case.shots.scene is not None else "it needs the photos of a scene"

    return replace(own_way(mode, settings, encode, runtime), refuses=refuses)


def format_way(name: str) -> Way:
    """SPZ or SOG as `tinysplat convert` writes and reads them; SH above what they hold is cut."""

    def refuses(case: Case) -> str:
        is_long = name == "sog" and case.gaussians.degree > 0
        return "its clustering of SH takes many minutes on a CPU" if is_long else ""

    return file_way(name.upper(), f".{name}", refuses)


def file_way(name: str, suffix: str, refuses: Callable[[Case], str] = lambda _: "") -> Way:
    """A Gaussian file that the runtime reads and writes."""
    way = _way(name, lambda g: _written(g, suffix), lambda data: _loaded(data, suffix))
    return replace(way, refuses=refuses)


def spz_ways() -> list[Way]:
    """SPZ of version 4 as `tinysplat convert` writes it, and with all bits of SH coefficients."""
    version = 4
    plain = _way(f"SPZ v{version}", partial(_spz, version, SH_BITS), lambda data: _loaded(data, ".spz"))
    finest = _way(f"{plain.name}, SH of 8 bits", partial(_spz, version, (8, 8)), lambda data: _loaded(data, ".spz"))
    return [plain, replace(finest, refuses=lambda case: "" if case.gaussians.degree else "it has no SH beyond colour")]


def _spz(version: int, bits: tuple[int, int], gaussians: Gaussians) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "g.spz"
        save_gaussians(path, gaussians, bits, version)
        return path.read_bytes()


def _way(name: str, encode: Callable[[Gaussians], bytes], decode: Callable[[bytes], Gaussians]) -> Way:
    return Way(name, (NO_SETTING,), lambda case, _: encode(case.gaussians), lambda _, data: decode(data))


def _written(gaussians: Gaussians, suffix: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"g{suffix}"
        save_gaussians(path, gaussians)
        return path.read_bytes()


def _loaded(data: bytes, suffix: str) -> Gaussians:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"g{suffix}"
        path.write_bytes(data)
        return load_gaussians(path)


def bytes_by_class(data: bytes) -> dict[str, int]:
    """Of the planes of a `.tsplat` file, of its photos, and of the metadata."""
    described = inspect_bytes(data)
    return {**described["bytes_by_class"], "metadata": described["metadata_bytes"]}


def find_ways(
    profiles: Sequence[str],
    modes: Sequence[str],
    formats: Sequence[str],
    qps: Mapping[str, Sequence[float]],
    runtime: Runtime,
) -> list[Way]:
    """What a user named, the reference first.

    Args:
        profiles, modes, formats: names.
        qps: Q_g of each profile and mode.
        runtime: codes.

    Raises:
        InputError: there is none of that name.
    """
    for names, accepted, option in ((modes, MODES, "--modes"), (formats, FORMATS, "--peers")):
        for name in names:
            if name not in accepted:
                raise InputError(f"'{name}', accepted are {', '.join(accepted)}", where=option)
    return [
        *(profile_way(name, qps[name], runtime) for name in profiles),
        *(mode_way(name, qps[name], runtime) for name in modes),
        *(format_way(name) for name in formats),
    ]


def own_way(name: str, settings: Sequence[float], encode: Callable[[Case, float], bytes], runtime: Runtime) -> Way:
    """A way whose files are ours."""

    def decode(case: Case, data: bytes) -> Gaussians:
        is_scene = case.shots is not None and case.shots.scene is not None
        return runtime.decompress(data, model=case.model if is_scene else None)

    return Way(name, tuple(settings), encode, decode, classes=bytes_by_class)
