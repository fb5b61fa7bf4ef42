"""What the work needs in any case: libx265 and libavcodec alone on the same planes and streams, memory written once,
one `exp` a pixel of a footprint. Only held against it can be told what we add.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Lock, local
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.codec.hevc import CodedPlane, EncoderSettings, encode_plane
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.system.stopwatch import watched_parts
from tinysplat_runtime.system.threads import Crew

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
    return [
        Stream(
            container.parameter_sets[layer.parameter_set],
            _START_CODE + bytes(container.payload(index, channel, view)),
        )
        for index, layer in enumerate(container.layers)
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


def fill_memory(gaussians: Gaussians) -> Callable[[], Any]:
    """A call that writes as many numbers as Gaussians take into fresh memory."""
    shape = (*gaussians.opacities.shape, 11 + gaussians.sh.shape[-2] * 3)
    return lambda: np.full(shape, 1, np.float32)


def exponentials(gaussians: Gaussians, camera: Camera) -> Callable[[], Any]:
    """A call of one `exp` for every pixel of every footprint before it stops."""
    with watched_parts() as parts:
        Renderer(gaussians, 1, compiled=False).render(camera)
    count = parts.tallies["alphas above 1/255"]
    exponents = -np.random.default_rng(0).uniform(0, 5, count).astype(np.float32)
    out = np.empty_like(exponents)
    return lambda: np.exp(exponents, out=out)
