"""Pieces of work by name, for processes of their own (peak memory), and the libraries beneath them alone: libx265 and
libavcodec on the same planes and streams. Only held against what the work needs in any case can be told what we add.

A task takes strings, loads or makes what it needs, and returns the work as a call.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from threading import Lock, local
from typing import Any

import av
from numpy.typing import NDArray

from tinysplat_runtime import Gaussians, Runtime, load_gaussians, load_scene
from tinysplat_runtime.codec.hevc import CodedPlane, encode_plane
from tinysplat_runtime.codec.profiles import EncoderSettings
from tinysplat_runtime.container.planes import Planes
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.system.threads import Crew

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


def decode(file: str, threads: str) -> Call:
    """A file's bytes to Gaussians."""
    runtime, data = Runtime(threads=int(threads)), Path(file).read_bytes()
    return lambda: runtime.decompress(data)


def render_once(gaussians: str, size: str, compiled: str, threads: str) -> Call:
    """Preparing, and one frame."""
    loaded = _gaussians(gaussians)
    camera = view_between(loaded)
    return lambda: Renderer(loaded, int(threads), compiled=compiled == "compiled").render(camera, _size(size))


def start(file: str, target: str) -> Call:
    """`tinysplat decode` as a process, from starting the interpreter to the written file."""
    command = [sys.executable, "-m", "tinysplat_runtime", "decode", file, "-o", target, "-q"]

    def run() -> None:
        Path(target).unlink(missing_ok=True)  # the command overwrites nothing
        subprocess.run(command, check=True, capture_output=True, timeout=120)

    return run


@lru_cache(maxsize=4)
def _gaussians(words: str) -> Gaussians:
    """A file's, or made: `network-like:VIEWSxWIDTHxHEIGHT`, `surface:VIEWSxWIDTHxHEIGHT`, of SH degree 3."""
    kind, _, size = words.partition(":")
    makers: dict[str, Callable[..., Gaussians]] = {"network-like": made_gaussians, "surface": rolling_surface}
    if kind not in makers:
        return load_gaussians(words)
    views, width, height = map(int, size.split("x"))
    return makers[kind](views, height, width, 3)


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    return int(height), int(width)


# ---- the libraries alone -----------------------------------------------------------------------------------------

_START_CODE = b"\x00\x00\x00\x01"


@dataclass
class PlaneRecorder:
    """Codes planes as the codec does, and remembers them; give it to `encode_gaussians` as its `plane_coder`."""

    planes: list[tuple[Any, ...]] = field(default_factory=list)
    _lock: Any = field(default_factory=Lock)

    def __call__(self, codes: NDArray, qp: int, settings: EncoderSettings, offsets: NDArray | None) -> CodedPlane:
        """See `codec.hevc.encode_plane`."""
        with self._lock:
            self.planes.append((codes, qp, settings, offsets))
        return encode_plane(codes, qp, settings, offsets)


def encode_alone(planes: Sequence[tuple[Any, ...]], threads: int) -> Callable[[], None]:
    """A call that has libx265 code recorded planes, as many at a time as the codec does."""

    def run() -> None:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda arguments: encode_plane(*arguments), planes))

    return run


@dataclass(frozen=True)
class Stream:
    """One coded picture with the parameter sets that it needs."""

    parameter_sets: bytes
    packet: bytes


def file_streams(data: bytes) -> list[Stream]:
    """All pictures of a `.tsplat` file."""
    container = read_container(data)
    assert isinstance(container.body, Planes), "only planes are pictures that libavcodec alone can decode"
    return [
        Stream(
            container.parameter_sets[layer.parameter_set],
            _START_CODE + bytes(container.pictures.payload(index, channel, view)),
        )
        for index, layer in enumerate(container.body.layers)
        for channel in layer.channels
        for view in range(len(channel.streams))
    ]


def decode_alone(streams: Sequence[Stream], threads: int) -> Callable[[], None]:
    """A call that has libavcodec decode the streams: no CRC, no check, nothing copied out of its pictures."""
    crew = Crew(threads)

    def run() -> None:
        own = local()

        def decode(stream: Stream) -> None:
            contexts = own.__dict__.setdefault("contexts", {})
            if stream.parameter_sets not in contexts:
                context = av.CodecContext.create("hevc", "r")
                context.thread_count = 1
                context.extradata = stream.parameter_sets
                contexts[stream.parameter_sets] = context
            if len(contexts[stream.parameter_sets].decode(av.Packet(stream.packet))) != 1:
                raise AssertionError("libavcodec returned no picture for a packet")

        crew.map(decode, streams)

    return run
