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

PACKAGES = ("numpy", "onnxruntime", "av", "torch", "numba", "gsplat", "gaussforge", "zstandard")
"""Packages whose version a figure may depend on; those that are not installed are left out."""

_VECTOR_FLAGS = ("avx2", "avx512f", "avx512_vnni", "amx_tile", "asimd", "sve")


def describe_machine() -> dict[str, Any]:
    """Processor, memory, load and versions, JSON-ready."""
    flags = next((line for line in _proc("cpuinfo") if line.startswith(("flags", "Features"))), "").split()
    memory = next((int(line.split()[1]) * 1024 for line in _proc("meminfo") if line.startswith("MemTotal")), None)
    return {
        "time": time.strftime("%Y-%m-%d %H:%M %Z"),
        "cpu": processor_name(),
        "vector_extensions": [flag for flag in _VECTOR_FLAGS if flag in flags],
        "cores": available_cores(),
        "cores_of_machine": os.cpu_count(),
        "memory_bytes": memory,
        "load_average": load_average(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "tinysplat": __version__,
        "commit": commit(),
        **package_versions(),
    }


def processor_name() -> str:
    """The processor's own name."""
    names = (line.partition(":")[2].strip() for line in _proc("cpuinfo") if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


def load_average() -> float | None:
    """Of the last minute, where the system tells."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None


def package_versions() -> dict[str, str]:
    """Versions of `PACKAGES`, and of the library that decodes video, as PyAV states it."""
    import av

    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return {**versions, "libavcodec": ".".join(map(str, av.library_versions["libavcodec"]))}


def commit() -> str | None:
    """The commit of the checkout that this file lies in, `+` behind it where files differ from it."""
    folder = Path(__file__).resolve().parents[2]

    def git(*words: str) -> str:
        command = ["git", "-C", str(folder), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()

    try:
        if Path(git("rev-parse", "--show-toplevel")).resolve() != folder:
            return None
        changed = git("status", "--porcelain", "--untracked-files=no", "--", "runtime", "tinysplat", "models")
        return git("rev-parse", "--short=12", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.SubprocessError):
        return None


def _proc(name: str) -> list[str]:
    try:
        return Path("/proc", name).read_text("utf-8", "replace").splitlines()
    except OSError:
        return []
