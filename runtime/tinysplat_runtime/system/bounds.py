"""Bounds of a process that reads files which a library may not survive, where the system has such bounds (Unix)."""

from __future__ import annotations

from pathlib import Path


def bound_process(memory: int, seconds: int) -> None:
    """Let this process take at most `memory` bytes of address space beyond what it holds, and so many CPU seconds."""
    try:
        import resource
    except ImportError:
        return
    pages = int(Path("/proc/self/statm").read_text().split()[0]) if Path("/proc/self/statm").exists() else 1 << 20
    held = pages * resource.getpagesize()
    for kind, wanted in ((resource.RLIMIT_AS, held + memory), (resource.RLIMIT_CPU, seconds)):
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))
