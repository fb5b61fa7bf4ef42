"""Rendered frames to an H.264 video in an .mp4 file that any browser plays.

One frame is held at a time. Colour is tagged and coded as BT.709, limited range, 4:2:0.
"""

import errno
import os
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.video.reformatter import ColorRange
from numpy.typing import NDArray

from ..errors import InputError
from ..scene.pictures import to_uint8
from ..system.files import StrPath, atomic_path

ENCODERS = ("libx264", "libopenh264")
"""H.264 encoders that builds of libavcodec come with, the better one first."""

_ENCODER_OPTIONS = {"libx264": {"crf": "18", "preset": "medium"}, "libopenh264": {"rc_mode": "quality"}}

_BT709 = 1  # the same number for primaries, transfer and matrix (ITU-T H.273)

_LUMA = np.array([0.2126, 0.7152, 0.0722])
_RGB_TO_YCC = np.stack(
    [
        219 * _LUMA,
        112 * (np.array([0, 0, 1]) - _LUMA) / (1 - _LUMA[2]),
        112 * (np.array([1, 0, 0]) - _LUMA) / (1 - _LUMA[0]),
    ]
).astype(np.float32) / np.float32(255)
"""Rows Y, Cb, Cr of the limited range from RGB of 0 to 255 (ITU-R BT.709, section 3)."""

_YCC_OFFSET = np.array([16, 128, 128], np.float32)


def write_video(path: StrPath, frames: Iterable[NDArray], fps: float = 30) -> None:
    """Encode frames as they come, atomically: an error midway leaves no file.

    Odd sizes are padded to even ones, which 4:2:0 needs, by repeating the last row or column.

    Args:
        path: the file to write, ending in .mp4.
        frames: (H, W, 3) images of one size, uint8 or floating point in [0, 1].
        fps: frames a second, > 0.

    Raises:
        InputError: another suffix, no frames, frames of another shape, NaN, or no encoder in this build of av.
        OSError: the file cannot be written; names it.
    """
    if Path(path).suffix.lower() != ".mp4":
        raise InputError(f"suffix '{Path(path).suffix}', expected .mp4", where=str(path))
    if not 0 < fps < 1000:
        raise InputError(f"{fps:g} frames a second, expected more than 0 and less than 1000", where=str(path))
    with atomic_path(path) as temporary:
        try:
            with av.open(str(temporary), "w", format="mp4", options={"movflags": "faststart"}) as container:
                _encode(container, frames, Fraction(fps).limit_denominator(1001))
        except InputError as error:
            raise error.within(str(path)) from None
        except av.FFmpegError as error:
            # the system's, such as a full disk, rather than libavcodec's own
            if error.errno is not None and error.errno in errno.errorcode:
                raise OSError(error.errno, os.strerror(error.errno), str(path)) from None
            raise InputError(f"cannot be encoded ({error.strerror})", where=str(path)) from None


def _encode(container: Any, frames: Iterable[NDArray], fps: Fraction) -> None:
    stream: Any = None
    shape: tuple[int, ...] = ()
    for number, image in enumerate(frames):
        pixels = to_uint8(image)
        if stream is None:
            shape = pixels.shape
            if len(shape) != 3 or shape[2] != 3 or 0 in shape:
                raise InputError(f"frame of shape {shape}, expected (H, W, 3)")
            stream = _add_stream(container, shape[0], shape[1], fps)
        if pixels.shape != shape:
            raise InputError(f"frame {number} of shape {pixels.shape}, expected {shape} as the first")
        frame = _to_yuv(pixels)
        frame.pts = number
        container.mux(stream.encode(frame))
    if stream is None:
        raise InputError("no frames, expected at least one")
    container.mux(stream.encode(None))


def _add_stream(container: Any, height: int, width: int, fps: Fraction) -> Any:
    encoder = next((name for name in ENCODERS if name in av.codecs_available), None)
    if encoder is None:
        raise InputError(f"this build of av has no H.264 encoder ({' or '.join(ENCODERS)}); `pip install av` has one")
    stream = container.add_stream(encoder, rate=fps, options=dict(_ENCODER_OPTIONS[encoder]))
    stream.height, stream.width = height + height % 2, width + width % 2
    stream.pix_fmt = "yuv420p"
    context = stream.codec_context
    context.time_base = 1 / fps
    context.color_range = ColorRange.MPEG
    context.colorspace = context.color_primaries = context.color_trc = _BT709
    return stream


def _to_yuv(pixels: NDArray) -> Any:
    """An even-sized yuv420p av.VideoFrame of an (H, W, 3) uint8 image.

    Converted here, as libswscale's ranges and chroma positions differ between the versions that av comes with.
    """
    rgb = np.pad(pixels, [(0, n % 2) for n in pixels.shape[:2]] + [(0, 0)], mode="edge").astype(np.float32)
    ycc = rgb @ _RGB_TO_YCC.T + _YCC_OFFSET  # (H, W, 3)
    by_row = (ycc[::2, :, 1:] + ycc[1::2, :, 1:]) / 2
    # H.264 puts chroma on the even columns, between two rows.
    padded = np.pad(by_row, ((0, 0), (1, 0), (0, 0)), mode="edge")
    chroma = (padded[:, :-1:2] + 2 * padded[:, 1::2] + padded[:, 2::2]) / 4  # (H/2, W/2, 2)
    samples = np.concatenate([ycc[..., 0].ravel(), chroma[..., 0].ravel(), chroma[..., 1].ravel()])
    planes = np.rint(samples).astype(np.uint8).reshape(-1, rgb.shape[1])  # (3H/2, W)
    return av.VideoFrame.from_ndarray(planes, format="yuv420p")
