"""What a run was made on, without which a time is no figure: processor, memory, versions, and the checkout's commit."""

import contextlib
import importlib.metadata
import os
import platform
import re
import subprocess
import time
from pathlib import Path

from tinysplat_runtime import __version__
from tinysplat_runtime.system.jsonfields import JsonObject
from tinysplat_runtime.system.threads import available_cores

from .rows import Row

RUN = "run"
"""`Row.study` of the row that says what a run was made on."""

PACKAGES = ("numpy", "onnxruntime", "av", "torch", "numba", "gsplat", "gaussforge", "zstandard")
"""Packages whose version a figure may depend on; those that are not installed are left out."""

_SHOWN = (
    "runtime/tinysplat_runtime/cli",
    "runtime/tinysplat_runtime/page",
    "runtime/tinysplat_runtime/web",
    "tinysplat/measure/show",
    "tinysplat/measure/pages.py",
)
DEPENDED_ON = ("runtime", "tinysplat", "models", *(f":!{path}" for path in _SHOWN))
"""Of a checkout, what figures depend on, as git's pathspecs: all code but what asks and what shows."""

_VECTOR_FLAGS = ("avx2", "avx512f", "avx512_vnni", "amx_tile", "asimd", "sve")


def describe_machine() -> JsonObject:
    """Processor, memory, load and versions, JSON-ready."""
    import av

    cpu, flags, memory = platform.processor() or platform.machine(), "", None
    with contextlib.suppress(OSError):  # not on Linux
        described: dict[str, str] = dict(
            re.findall(r"^(.+?)\s*: (.*)$", Path("/proc/cpuinfo").read_text("utf-8", "replace"), re.MULTILINE)
        )
        cpu = described.get("model name", cpu).strip()
        flags = described.get("flags") or described.get("Features") or ""
        memory = 1024 * int(Path("/proc/meminfo").read_text("utf-8").split()[1])  # MemTotal comes first
    installed = {}
    for name in PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            installed[name] = importlib.metadata.version(name)
    return {
        "time": time.strftime("%Y-%m-%d %H:%M %Z"),
        "cpu": cpu,
        "vector_extensions": [flag for flag in _VECTOR_FLAGS if flag in flags.split()],
        "cores": available_cores(),
        "cores_of_machine": os.cpu_count(),
        "memory_bytes": memory,
        "load_average": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "system": platform.platform(),
        "python": platform.python_version(),
        "tinysplat": __version__,
        "commit": commit(),
        **installed,
        "libavcodec": ".".join(map(str, av.library_versions["libavcodec"])),
    }


def run_row(way: str, began: float, **setting: object) -> Row:
    """What a run was made on, which began at `time.perf_counter() == began`."""
    machine = describe_machine()
    return Row(RUN, machine["time"], way, setting, machine, {"seconds": time.perf_counter() - began})


def commit() -> str | None:
    """The commit of the checkout that this file lies in, `+` behind it where files that figures depend on differ."""
    folder = Path(__file__).resolve().parents[2]
    try:
        if Path(git(folder, "rev-parse", "--show-toplevel")).resolve() != folder:
            return None
        changed = git(folder, "status", "--porcelain", "--untracked-files=no", "--", *DEPENDED_ON)
        return git(folder, "rev-parse", "--short=12", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.SubprocessError):
        return None


def git(folder: Path, *words: str) -> str:
    """What git says; CalledProcessError where it refuses."""
    command = ["git", "-C", str(folder), *words]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()
