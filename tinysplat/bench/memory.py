"""Peak memory of one piece of work, in a process of its own: `python -m tinysplat.bench.memory TASK INPUT OUTPUT`.

The child loads its input, sets the kernel's high-water mark back, works, and prints the mark. On Linux the mark is
`VmHWM` of /proc/self/status: `ru_maxrss` would start at the parent's size, which exec hands down to the child.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.system.files import StrPath
from tinysplat_runtime.system.stopwatch import peak_rss_bytes

TIMEOUT_S = 300


@dataclass(frozen=True)
class Peak:
    """What a child measured.

    Attributes:
        total: largest resident memory while it worked, its input and libraries included.
        before: resident memory when the work began.
    """

    total: int
    before: int


def _predict(path: Path, runtime: Runtime, model: str) -> Callable[[], Any]:
    scene = load_scene(path)
    return lambda: runtime.predict(scene, model)


def _predict_in_torch(path: Path, runtime: Runtime, checkpoint: str) -> Callable[[], Any]:
    from .official import checkpoint_task  # brings torch, which would weigh on the other tasks

    scene = load_scene(path)
    return lambda: checkpoint_task(Path(checkpoint), runtime.threads, scene)


def _encode(path: Path, runtime: Runtime, profile: str) -> Callable[[], Any]:
    gaussians = load_gaussians(path)
    return lambda: runtime.compress(gaussians, profile, drop_invalid=True)


def _decode(path: Path, runtime: Runtime, _: str) -> Callable[[], Any]:
    data = path.read_bytes()
    return lambda: runtime.decompress(data)


def _render(path: Path, runtime: Runtime, size: str) -> Callable[[], Any]:
    gaussians = load_gaussians(path)
    height, width = (int(n) for n in size.split("x"))
    return lambda: runtime.render(gaussians, gaussians.cameras[0], (height, width))


TASKS: dict[str, Callable[[Path, Runtime, str], Callable[[], Any]]] = {
    "network": _predict,
    "checkpoint": _predict_in_torch,
    "encode": _encode,
    "decode": _decode,
    "render": _render,
}
"""What a child can do: (input, runtime, option) to the work."""


def measure_peak(task: str, path: StrPath, option: str, threads: int) -> Peak:
    """Peak memory of a task of `TASKS` in a fresh process.

    Raises:
        TinySplatError: the child failed; its last line says why.
    """
    command = [sys.executable, "-m", "tinysplat.bench.memory", task, str(path), option, str(threads)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=TIMEOUT_S)
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        raise TinySplatError(lines[-1], where=f"peak memory of {task}")
    return Peak(**json.loads(done.stdout))


def peak_of_gaussians(task: str, gaussians: Gaussians, option: str, threads: int) -> Peak:
    """`measure_peak` of a task that starts from Gaussians."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "g.npz"
        save_gaussians(path, gaussians)
        return measure_peak(task, path, option, threads)


def peak_of_file(data: bytes, threads: int) -> Peak:
    """`measure_peak` of decoding a `.tsplat` file's bytes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "f.tsplat"
        path.write_bytes(data)
        return measure_peak("decode", path, "", threads)


def main(arguments: list[str]) -> None:
    """Do one task in this process and print its `Peak` as JSON."""
    task, path, option, threads = arguments
    work = TASKS[task](Path(path), Runtime(threads=int(threads)), option)
    before = _reset_high_water_mark()
    work()
    print(json.dumps({"total": _high_water_mark(), "before": before}))


def _reset_high_water_mark() -> int:
    """Set the mark back to what is resident now, and return that; where it can't be set back, the mark so far."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    return _high_water_mark()


def _high_water_mark() -> int:
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) * 1024
    return peak_rss_bytes()


if __name__ == "__main__":
    main(sys.argv[1:])
