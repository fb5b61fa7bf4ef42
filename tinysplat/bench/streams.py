"""The video codec's share of the work: the planes of an encode and the streams of a file, coded by the library alone.

What the codec adds to libx265 and libavcodec can only be told apart from them when both are timed on the same planes in
the same run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from threading import local
from typing import Any

import av

from tinysplat_runtime.codec import encoder
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.system.threads import Crew

_START_CODE = b"\x00\x00\x00\x01"

PlaneCall = tuple[Any, ...]
"""Arguments of `codec.hevc.encode_plane`."""


@contextmanager
def recorded_planes() -> Iterator[list[PlaneCall]]:
    """While open, each plane that is encoded adds its codes, its QP and the encoder's settings to the list."""
    calls: list[PlaneCall] = []
    original = encoder.encode_plane

    def record(*arguments: Any) -> Any:
        calls.append(arguments)
        return original(*arguments)

    encoder.encode_plane = record  # type: ignore[assignment]
    try:
        yield calls
    finally:
        encoder.encode_plane = original


def encode_alone(planes: list[PlaneCall], threads: int) -> Callable[[], None]:
    """A call that has libx265 code the planes, as many at a time as the codec does."""

    def run() -> None:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda arguments: encoder.encode_plane(*arguments), planes))

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


def decode_alone(streams: list[Stream], threads: int) -> Callable[[], None]:
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
