"""One plane or photo, one HEVC intra picture: libx265 in, libavcodec out, both through PyAV.

A picture's parameter sets (VPS, SPS, PPS) depend on its size and the encoder's settings alone, never on its QP, so a
file stores them once and this module takes them off every picture. What is left is a single slice NAL unit.
"""

from __future__ import annotations

import contextlib
import re
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING

import av
import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError, TinySplatError
from ..gaussian.planes import BIT_DEPTH, MAX_QP, QP_BLOCK, padded_size, qp_block_side

if TYPE_CHECKING:  # who decodes knows no profiles
    from .profiles import EncoderSettings

_PIXEL_FORMAT = "gray12le"
_START_CODE = b"\x00\x00\x00\x01"
_VPS, _SPS, _PPS = 32, 33, 34
_IDR_TYPES = (19, 20)
_BUFFER_MARGIN = 128
_TIME_BASE = Fraction(1, 25)

# One thread and no analysis over time: a plane's bytes depend on the plane alone. ipratio=1 keeps the QP asked for,
# which x265 would lower by 3 for intra pictures; info=0 keeps its banner out of the stream.
_FIXED_PARAMS = "log-level=none:info=0:keyint=1:no-scenecut=1:bframes=0:wpp=0:frame-threads=1:pools=none:ipratio=1"

_ONE_QP = "aq-mode=0:qp={qp}"

# x265 takes QPs by blocks only where it adapts them itself and only under rate control: the strength leaves nothing of
# its own choices, and qcomp=1 makes the constant rate factor the QP of every picture. Coding trees are no larger than
# the blocks: x265 likes to code a tree as a whole, and then at the mean of its blocks' QPs.
_BLOCK_QPS = f"aq-mode=1:aq-strength=0.0001:qcomp=1:no-cutree=1:qg-size={QP_BLOCK}:ctu={{tree}}:crf={{qp}}"
_LARGEST_TREE = 32

_OFFSET_RANGE = MAX_QP + 6 * (BIT_DEPTH - 8)
"""QPs that libavcodec makes of a region's offset of 1."""

_MEMORY_PER_PICTURE, _MEMORY_PER_PIXEL = 150_000_000, 32
"""Bytes of addresses that libx265 and libavcodec take for one picture, most of them room that a thread's first `malloc`
sets aside; 68 to 140 MB as measured for pictures of 64² to 2048² pixels, a few of which are ever touched."""

_under_way: list[int] = []
"""Pixels of the pictures that threads are coding."""

_count = threading.Lock()

av.logging.set_level(None)  # any level calls Python from its threads, which may wait for this one


@dataclass(frozen=True)
class CodedPlane:
    """A coded picture: `parameter_sets` with start codes, `payload` one slice NAL unit without."""

    parameter_sets: bytes
    payload: bytes

    def decoded(self, height: int, width: int) -> NDArray:
        """(H, W) uint16 of the picture of a plane of that size; errors of `PlaneDecoder`."""
        out = np.empty((height, width), np.uint16)
        PlaneDecoder(self.parameter_sets, height, width).decode_into(self.payload, out)
        return out


def pad_plane(codes: NDArray) -> NDArray:
    """Extend a plane (H, W) of any dtype to `padded_size` by repeating its last row and column."""
    height, width = codes.shape
    to_height, to_width = padded_size(height, width)
    if (to_height, to_width) == (height, width):
        return np.ascontiguousarray(codes)
    return np.pad(codes, ((0, to_height - height), (0, to_width - width)), mode="edge")


def encode_plane(codes: NDArray, qp: int, settings: EncoderSettings, offsets: NDArray | None = None) -> CodedPlane:
    """Code one plane.

    Args:
        codes: (H, W) uint16, 0 to 4095.
        qp: 0 to 51.
        settings: libx265's preset and parameters.
        offsets: (ceil(H / 16), ceil(W / 16)) whole numbers added to the QP of blocks of `QP_BLOCK` pixels, if
            `EncoderSettings.block_qps`.

    Returns:
        The coded picture, of size `padded_size(H, W)`.
    """
    return encode_picture([pad_plane(codes)], _PIXEL_FORMAT, qp, settings, offsets)


def encode_picture(
    planes: Sequence[NDArray], pixel_format: str, qp: int, settings: EncoderSettings, offsets: NDArray | None = None
) -> CodedPlane:
    """Code the planes (h, w) uint16 of one picture, in the sizes that libavcodec's pixel format demands.

    Raises:
        MemoryError: less memory is to be had than libx265 may take, which ends the process or waits for ever without.
    """
    with _room_for(planes[0].size):
        return _coded(planes, pixel_format, qp, settings, offsets)


@contextlib.contextmanager
def _room_for(pixels: int) -> Iterator[None]:
    """Of addresses, which a bound of the process counts: so much is free for this picture and those under way."""
    with _count:
        needed = sum(_MEMORY_PER_PICTURE + _MEMORY_PER_PIXEL * n for n in (*_under_way, pixels))
        np.empty(needed, np.uint8)  # none of it is touched
        _under_way.append(pixels)
    try:
        yield
    finally:
        with _count:
            _under_way.remove(pixels)


def _coded(
    planes: Sequence[NDArray], pixel_format: str, qp: int, settings: EncoderSettings, offsets: NDArray | None
) -> CodedPlane:
    context = av.CodecContext.create("libx265", "w")
    context.height, context.width = planes[0].shape
    context.pix_fmt = pixel_format
    context.time_base, context.framerate = _TIME_BASE, 1 / _TIME_BASE
    tree = min(qp_block_side(context.height, context.width), _LARGEST_TREE)
    control = (_BLOCK_QPS if settings.block_qps else _ONE_QP).format(qp=qp, tree=tree)
    context.options = {"preset": settings.preset, "x265-params": ":".join((_FIXED_PARAMS, control, *settings.params))}
    frame = av.VideoFrame(context.width, context.height, pixel_format)
    for plane, samples in zip(frame.planes, planes, strict=True):
        lines = np.zeros((plane.height, plane.line_size // 2), np.uint16)
        lines[:, : plane.width] = samples
        plane.update(lines.tobytes())
    frame.pts = 0
    if offsets is not None:
        frame = _with_offsets(frame, offsets)
    stream = b"".join(bytes(packet) for packet in (*context.encode(frame), *context.encode(None)))
    units = _nal_units(stream)
    slices = [unit for unit in units if _nal_type(unit) in _IDR_TYPES]
    if len(slices) != 1:
        raise TinySplatError(f"libx265 gave {len(slices)} slices for one picture, expected 1")
    sets = b"".join(_START_CODE + unit for unit in units if _nal_type(unit) in (_VPS, _SPS, _PPS))
    return CodedPlane(sets, slices[0])


def _with_offsets(frame: av.VideoFrame, offsets: NDArray) -> av.VideoFrame:
    """The frame with a region of interest for every rectangle of blocks of one offset other than 0.

    PyAV cannot attach regions to a frame; libavfilter's addroi adds one. 256 of them take 3 ms, 1024 take 15.
    """
    graph = av.filter.Graph()
    last = graph.add_buffer(width=frame.width, height=frame.height, format=frame.format, time_base=_TIME_BASE)
    for rows, columns, offset in rectangles(offsets):
        x, y = columns.start * QP_BLOCK, rows.start * QP_BLOCK
        width, height = min(columns.stop * QP_BLOCK, frame.width) - x, min(rows.stop * QP_BLOCK, frame.height) - y
        region = graph.add("addroi", f"x={x}:y={y}:w={width}:h={height}:qoffset={offset}/{_OFFSET_RANGE}")
        last.link_to(region)
        last = region
    last.link_to(graph.add("buffersink"))
    graph.configure()
    graph.push(frame)
    marked = graph.pull()
    assert isinstance(marked, av.VideoFrame)
    return marked


def rectangles(offsets: NDArray) -> list[tuple[slice, slice, int]]:
    """Rows, columns and value of rectangles that cover all but the zeros of a grid (h, w) of integers, none twice.

    Runs of a row, each with what continues it in the rows below.
    """
    runs: dict[tuple[int, int, int], int] = {}  # open ones: first row by columns and value
    found = []
    for row, values in enumerate([*offsets.tolist(), []]):
        edges = [0, *(i for i in range(1, len(values)) if values[i] != values[i - 1]), len(values)]
        present = {(a, b, values[a]) for a, b in pairwise(edges) if b > a and values[a] != 0}
        for run in [run for run in runs if run not in present]:
            start, stop, value = run
            found.append((slice(runs.pop(run), row), slice(start, stop), value))
        for run in sorted(present):
            runs.setdefault(run, row)
    return found


class PictureDecoder:
    """Decodes pictures of one size and format; keeps libavcodec's context from one to the next. Not for sharing among
    threads.
    """

    def __init__(self, parameter_sets: bytes, height: int, width: int, pixel_format: str) -> None:
        """Open libavcodec.

        Args:
            parameter_sets: VPS, SPS and PPS with start codes.
            height, width: size of the coded pictures.
            pixel_format: what they must be, in libavcodec's words, of 16-bit samples.

        Raises:
            FormatError: libavcodec refuses the parameter sets.
        """
        self._expected = (height, width, pixel_format)
        self._context = av.CodecContext.create("hevc", "r")
        self._context.thread_count = 1
        self._context.extradata = parameter_sets
        # A stream that claims a much larger size is stopped before its pictures are allocated; libavcodec counts
        # pixels with the margins of its buffers, and the exact size is checked once there is a picture.
        # Damage that libavcodec sees is an error, and not hidden: of slices that end too early or late it sees none.
        most = str((height + _BUFFER_MARGIN) * (width + _BUFFER_MARGIN))
        self._context.options = {"max_pixels": most, "err_detect": "explode"}

    def decode(self, payload: bytes | memoryview) -> list[NDArray]:
        """The planes of one picture given as a slice NAL unit: (h, w) uint16 views, good until the next call.

        Raises:
            FormatError: the payload is no single intra picture of this size and format.
        """
        data = bytes(payload)
        if len(data) < 3 or _nal_type(data) not in _IDR_TYPES or b"\x00\x00\x01" in data:
            raise FormatError("not a single HEVC intra slice", where="plane")
        try:
            frames = self._context.decode(av.Packet(_START_CODE + data))
        except (av.FFmpegError, MemoryError) as error:
            raise FormatError(f"libavcodec: {str(error).splitlines()[0]}", where="plane") from None
        if len(frames) != 1:
            raise FormatError(f"{len(frames)} pictures decoded, expected 1", where="plane")
        frame = frames[0]
        found = (frame.height, frame.width, frame.format.name)
        if found != self._expected:
            height, width, pixel_format = self._expected
            expected = f"{width}x{height} {pixel_format}"
            raise FormatError(f"picture is {found[1]}x{found[0]} {found[2]}, expected {expected}", where="plane")
        return [
            np.frombuffer(memoryview(p), np.uint16).reshape(p.height, p.line_size // 2)[:, : p.width]
            for p in frame.planes
        ]


class PlaneDecoder(PictureDecoder):
    """Decodes planes of one size."""

    def __init__(self, parameter_sets: bytes, height: int, width: int) -> None:
        """Arguments and errors of `PictureDecoder`; height and width are the plane's own, before padding."""
        super().__init__(parameter_sets, *padded_size(height, width), _PIXEL_FORMAT)

    def decode_into(self, payload: bytes | memoryview, out: NDArray) -> None:
        """Decode one slice NAL unit into `out` (H, W) uint16.

        Raises:
            FormatError: the payload is no single intra picture of this size.
        """
        (plane,) = self.decode(payload)
        out[...] = plane[: out.shape[0], : out.shape[1]]


def _nal_units(stream: bytes) -> list[bytes]:
    # A trailing zero byte belongs to the next start code: a NAL unit never ends in one.
    return [unit.rstrip(b"\x00") for unit in re.split(b"\x00\x00\x01", stream)[1:]]


def _nal_type(unit: bytes) -> int:
    return (unit[0] >> 1) & 63
