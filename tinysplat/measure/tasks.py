"""Pieces of work by name, for processes of their own: what peak memory and versions of the code are measured of.

Each takes strings, loads or makes what it needs, and returns the work as a call.
"""

from __future__ import annotations

import itertools
import subprocess
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

from tinysplat_runtime import Gaussians, Runtime, load_gaussians, load_scene
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.profiles import find_profile
from tinysplat_runtime.render import Renderer, between

from . import floors
from .subjects.made import made_gaussians, rolling_surface, view_between

Call = Callable[[], Any]


def predict(scene: str, model: str, threads: str) -> Call:
    """Photos to Gaussians."""
    runtime, loaded = Runtime(threads=int(threads)), load_scene(scene)
    return lambda: runtime.predict(loaded, model)


def encode(gaussians: str, profile: str, threads: str) -> Call:
    """Gaussians to a file's bytes."""
    runtime, loaded = Runtime(threads=int(threads)), _gaussians(gaussians)
    return lambda: runtime.compress(loaded, profile, drop_invalid=True)


def libx265(gaussians: str, profile: str, threads: str) -> Call:
    """The planes of `encode` alone."""
    runtime, recorder = Runtime(threads=int(threads)), floors.PlaneRecorder()
    encode_gaussians(_gaussians(gaussians), find_profile(profile), 0, runtime.store, threads=runtime.threads,
                     drop_invalid=True, plane_coder=recorder)  # fmt: skip
    return floors.encode_alone(recorder.planes, int(threads))


def decode(file: str, threads: str) -> Call:
    """A file's bytes to Gaussians."""
    runtime, data = Runtime(threads=int(threads)), Path(file).read_bytes()
    return lambda: runtime.decompress(data)


def libavcodec(file: str, threads: str) -> Call:
    """The streams of `decode` alone."""
    return floors.decode_alone(floors.file_streams(Path(file).read_bytes()), int(threads))


def fill(file: str) -> Call:
    """As many bytes as `decode` gives."""
    return floors.fill_memory(Runtime().decompress(Path(file).read_bytes()))


def render(gaussians: str, size: str, compiled: str, threads: str) -> Call:
    """The next frame of a path, so that no two calls in a row have the same camera."""
    loaded = _gaussians(gaussians)
    path = itertools.cycle(between(list(loaded.cameras), 8))
    renderer = Renderer(loaded, int(threads), compiled=compiled == "compiled")
    return lambda: renderer.render(next(path), _size(size))


def render_once(gaussians: str, size: str, compiled: str, threads: str) -> Call:
    """Preparing, and one frame."""
    loaded = _gaussians(gaussians)
    camera = view_between(loaded)
    return lambda: Renderer(loaded, int(threads), compiled=compiled == "compiled").render(camera, _size(size))


def exponentials(gaussians: str, size: str) -> Call:
    """One `exp` for every pixel of every footprint of a frame."""
    loaded = _gaussians(gaussians)
    return floors.exponentials(loaded, view_between(loaded).resized(*_size(size)))


def start(file: str, target: str) -> Call:
    """`tinysplat decode` as a process, from starting the interpreter to the written file."""
    command = [sys.executable, "-m", "tinysplat_runtime", "decode", file, "-o", target, "-q"]

    def run() -> None:
        Path(target).unlink(missing_ok=True)  # the command overwrites nothing
        subprocess.run(command, check=True, capture_output=True, timeout=120)

    return run


@lru_cache(maxsize=4)
def _gaussians(words: str) -> Gaussians:
    """A file's, or made: `network-like:VIEWSxHEIGHTxWIDTH`, `surface:VIEWSxHEIGHTxWIDTH`, of SH degree 3."""
    kind, _, size = words.partition(":")
    makers: dict[str, Callable[..., Gaussians]] = {"network-like": made_gaussians, "surface": rolling_surface}
    return makers[kind](*map(int, size.split("x")), 3) if kind in makers else load_gaussians(words)


def _size(text: str) -> tuple[int, int]:
    height, _, width = text.partition("x")
    return int(height), int(width)
