"""Ways to store a case's Gaussians, each with the settings that its curve runs through: profiles and modes of ours, the
formats that `tinysplat convert` writes, and other people's tools.

    PLY, SPZ, SOG, float16 + zstd    the runtime and this module
    SPZ, compressed PLY              gaussforge, a pip package around Niantic's own SPZ code
    compressed PLY, SOG              PlayCanvas' splat-transform, an npm package, as a process of its own

A tool that is not there costs its rows and nothing else; each row without figures says why. Files hold SH bands up to
degree 3, so the Gaussians that peers are compared on have no more.
"""

from __future__ import annotations

import importlib
import os
import shutil
import subprocess
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, PROFILES, Profile, find_profile
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats import SH_BITS
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians

from .subjects.cases import Case

MODES = ("photos", "hybrid")
FORMATS = ("spz", "sog")
SPLAT_TRANSFORM = "@playcanvas/splat-transform"
MAX_DEGREE = 3
"""Of SH in peers' files."""

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
        tool: what codes it.
        threads: how many it uses; 0 where only the tool knows.
        is_slow: timed once, not in rounds.
    """

    name: str
    settings: tuple[float, ...]
    encode: Callable[[Case, float], bytes]
    decode: Callable[[Case, bytes], Gaussians]
    refuses: Callable[[Case], str] = lambda _: ""
    classes: Callable[[bytes], Mapping[str, int]] = lambda _: {}
    tool: str = "tinysplat"
    threads: int = 1
    is_slow: bool = False


def profile_way(profile: Profile | str, settings: Sequence[float], runtime: Runtime, name: str = "") -> Way:
    """A profile of ours over Q_g."""
    chosen = find_profile(profile) if isinstance(profile, str) else profile

    def encode(case: Case, qp: float) -> bytes:
        return encode_gaussians(
            case.gaussians, chosen, qp, runtime.store, threads=runtime.threads, drop_invalid=True
        )  # fmt: skip

    return own_way(name or chosen.name, settings, encode, runtime)


def mode_way(mode: str, settings: Sequence[float], runtime: Runtime) -> Way:
    """A mode whose files carry the photos, over Q_g, with the default profile."""

    def encode(case: Case, qp: float) -> bytes:
        assert case.shots is not None and case.shots.scene is not None
        return runtime.encode(
            case.shots.scene, case.model, DEFAULT_PROFILE, qp, mode=mode, gaussians=case.gaussians
        )  # fmt: skip

    def refuses(case: Case) -> str:
        return "" if case.shots is not None and case.shots.scene is not None else "it needs the photos of a scene"

    return replace(own_way(mode, settings, encode, runtime), refuses=refuses)


def format_way(name: str) -> Way:
    """SPZ or SOG as `tinysplat convert` writes and reads them; SH above what they hold is cut."""

    def refuses(case: Case) -> str:
        is_long = name == "sog" and case.gaussians.degree > 0
        return "its clustering of SH takes many minutes on a CPU" if is_long else ""

    return file_way(name.upper(), f".{name}", refuses)


def file_way(name: str, suffix: str, refuses: Callable[[Case], str] = lambda _: "", tool: str = "tinysplat") -> Way:
    """A Gaussian file that the runtime reads and writes."""
    way = _way(name, tool, lambda g: _written(g, suffix), lambda data: _loaded(data, suffix))
    return replace(way, refuses=refuses)


def spz_ways() -> list[Way]:
    """SPZ of version 4 as `tinysplat convert` writes it, and with all bits of SH coefficients."""
    version = 4
    plain = _way(f"SPZ v{version}", "tinysplat", partial(_spz, version, SH_BITS), lambda data: _loaded(data, ".spz"))
    finest = _way(
        f"{plain.name}, SH of 8 bits", "tinysplat", partial(_spz, version, (8, 8)), lambda data: _loaded(data, ".spz")
    )
    return [plain, replace(finest, refuses=lambda case: "" if case.gaussians.degree else "it has no SH beyond colour")]


def _spz(version: int, bits: tuple[int, int], gaussians: Gaussians) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "g.spz"
        save_gaussians(path, gaussians, bits, version)
        return path.read_bytes()


def _way(name: str, tool: str, encode: Callable[[Gaussians], bytes], decode: Callable[[bytes], Gaussians]) -> Way:
    return Way(
        name, (NO_SETTING,), lambda case, _: encode(case.gaussians), lambda _, data: decode(data), tool=tool
    )  # fmt: skip


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

    return Way(name, tuple(settings), encode, decode, classes=bytes_by_class, threads=runtime.threads)


# ---- peers --------------------------------------------------------------------------------------------------------


class MissingToolError(Exception):
    """A tool is not there, or did not finish; the message says which and why."""


def peer_ways(runtime: Runtime, sog_limit_s: float) -> list[Way]:
    """All formats, TinySplat's profiles first.

    Args:
        runtime: codes TinySplat's own.
        sog_limit_s: SOG is given up after this long: on a CPU its clustering of SH takes minutes.
    """
    return [
        *(profile_way(name, (0.0,), runtime, f"TinySplat {name}") for name in PROFILES),
        *(_forge_way(f"SPZ v{v}", "spz", v) for v in (3, 4)),
        _process_way("SOG", ".sog", sog_limit_s),
        _process_way("compressed PLY", ".compressed.ply", 120),
        _forge_way("compressed PLY, gaussforge", "compressed.ply"),
        _way(f"float16 + shuffle + {_packer_name()}", "numpy", encode_half, decode_half),
        file_way("PLY", ".ply", tool="plyfile"),
    ]  # fmt: skip


def tool_note(tool: str) -> str:
    """What to know about a tool's seconds; an empty line of what is done in this process, straight from arrays."""
    if tool == "splat-transform":
        return f"by {tool}: includes {splat_transform_start():.2f} s to start node, and reading or writing a PLY"
    return f"by {tool}: includes reading and writing a PLY" if tool == "gaussforge" else ""


# ---- in this process ---------------------------------------------------------------------------------------------


def encode_half(gaussians: Gaussians) -> bytes:
    """All attributes as float16, high and low bytes apart, then a general compressor."""
    flat = gaussians.flat()
    parts = [np.array([flat.opacities.size, flat.sh.shape[1]], "<u4").tobytes()]
    for array in (flat.means, flat.quats, flat.scales, flat.opacities, flat.sh):
        octets = array.astype("<f2").reshape(-1, 1).view(np.uint8)
        parts.append(np.ascontiguousarray(octets.T).tobytes())
    return _packer()[0](b"".join(parts))


def decode_half(data: bytes) -> Gaussians:
    """The inverse of `encode_half`."""
    raw = _packer()[1](data)
    count, functions = (int(n) for n in np.frombuffer(raw, "<u4", 2))
    halves, at = [], 8
    for shape in ((count, 3), (count, 4), (count, 3), (count,), (count, functions, 3)):
        size = 2 * int(np.prod(shape))
        octets = np.frombuffer(raw, np.uint8, size, at).reshape(2, -1)
        halves.append(np.ascontiguousarray(octets.T).view("<f2").astype(np.float32).reshape(shape))
        at += size
    means, quats, scales, opacities, sh = halves
    return Gaussians(means, quats, scales, opacities, sh)


@lru_cache(maxsize=1)
def _packer() -> tuple[Callable[[bytes], bytes], Callable[[bytes], bytes]]:
    try:
        zstandard = importlib.import_module("zstandard")
    except ImportError:
        return lambda data: zlib.compress(data, 6), zlib.decompress
    return zstandard.ZstdCompressor(level=10).compress, zstandard.ZstdDecompressor().decompress


def _packer_name() -> str:
    return "zstd" if "zstd" in str(getattr(_packer()[0], "__self__", "")).lower() else "zlib (no zstandard here)"


# ---- gaussforge --------------------------------------------------------------------------------------------------


def _forge_way(name: str, suffix: str, version: int = 3) -> Way:
    """By way of a PLY, the one format that it reads and writes without its own arrays."""

    def encode(gaussians: Gaussians) -> bytes:
        return _forged("ply", _written(gaussians, ".ply"), suffix, version)

    return _way(name, "gaussforge", encode, lambda data: _loaded(_forged(suffix, data, "ply"), ".ply"))


def _forged(of: str, data: bytes, to: str, version: int = 3) -> bytes:
    try:
        forge = importlib.import_module("gaussforge").GaussForge()
    except ImportError:
        raise MissingToolError("gaussforge is not installed: pip install gaussforge") from None
    with _quiet():
        result = forge.convert(data, of, to, spz_version=version)
    if "error" in result:
        raise MissingToolError(f"gaussforge: {result['error']}")
    return bytes(result["data"])


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep what native code prints off standard output and error."""
    with open(os.devnull, "wb") as nowhere:  # noqa: PTH123 - os.devnull is no file to manage
        saved = os.dup(1), os.dup(2)
        try:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
            yield
        finally:
            for target, copy in enumerate(saved, start=1):
                os.dup2(copy, target)
                os.close(copy)


# ---- splat-transform ---------------------------------------------------------------------------------------------


def _process_way(name: str, suffix: str, limit_s: float) -> Way:
    def encode(gaussians: Gaussians) -> bytes:
        return _transformed(_written(gaussians, ".ply"), ".ply", suffix, "-g", "cpu", limit_s=limit_s)

    def decode(data: bytes) -> Gaussians:
        return _loaded(_transformed(data, suffix, ".ply", limit_s=120), ".ply")

    return replace(_way(name, "splat-transform", encode, decode), is_slow=True, threads=0)


def _transformed(data: bytes, of: str, to: str, *options: str, limit_s: float) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / f"in{of}", Path(folder) / f"out{to}"
        source.write_bytes(data)
        _splat_transform("-q", "-w", *options, str(source), str(target), limit_s=limit_s)
        return target.read_bytes()


@lru_cache(maxsize=1)
def _splat_transform_command() -> str:
    """Where it is installed: `npx` would ask its registry, whatever its options."""
    found = shutil.which("splat-transform")
    if found is None:
        raise MissingToolError(f"splat-transform is not installed: npm install -g {SPLAT_TRANSFORM}")
    return found


@lru_cache(maxsize=1)
def splat_transform_start() -> float:
    """Seconds that the process takes to do nothing."""
    start = time.perf_counter()
    _splat_transform("--version", limit_s=60)
    return time.perf_counter() - start


def _splat_transform(*arguments: str, limit_s: float) -> str:
    try:
        done = subprocess.run(
            [_splat_transform_command(), *arguments], capture_output=True, text=True, check=False, timeout=limit_s
        )
    except subprocess.TimeoutExpired:
        raise MissingToolError(f"splat-transform did not finish within {limit_s:g} s on this CPU") from None
    if done.returncode != 0:
        lines = (done.stderr or done.stdout).strip().splitlines() or ["no message"]
        raise MissingToolError(f"splat-transform failed: {lines[-1][:200]}")
    return done.stdout
