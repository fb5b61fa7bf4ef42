"""Pictures written as PNG and JPEG files; `images` reads photos."""

from fractions import Fraction
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, within
from ..system.files import StrPath, write_atomically

_RGB_TO_JPEG = np.array([[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]])  # JFIF

_FORMATS = {(): "gray", (3,): "rgb24", (4,): "rgba"}
"""By an image's shape after its rows and columns, libavutil's name."""


def write_png(path: StrPath, image: NDArray) -> None:
    """Write a PNG file, atomically; see `png_bytes` for the image.

    Raises:
        InputError: another shape or type, or NaN.
        OSError: the file cannot be written.
    """
    with within(str(path)):
        data = png_bytes(image)
    write_atomically(path, data)


def png_bytes(image: NDArray) -> bytes:
    """An image as a PNG file's bytes.

    Args:
        image: (H, W, 3) RGB, (H, W, 4) with opacities, or (H, W) grey; uint8, or floating point in [0, 1], which is
            clipped and rounded. Grey of uint16 gives 16 bits a sample.

    Raises:
        InputError: another shape or type, or NaN.
    """
    deep = np.asarray(image).dtype == np.uint16 and np.ndim(image) == 2
    pixels = np.ascontiguousarray(image) if deep else to_uint8(image)
    if pixels.ndim not in (2, 3) or pixels.shape[2:] not in _FORMATS or 0 in pixels.shape:
        raise InputError(f"image of shape {pixels.shape}, expected (H, W, 3), (H, W, 4) or (H, W)")
    frame: Any = av.VideoFrame.from_ndarray(pixels, format="gray16le" if deep else _FORMATS[pixels.shape[2:]])
    # Level 6, zlib's own, takes four times as long (18 ms for 256×256) for 5 % fewer bytes.
    options = {"pred": "mixed", "compression_level": "4"}
    return _coded(frame.reformat(format="gray16be") if deep else frame, "png", options)  # PNG is big-endian


def jpeg_bytes(image: NDArray, quantiser: int = 3) -> bytes:
    """An image as a JPEG file's bytes, colours at full resolution.

    Args:
        image: (H, W, 3) RGB; uint8, or floating point in [0, 1], which is clipped and rounded.
        quantiser: of libavcodec, 2 (best) to 31.

    Raises:
        InputError: another shape or type, or NaN.
    """
    pixels = to_uint8(image)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
        raise InputError(f"image of shape {pixels.shape}, expected (H, W, 3)")
    ycc = pixels @ _RGB_TO_JPEG.T + (0.0, 128.0, 128.0)
    planes = np.rint(ycc).clip(0, 255).astype(np.uint8).transpose(2, 0, 1)
    options = {"qmin": str(quantiser), "qmax": str(quantiser)}  # PyAV has attributes for them from 14 on
    return _coded(av.VideoFrame.from_ndarray(np.ascontiguousarray(planes), format="yuvj444p"), "mjpeg", options)


def _coded(frame: Any, kind: str, options: dict[str, str]) -> bytes:
    """A frame as a file of one picture by a codec of libavcodec."""
    codec: Any = av.CodecContext.create(kind, "w")
    codec.height, codec.width, codec.pix_fmt = frame.height, frame.width, frame.format.name
    codec.time_base, codec.options = Fraction(1, 1), options
    return b"".join(bytes(packet) for packet in [*codec.encode(frame), *codec.encode(None)])


def to_uint8(image: NDArray) -> NDArray:
    """Round an image of any shape, float in [0, 1], to uint8, clipping what lies outside; uint8 passes as it is."""
    image = np.ascontiguousarray(image)
    if image.dtype == np.uint8:
        return image
    if not np.issubdtype(image.dtype, np.floating):
        raise InputError(f"image of {image.dtype}, expected uint8 or floating point in [0, 1]")
    if np.isnan(image).any():
        raise InputError("image holds NaN, expected numbers in [0, 1]")
    return (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)
