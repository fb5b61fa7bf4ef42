"""Ways to store a window's Gaussians, each with the settings that its curve runs through: our profiles and modes, the
profile `balanced` with an idea undone, and the formats SPZ and SOG as `tinysplat convert` writes them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, Profile, find_profile
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians

from . import ideas
from .rate_distortion import Pictures, Point, measure_point
from .subjects import Subject

MODES = ("photos", "hybrid")
PEERS = ("spz", "sog")

NO_SETTING = 0.0
"""Of a format that has no quality to choose: its curve is a point."""


@dataclass(frozen=True, eq=False)
class Way:
    """One way to store Gaussians.

    Attributes:
        name: unique among those compared.
        settings: Q_g, or NO_SETTING alone.
        encode: a subject at a setting, to bytes.
        decode: a subject's bytes, to Gaussians.
        refuses: why it cannot store a subject, or an empty line.
        classes: bytes by class, of what is a `.tsplat` file.
    """

    name: str
    settings: tuple[float, ...]
    encode: Callable[[Subject, float], bytes]
    decode: Callable[[Subject, bytes], Gaussians]
    refuses: Callable[[Subject], str] = lambda _: ""
    classes: Callable[[bytes], Mapping[str, int]] = lambda _: {}

    def measure(self, subject: Subject, pictures: Pictures, setting: float) -> Point:
        """One point of the curve."""
        encode, decode = (lambda: self.encode(subject, setting)), (lambda data: self.decode(subject, data))
        return measure_point(pictures, setting, encode, decode, self.classes)


def profile_way(profile: Profile | str, settings: Sequence[float], runtime: Runtime, name: str = "") -> Way:
    """A profile of ours over Q_g."""
    chosen = find_profile(profile) if isinstance(profile, str) else profile

    def encode(subject: Subject, qp: float) -> bytes:
        gaussians = subject.case.gaussians
        return encode_gaussians(gaussians, chosen, qp, runtime.store, threads=runtime.threads, drop_invalid=True)

    return _own(name or chosen.name, settings, encode, runtime)


def mode_way(mode: str, settings: Sequence[float], runtime: Runtime) -> Way:
    """A mode whose files carry the photos, over Q_g, with the default profile."""

    def encode(subject: Subject, qp: float) -> bytes:
        assert subject.scene is not None
        return runtime.encode(
            subject.scene, subject.model, DEFAULT_PROFILE, qp, mode=mode, gaussians=subject.case.gaussians
        )

    way = _own(mode, settings, encode, runtime)
    return replace(way, refuses=lambda subject: "" if subject.scene else "a Gaussian file has no photos")


def ablation_ways(settings: Sequence[float], runtime: Runtime) -> list[Way]:
    """The default profile and other settings of it over Q_g, then without each of its other ideas at the middle one."""
    middle = sorted(settings)[len(settings) // 2 :][:1]

    def undone(change: ideas.Change) -> Callable[[Subject, float], bytes]:
        return lambda subject, qp: ideas.encode_changed(subject.case.gaussians, qp, runtime, change)

    return [
        profile_way(DEFAULT_PROFILE, settings, runtime),
        *(profile_way(profile, settings, runtime, name) for name, profile in ideas.other_settings().items()),
        *(_own(name, middle, undone(change), runtime) for name, change in ideas.CHANGES.items()),
    ]


def peer_way(peer: str) -> Way:
    """SPZ or SOG as `tinysplat convert` writes and reads them; SH above what they hold is cut."""
    suffix = f".{peer}"

    def encode(subject: Subject, _: float) -> bytes:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"scene{suffix}"
            save_gaussians(path, subject.case.gaussians)
            return path.read_bytes()

    def decode(_: Subject, data: bytes) -> Gaussians:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"scene{suffix}"
            path.write_bytes(data)
            return load_gaussians(path)

    def refuses(subject: Subject) -> str:
        if peer == "sog" and subject.case.gaussians.degree > 0:
            return "its clustering of SH takes many minutes on a CPU"
        return ""

    return Way(peer.upper(), (NO_SETTING,), encode, decode, refuses)


def bytes_by_class(data: bytes) -> dict[str, int]:
    """Of the planes of a `.tsplat` file, of its photos, and of the metadata."""
    described = inspect_bytes(data)
    return {**described["bytes_by_class"], "metadata": described["metadata_bytes"]}


def find_ways(
    profiles: Sequence[str],
    modes: Sequence[str],
    peers: Sequence[str],
    qps: Mapping[str, Sequence[float]],
    runtime: Runtime,
) -> list[Way]:
    """What a user named, the reference first.

    Args:
        profiles, modes, peers: names.
        qps: Q_g of each profile and mode.
        runtime: codes.

    Raises:
        InputError: there is none of that name.
    """
    for names, accepted, option in ((modes, MODES, "--modes"), (peers, PEERS, "--peers")):
        for name in names:
            if name not in accepted:
                raise InputError(f"'{name}', accepted are {', '.join(accepted)}", where=option)
    return [
        *(profile_way(name, qps[name], runtime) for name in profiles),
        *(mode_way(name, qps[name], runtime) for name in modes),
        *(peer_way(name) for name in peers),
    ]


def _own(name: str, settings: Sequence[float], encode: Callable[[Subject, float], bytes], runtime: Runtime) -> Way:
    def decode(subject: Subject, data: bytes) -> Gaussians:
        return runtime.decompress(data, model=subject.model if subject.scene else None)

    return Way(name, tuple(settings), encode, decode, classes=bytes_by_class)
