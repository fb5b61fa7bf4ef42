"""Frames of a video file: when each is shown, and any one of them as a picture.

Times come from the container alone, so that a long video opens without being decoded; a frame is decoded from the key
frame before it. The picture is what players show: turned or mirrored as the file says, its pixels square, one field of
interlaced frames, its colours sRGB (`colours`). Frames that the decoder marks as damaged are left out, and so are those
after them up to the next key frame, which repeat the damage.

Trust boundary: files, not addresses, of containers that cannot name other files; number and size of frames are bounded.
What libavformat and libavcodec raise becomes an InputError.
"""

import re
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

from ..errors import InputError, warn
from ..system.files import StrPath, check_readable, parsing
from .colours import of_code_points, to_srgb
from .images import MAX_PIXELS
from .matches import doubled
from .resampling import scaled

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
_WHOLE = 0.9  # of the time that a file states, that its frames last if it is not cut short
_LOOK_SIDE = 640  # pixels of a frame in which two pictures are looked for
_STRAIGHT = 0.02  # of the largest entry of a display matrix, that others are noise
_MOST_STRETCHED = 4  # times that pixels are wider than high, or higher than wide
_BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")  # that MP4 and QuickTime begin with
_STEREO = {
    1: "side by side",
    2: "one above the other",
    3: "in turns",
    4: "in a chequer",
    5: "side by side",
    6: "by lines",
}


@dataclass(frozen=True, eq=False)
class Video:
    """A video file that was looked through.

    Attributes:
        path: the file.
        stamps: (F,) int64, when each frame is shown, rising, in units of the stream.
        unit: seconds per unit of `stamps`.
        height, width: of a frame as players show it.
        stored: (height, width) of its pixels as stored, which need not be square.
    """

    path: Path
    stamps: NDArray
    unit: float
    height: int
    width: int
    stored: tuple[int, int]

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

    def frame(self, index: int, *, is_square: bool = True) -> NDArray:
        """A frame as (H, W, 3) uint8, sRGB, its pixels square or as stored.

        Raises:
            InputError: there is no such frame, or it is damaged.
        """
        wanted = int(self.stamps[self.check_index(index)])
        for seeks in (True, False):  # some files find no key frame before a time, and are decoded from the first on
            with _opened(self.path) as (container, stream):
                if seeks:
                    container.seek(wanted, stream=stream)
                for picture, is_whole in _pictures(container, stream):
                    if picture.pts is not None and picture.pts >= wanted:
                        if picture.pts == wanted and is_whole:
                            return _shown(picture, stream, is_square=is_square)
                        break
        raise InputError(f"frame {index} is damaged: it cannot be decoded", where=str(self.path))

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
            for picture, is_whole in _pictures(container, stream):
                if picture.pts in place and is_whole:
                    yield place.pop(picture.pts), picture, stream
        if place:
            first = (min(place) - self.stamps[0]) * self.unit
            fault = f"{len(place)} of {len(self.stamps)} frames are damaged and left out"
            warn(f"{self.path}: {fault}, the first at {first:.1f} s")


def open_video(path: StrPath) -> Video:
    """Look through a video file.

    Raises:
        InputError: names the file: missing, of another kind, damaged, without frames or times, or too large.
    """
    check_readable(path)
    with _opened(Path(path)) as (container, stream):
        stamps: set[int] = set()
        end = 0
        for packet in container.demux(stream):
            if packet.size and not packet.is_discard and not packet.is_corrupt:
                if packet.pts is None or len(stamps) >= MAX_FRAMES:
                    fault = "frames without times" if packet.pts is None else f"more than {MAX_FRAMES} frames"
                    raise InputError(f"{fault}; `ffmpeg -i IN OUT.mp4` writes a part of it anew")
                stamps.add(packet.pts)
                end = max(end, packet.pts + (packet.duration or 0))
        if not stamps:
            raise InputError("a video without frames")
        unit = float(stream.time_base)
        lasts, stated, promised = (end - min(stamps)) * unit, _stated_length(stream), stream.frames
    if lasts < _WHOLE * stated:
        count = f"{len(stamps)} of {promised}" if promised > len(stamps) else f"{len(stamps)}"
        warn(f"{path}: cut short: {count} frames are there, {lasts:.1f} of {stated:.1f} s")
    with _opened(Path(path)) as (container, stream):  # anew: at the end of a file with one key frame nothing seeks back
        first = next((picture for picture, is_whole in _pictures(container, stream) if is_whole), None)
        if first is None:
            raise InputError("a video none of whose frames can be decoded")
        if (stereo := first.side_data.get(Type.STEREO3D)) is not None:
            (kind,) = struct.unpack_from("<i", bytes(stereo))  # libavutil/stereo3d.h
            _check_single(_STEREO.get(kind, ""))
        picture = _shown(first, stream)
        (height, width, _), (*stored, _) = picture.shape, _shown(first, stream, is_square=False).shape
        shrink = min(1.0, _LOOK_SIDE / max(height, width))
        _check_single(doubled(scaled(picture, round(height * shrink), round(width * shrink))))
        return Video(Path(path), np.array(sorted(stamps), np.int64), unit, height, width, (stored[0], stored[1]))


def _check_single(doubled: str) -> None:
    """InputError where a frame is two pictures, doubled in that way."""
    if doubled:
        layout = "abl" if "above" in doubled else "sbsl"
        fault = f"two pictures {doubled} (stereo 3D), expected one"
        raise InputError(f"{fault}: `ffmpeg -i IN -vf stereo3d={layout}:ml OUT.mp4` takes the left one")


def _stated_length(stream: Any) -> float:
    """Seconds that a file says its video lasts, where a cut leaves that as it is; else 0."""
    if stream.duration is not None and stream.frames:  # MP4's index
        return float(stream.duration * stream.time_base)
    stated = re.fullmatch(r"(\d+):(\d+):(\d+\.?\d*)", stream.metadata.get("DURATION", ""))  # Matroska's
    return sum(float(word) * unit for word, unit in zip(stated.groups(), (3600, 60, 1), strict=True)) if stated else 0.0


def _pictures(container: Any, stream: Any) -> Iterator[tuple[Any, bool]]:
    """Frames as decoded, each with whether it is whole."""
    stream.thread_type = "AUTO"  # by slices alone, libavcodec marks no damage
    is_whole = True
    for packet in container.demux(stream):
        try:
            pictures = packet.decode()
        except av.FFmpegError:
            is_whole = False
            continue
        for picture in pictures:
            is_whole = not picture.is_corrupt and (is_whole or picture.key_frame)
            yield picture, is_whole


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """The container and its largest video, for the time of the block."""
    options = {"format_whitelist": _CONTAINERS}
    try:
        with (
            parsing("video"),
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
        is_foreign = error.message.startswith("damaged or foreign")
        raise InputError((is_foreign and _cause(path)) or error.message, where=str(path)) from None
    except av.FFmpegError as error:  # av's own PermissionError, for what libavformat finds unfit
        raise InputError(_cause(path) or f"damaged or foreign video ({error.strerror})", where=str(path)) from None


def _cause(path: Path) -> str:
    """Why a file cannot be opened, where its beginning or a box that MP4 lacks says so; else nothing."""
    boxes = set()
    with path.open("rb") as file:
        start = file.read(8)
        if start[4:] not in _BOXES:
            is_video = start.startswith((b"\x1aE\xdf\xa3", b"G"))  # Matroska, MPEG-TS
            accepted = f"expected a video ({', '.join(SUFFIXES)})"
            return "" if is_video else f"starts with {start[:4].hex(' ') or 'nothing'}, {accepted}"
        file.seek(0)
        while len(box := file.read(16)) >= 8:
            size = int.from_bytes(box[8:] if box[:4] == b"\0\0\0\1" else box[:4], "big")
            boxes.add(box[4:8])
            if size < 8:
                break
            file.seek(size - len(box), 1)
    lost = "its index (moov), which recorders write at the end, is not there"
    return "" if b"moov" in boxes else f"cut short: {lost}; tools such as untrunc restore it from another clip"


def _shown(picture: Any, stream: Any, *, is_square: bool = True) -> NDArray:
    """(H, W, 3) uint8 sRGB of an av.VideoFrame as players show it, or with pixels that need not be square.

    Raises:
        InputError: its colours, the shape of its pixels or its turn are such as are not read.
    """
    pixels = _srgb(picture, stream.codec_context)
    if picture.interlaced_frame and len(pixels) > 2:
        pixels = _progressive(pixels)
    shape = stream.sample_aspect_ratio or stream.codec_context.sample_aspect_ratio
    if is_square and shape and shape != 1:
        if not 1 / _MOST_STRETCHED <= shape <= _MOST_STRETCHED:
            raise InputError(f"pixels {shape} times as wide as high, expected at most {_MOST_STRETCHED}")
        height, width = pixels.shape[:2]
        size = (height, round(width * shape)) if shape > 1 else (round(height / shape), width)
        pixels = np.rint(scaled(pixels, *size) * 255).astype(np.uint8)
    matrix = picture.side_data.get(Type.DISPLAYMATRIX)
    if matrix is None:
        return pixels
    xx, xy, _, yx, yy = struct.unpack_from("<5i", bytes(matrix))  # libavutil/display.h: two of three rows
    turn = np.array([[xx, xy], [yx, yy]], np.float64)
    is_set = np.abs(turn) > _STRAIGHT * np.abs(turn).max()
    if not is_set.any():
        return pixels
    if is_set.sum() != 2 or is_set[0, 0] != is_set[1, 1]:
        raise InputError("shown turned by no quarter, expected 0, 90, 180 or 270 degrees")
    if is_set[0, 1]:  # what lies to the right is shown below or above
        pixels, turn = pixels.swapaxes(0, 1), turn[::-1]
    return np.ascontiguousarray(pixels[:: int(np.sign(turn[1, 1])), :: int(np.sign(turn[0, 0]))])


def _progressive(pixels: NDArray) -> NDArray:
    """A frame (H, W, 3) uint8 of two fields, as its first one shows it where they differ."""
    levels = pixels[..., 1].astype(np.int16)
    beside, beyond = (np.abs(levels[n:] - levels[:-n]).mean() for n in (1, 2))
    if beside <= beyond:
        return pixels
    field = pixels[::2].astype(np.uint16)
    whole = pixels.copy()
    between = (field[:-1] + field[1:] + 1) // 2
    whole[1 : 2 * len(between) : 2] = between
    whole[2 * len(between) + 1 :: 2] = pixels[2 * len(between)]
    return whole


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
