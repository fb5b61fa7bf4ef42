"""Other ways to store the same Gaussians.

    PLY, float16 + zstd          the runtime and this module
    SPZ, compressed PLY          gaussforge, a pip package around Niantic's own SPZ code
    compressed PLY, SOG          PlayCanvas' splat-transform, an npm package, as a process of its own

A tool that is not there costs its rows and nothing else; each row without figures says why. Files hold SH bands up to
degree 3, so the Gaussians compared have no more.
"""

from __future__ import annotations

import importlib
import os
import shutil
import subprocess
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians

from .ways import NO_SETTING, Way, file_way, profile_way

SPLAT_TRANSFORM = "@playcanvas/splat-transform"
MAX_DEGREE = 3
_LOGIT_MARGIN = 2.0**-24


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
        *(_way(f"SPZ v{v}", "gaussforge", _forge_encoder("spz", v), _forge_decoder("spz")) for v in (3, 4)),
        _process_way("SOG", ".sog", sog_limit_s),
        _process_way("compressed PLY", ".compressed.ply", 120),
        _way("compressed PLY, gaussforge", "gaussforge", _forge_encoder("compressed.ply", 3),
             _forge_decoder("compressed.ply")),
        _way(f"float16 + shuffle + {_packer_name()}", "numpy", encode_half, decode_half),
        file_way("PLY", ".ply", tool="plyfile"),
    ]  # fmt: skip


def tool_note(tool: str) -> str:
    """What to know about a tool's seconds."""
    if tool == "splat-transform":
        return f"includes {splat_transform_start():.2f} s to start node, and reading or writing a PLY"
    return ""


def _way(name: str, tool: str, encode: Callable[[Gaussians], bytes], decode: Callable[[bytes], Gaussians]) -> Way:
    return Way(
        name, (NO_SETTING,), lambda case, _: encode(case.gaussians), lambda _, data: decode(data), tool=tool
    )  # fmt: skip


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


def _forge_encoder(suffix: str, version: int) -> Callable[[Gaussians], bytes]:
    def encode(gaussians: Gaussians) -> bytes:
        flat = gaussians.flat()
        opacities = flat.opacities.astype(np.float64).clip(_LOGIT_MARGIN, 1 - _LOGIT_MARGIN)
        model = {
            "numPoints": flat.opacities.size,
            "positions": _octets(flat.means + flat.origin),
            "scales": _octets(np.log(np.maximum(flat.scales, np.finfo(np.float32).tiny))),
            "rotations": _octets(flat.quats / np.linalg.norm(flat.quats, axis=-1, keepdims=True)),
            "alphas": _octets(np.log(opacities / (1 - opacities))),
            "colors": _octets(flat.sh[:, 0]),
            "sh": _octets(flat.sh[:, 1:]),
            "extras": {},
            "meta": {"shDegree": flat.degree, "sourceFormat": "ply"},
        }
        with _quiet():
            return bytes(_forged(_forge().write(model, suffix, spz_version=version)))

    return encode


def _forge_decoder(suffix: str) -> Callable[[bytes], Gaussians]:
    def decode(data: bytes) -> Gaussians:
        with _quiet():
            model = _forge().read(data, suffix)
            if "error" in model:  # its reader cannot return empty arrays, which Gaussians without higher bands have
                ply = bytes(_forged(_forge().convert(data, suffix, "ply")))
                return _read_ply(ply)
        model = model["data"]
        count = model["numPoints"]

        def floats(name: str, width: int) -> NDArray:
            return np.frombuffer(model[name], np.float32).reshape(count, width)

        rest = floats("sh", len(model["sh"]) // (4 * count))
        sh = np.concatenate([floats("colors", 3), rest], axis=1).reshape(count, -1, 3)
        opacities = 1 / (1 + np.exp(-floats("alphas", 1)[:, 0]))
        return Gaussians(floats("positions", 3), floats("rotations", 4), np.exp(floats("scales", 3)), opacities, sh)

    return decode


def _read_ply(data: bytes) -> Gaussians:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "g.ply"
        path.write_bytes(data)
        return load_gaussians(path)


def _forge() -> Any:
    try:
        return importlib.import_module("gaussforge").GaussForge()
    except ImportError:
        raise MissingToolError("gaussforge is not installed: pip install gaussforge") from None


def _forged(result: dict[str, Any]) -> Any:
    if "error" in result:
        raise MissingToolError(f"gaussforge: {result['error']}")
    return result["data"]


def _octets(array: NDArray) -> bytes:
    return np.ascontiguousarray(array, np.float32).tobytes()


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
        with tempfile.TemporaryDirectory() as folder:
            source, target = Path(folder) / "in.ply", Path(folder) / f"out{suffix}"
            save_gaussians(source, gaussians)
            _splat_transform("-q", "-w", "-g", "cpu", str(source), str(target), limit_s=limit_s)
            return target.read_bytes()

    def decode(data: bytes) -> Gaussians:
        with tempfile.TemporaryDirectory() as folder:
            source, target = Path(folder) / f"in{suffix}", Path(folder) / "out.ply"
            source.write_bytes(data)
            _splat_transform("-q", "-w", str(source), str(target), limit_s=120)
            return load_gaussians(target)

    return replace(_way(name, "splat-transform", encode, decode), is_slow=True, threads=0)


@lru_cache(maxsize=1)
def _splat_transform_command() -> tuple[str, ...]:
    own = shutil.which("splat-transform")
    if own:
        return (own,)
    npx = shutil.which("npx")
    if npx is None:
        raise MissingToolError("node is not there, which splat-transform needs")
    command = (npx, "--no-install", SPLAT_TRANSFORM)
    found = subprocess.run([*command, "--version"], capture_output=True, check=False, timeout=60)
    if found.returncode != 0:
        raise MissingToolError(f"splat-transform is not installed: npm install -g {SPLAT_TRANSFORM}")
    return command


@lru_cache(maxsize=1)
def splat_transform_start() -> float:
    """Seconds that the process takes to do nothing."""
    start = time.perf_counter()
    _splat_transform("--version", limit_s=60)
    return time.perf_counter() - start


def _splat_transform(*arguments: str, limit_s: float) -> str:
    try:
        done = subprocess.run(
            [*_splat_transform_command(), *arguments], capture_output=True, text=True, check=False, timeout=limit_s
        )
    except subprocess.TimeoutExpired:
        raise MissingToolError(f"splat-transform did not finish within {limit_s:g} s on this CPU") from None
    if done.returncode != 0:
        lines = (done.stderr or done.stdout).strip().splitlines() or ["no message"]
        raise MissingToolError(f"splat-transform failed: {lines[-1][:200]}")
    return done.stdout
