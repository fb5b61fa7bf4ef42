"""Frames of a video file: when each is shown, and any one of them as a picture.

Times come from the container alone, so that a long video opens without being decoded; a frame is decoded from the key
frame before it. The picture is turned as the file asks players to, and its colours are brought to sRGB (`colours`).

Trust boundary: files, not addresses, of containers that cannot name other files; number and size of frames are bounded.
What libavformat and libavcodec raise becomes an InputError.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.sidedata.sidedata import Type
from numpy.typing import NDArray

from ..errors import InputError
from ..system.files import StrPath, check_readable, parsing
from .colours import of_code_points, to_srgb
from .images import MAX_PIXELS

SUFFIXES = (".mp4", ".mov", ".m4v", ".mkv", ".webm", ".ts")
"""Names of containers that give every frame its time."""

MAX_FRAMES = 1 << 20
"""9 hours at 30 frames a second."""

_CONTAINERS = "mov,matroska,mpegts"
_ATTACHED = 1 << 10  # FFmpeg's AV_DISPOSITION_ATTACHED_PIC: a cover, not a video
_RGB, _BT709, _UNSPECIFIED, _BT601, _BT2020 = 0, 1, 2, 5, 9  # matrices and primaries of ITU-T H.273
_MATRICES = (_RGB, _BT709, 4, _BT601, 6, 7, _BT2020)  # those that swscale knows
_HD_HEIGHT = 720  # pictures as high, and which do not say it, are taken for BT.709's, as players take them
_LONE_FRAME_S = 1 / 30  # how long a video's only frame is taken to be shown


@dataclass(frozen=True, eq=False)
class Video:
    """A video file that was looked through.

    Attributes:
        path: the file.
        stamps: (F,) int64, when each frame is shown, rising, in units of the stream.
        unit: seconds per unit of `stamps`.
        height, width: of a frame as players show it.
    """

    path: Path
    stamps: NDArray
    unit: float
    height: int
    width: int

    def index_at(self, seconds: float) -> int:
        """The frame shown nearest to a time from the first frame on.

        Raises:
            InputError: no frame is shown within a frame's time of it.
        """
        times = (self.stamps - self.stamps[0]) * self.unit  # (F,)
        nearest = int(np.argmin(np.abs(times - seconds)))
        tolerance = float(np.median(np.diff(times))) if len(times) > 1 else _LONE_FRAME_S
        if not abs(times[nearest] - seconds) <= tolerance:
            fault = f"no frame at {seconds:.3f} s, its {len(times)} frames are shown from 0 to {times[-1]:.3f} s"
            raise InputError(fault, where=str(self.path))
        return nearest

    def check_index(self, index: int) -> int:
        """The index, or InputError where there is no such frame."""
        if not 0 <= index < len(self.stamps):
            raise InputError(f"frame {index}, but its frames are 0 to {len(self.stamps) - 1}", where=str(self.path))
        return index

    def frame(self, index: int) -> NDArray:
        """A frame as (H, W, 3) uint8, sRGB.

        Raises:
            InputError: there is no such frame, or it cannot be decoded.
        """
        wanted = int(self.stamps[self.check_index(index)])
        for seeks in (True, False):  # some files find no key frame before a time, and are decoded from the first on
            with _opened(self.path) as (container, stream):
                if seeks:
                    container.seek(wanted, stream=stream)
                for picture in container.decode(stream):
                    if picture.pts is not None and picture.pts >= wanted:
                        if picture.pts == wanted:
                            return _shown(picture, stream)
                        break
        raise InputError(f"frame {index} cannot be decoded", where=str(self.path))

    def frames(self, chosen: Collection[int]) -> Iterator[tuple[int, NDArray]]:
        """Index and (H, W, 3) uint8 of each chosen frame that can be decoded, in one pass."""
        wanted = set(chosen)
        yield from ((index, _shown(picture, stream)) for index, picture, stream in self._decoded() if index in wanted)

    def thumbnails(self, width: int) -> Iterator[tuple[int, NDArray]]:
        """Index and luma (h, w) uint8 of every frame that can be decoded, so many pixels wide, as stored."""
        for index, picture, _ in self._decoded():
            size = min(width, picture.width), max(round(picture.height * min(width / picture.width, 1)), 1)
            yield index, picture.reformat(*size, format="gray").to_ndarray()

    def _decoded(self) -> Iterator[tuple[int, Any, Any]]:
        """Index and frame, from the first on, and the stream."""
        place = {int(stamp): index for index, stamp in enumerate(self.stamps)}
        with _opened(self.path) as (container, stream):
            stream.thread_type = "AUTO"
            for picture in container.decode(stream):
                if picture.pts in place:
                    yield place[picture.pts], picture, stream


def open_video(path: StrPath) -> Video:
    """Look through a video file.

    Raises:
        InputError: names the file: missing, of another kind, damaged, without frames or times, or too large.
    """
    check_readable(path)
    with _opened(Path(path)) as (container, stream):
        stamps: set[int] = set()
        for packet in container.demux(stream):
            if packet.size and not packet.is_discard:
                if packet.pts is None or len(stamps) >= MAX_FRAMES:
                    fault = "frames without times" if packet.pts is None else f"more than {MAX_FRAMES} frames"
                    raise InputError(f"{fault}; `ffmpeg -i IN OUT.mp4` writes a part of it anew")
                stamps.add(packet.pts)
        if not stamps:
            raise InputError("a video without frames")
        unit = float(stream.time_base)
    with _opened(Path(path)) as (container, stream):  # anew: at the end of a file with one key frame nothing seeks back
        first = next(container.decode(stream), None)
        if first is None:
            raise InputError("a video none of whose frames can be decoded")
        height, width = _shown(first, stream).shape[:2]
        return Video(Path(path), np.array(sorted(stamps), np.int64), unit, height, width)


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """The container and its largest video, for the time of the block."""
    options = {"format_whitelist": _CONTAINERS}
    try:
        with (
            parsing(f"video, accepted are {', '.join(SUFFIXES)}"),
            path.open("rb") as file,
            av.open(file, options=options, metadata_errors="replace") as container,
        ):
            videos = [one for one in container.streams.video if not getattr(one, "disposition", 0) & _ATTACHED]
            if not videos:
                raise InputError("holds no video")
            stream = max(videos, key=lambda one: one.width * one.height)
            if stream.codec_context is None:
                raise InputError("coded in a way that this build of av does not know")
            if not 0 < stream.width * stream.height <= MAX_PIXELS:
                raise InputError(f"{stream.width}x{stream.height} pixels, at most {MAX_PIXELS}")
            yield container, stream
    except InputError as error:
        raise InputError(error.message, where=str(path)) from None
    except av.FFmpegError as error:  # av's own PermissionError, for what libavformat finds unfit
        raise InputError(f"damaged or foreign video ({error.strerror})", where=str(path)) from None


def _shown(picture: Any, stream: Any) -> NDArray:
    """(H, W, 3) uint8 sRGB of an av.VideoFrame as players show it: its colours, and the quarter turns it asks for.

    Raises:
        InputError: its colours are coded in a way that is not read.
    """
    matrix = picture.side_data.get(Type.DISPLAYMATRIX)
    turns = 0
    if matrix is not None:
        cosine, sine = struct.unpack_from("<ii", bytes(matrix))  # libavutil/display.h: the first two of nine
        turns = -round(math.atan2(sine, cosine) / (math.pi / 2))
    return np.ascontiguousarray(np.rot90(_srgb(picture, stream.codec_context), turns))


def _srgb(picture: Any, said: Any) -> NDArray:
    """(H, W, 3) uint8 sRGB of an av.VideoFrame, which a codec context says the colours of."""
    primaries, transfer = int(said.color_primaries), int(said.color_trc)
    colours = of_code_points(primaries, transfer)
    if picture.colorspace == _UNSPECIFIED:
        is_wide = primaries == _BT2020 or (colours is not None and colours.is_hdr)
        picture.colorspace = _BT2020 if is_wide else _BT709 if picture.height >= _HD_HEIGHT else _BT601
    if picture.colorspace not in _MATRICES:
        known = ", ".join(map(str, _MATRICES))
        raise InputError(f"colours by matrix {int(picture.colorspace)} of ITU-T H.273, expected one of {known}")
    if colours is None and max(component.bits for component in picture.format.components) <= 8:
        return picture.to_ndarray(format="rgb24")
    deep = picture.to_ndarray(format="rgb48le")
    if colours is not None:
        return to_srgb(deep, colours)
    return ((deep.astype(np.uint32) * 255 + 32767) // 65535).astype(np.uint8)
