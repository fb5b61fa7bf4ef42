"""What a run was made on: without it, a time is no figure."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import subprocess
import time
from pathlib import Path
from typing import Any

from tinysplat_runtime import __version__
from tinysplat_runtime.system.threads import available_cores

PACKAGES = ("numpy", "onnxruntime", "av", "torch", "matplotlib", "numba", "gsplat", "gaussforge", "zstandard")
"""Packages whose version a figure may depend on; those that are not installed are left out."""

_VECTOR_FLAGS = ("avx2", "avx512f", "avx512_vnni", "amx_tile", "asimd", "sve")


def describe_machine() -> dict[str, Any]:
    """Processor, memory, load and versions, JSON-ready."""
    return {
        "time": time.strftime("%Y-%m-%d %H:%M %Z"),
        "processor": processor_name(),
        "vector_extensions": [flag for flag in _VECTOR_FLAGS if flag in _cpu_flags()],
        "cores_available": available_cores(),
        "cores_of_machine": os.cpu_count(),
        "memory_bytes": _memory_bytes(),
        "load_average": [round(load, 2) for load in os.getloadavg()] if hasattr(os, "getloadavg") else None,
        "system": platform.platform(),
        "python": platform.python_version(),
        "tinysplat": __version__,
        "commit": commit(),
        "packages": package_versions(),
    }


def processor_name() -> str:
    """The processor's own name."""
    for line in _proc("cpuinfo").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def package_versions() -> dict[str, str]:
    """Versions of `PACKAGES`, and of the libraries that code video, as PyAV states them."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    import av

    versions["libavcodec"] = ".".join(map(str, av.library_versions["libavcodec"]))
    return versions


def commit() -> str | None:
    """The commit of the checkout that this file lies in, `+` behind it where files differ from it."""
    folder = Path(__file__).resolve().parents[2]

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", "-C", str(folder), *words], capture_output=True, text=True, check=True, timeout=10
        ).stdout.strip()

    try:
        if Path(git("rev-parse", "--show-toplevel")).resolve() != folder:
            return None
        changed = git("status", "--porcelain", "--untracked-files=no", "--", "runtime", "tinysplat", "models")
        return git("rev-parse", "--short=12", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.SubprocessError):
        return None


def _cpu_flags() -> set[str]:
    for line in _proc("cpuinfo").splitlines():
        if line.startswith(("flags", "Features")):
            return set(line.partition(":")[2].split())
    return set()


def _memory_bytes() -> int | None:
    for line in _proc("meminfo").splitlines():
        if line.startswith("MemTotal"):
            return int(line.split()[1]) * 1024
    return None


def _proc(name: str) -> str:
    try:
        return Path("/proc", name).read_text("utf-8", "replace")
    except OSError:
        return ""
