"""Photos read from JPEG, PNG and HEIC files; `pictures` writes them and `resampling` resizes.

Trust boundary: a file's own headers are walked first. Its size in pixels is checked before anything is decoded, a
file cut short is refused, and only the parts that pixels depend on go to libavcodec, so neither a compressed text nor
an embedded preview can cost memory or change a colour. Colours of an ICC profile, of PNG's cICP and of Adobe RGB become
sRGB (`colours`); PNG's gAMA and cHRM are ignored, as most tools do. HEIC goes to `heic`, WebP and TIFF to `pillow`.
"""

import re
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, within
from ..system.files import StrPath, read_limited
from . import exif, heic, pillow
from .cameras import MAX_IMAGE_SIDE
from .colours import Colours, adobe_rgb, of_code_points, of_icc, to_srgb

MAX_PIXELS = 1 << 26
"""Largest photo decoded: 67 megapixels, 200 MB of RGB."""

MAX_FILE_BYTES = 8 * MAX_PIXELS
"""No photo within the limit is larger: 16-bit RGBA takes 8 bytes a pixel."""

MAX_PROFILE_BYTES = 1 << 24
"""Largest ICC profile looked at; a display's takes some hundred bytes, a printer's up to a few million."""

PHOTO_SUFFIXES = (".jpg", ".jpeg", ".png", *heic.SUFFIXES, *pillow.SUFFIXES)
"""Endings of photos."""

NOT_READ = (".dng", ".insp", ".avif", ".jxl", ".gif", ".bmp", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2")
"""Endings of photos that are not read: of cameras' raw data, of Insta360's two fisheyes and of other kinds."""

_OTHERS = {"GIF": rb"GIF8[79]a", "BMP": rb"BM....\0\0\0\0", "AVIF": rb"....ftypavi[fs]"}
_TEXTS = re.compile(rb"\s*(?:(version https://git-lfs)|<(?:!doctype|html|\?xml))", re.IGNORECASE)
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PNG_COLOUR_TYPE, _PNG_WITH_ALPHA = 25, (b"\4", b"\6")  # where the header says so: grey or colour, and alpha
_PNG_PIXEL_CHUNKS = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")

_JPEG_MARKER = re.compile(rb"\xff+([^\x00\xff\xd0-\xd7])", re.DOTALL)  # neither stuffing nor a restart marker
_EOI, _SOS, _APP1, _APP2 = 0xD9, 0xDA, 0xE1, 0xE2
_EXIF = b"Exif\0\0"
_ICC = b"ICC_PROFILE\0"  # then the part's number and how many there are
_SOF_DECODED = (0xC0, 0xC1, 0xC2)  # Huffman-coded baseline, extended and progressive
_SOF_OTHER = (0xC3, 0xC5, 0xC6, 0xC7, 0xC9, 0xCA, 0xCB, 0xCD, 0xCE, 0xCF)  # lossless, hierarchical, arithmetic
_JPEG_PIXEL_SEGMENTS = (*_SOF_DECODED, 0xC4, 0xDB, 0xDD, _SOS, 0xEE)  # DHT, DQT, DRI, SOS, Adobe's colour transform
_MAX_SCANS = 100  # progressive files have about ten; each scan walks over the whole picture

_CHROMA_LEVELS = np.arange(256) - 128
_RED_PER_CR = np.rint(1.402 * _CHROMA_LEVELS).astype(np.int16)
_BLUE_PER_CB = np.rint(1.772 * _CHROMA_LEVELS).astype(np.int16)
_SIXTY_FOURTHS_OF_GREEN_PER_CB = np.rint(-0.344136 * 64 * _CHROMA_LEVELS).astype(np.int16)
_SIXTY_FOURTHS_OF_GREEN_PER_CR = np.rint(-0.714136 * 64 * _CHROMA_LEVELS).astype(np.int16)

_FIRST_TRANSPOSED = 5  # Exif orientations 5 to 8 swap rows and columns


@dataclass(frozen=True)
class _Stripped:
    """A photo reduced to what its pixels depend on."""

    codec: str
    data: bytes
    width: int
    height: int
    is_16_bit: bool
    orientation: int
    colours: Colours | None
    exif: bytes = b""


def read_image(path: StrPath, *, upright: bool = True, shrink: int = 1) -> NDArray:
    """Decode a JPEG, PNG, HEIC, WebP or TIFF file.

    Grey and palette images become RGB; 16-bit samples are rounded to 8 bits; transparency is composited over black,
    the rasteriser's background. The Exif orientation is applied, so height and width are those a viewer shows; not so
    the pixels as stored, with `upright=False`. `shrink` by 2 or 4 makes one of so many rows and columns of a JPEG,
    by its own transform and at a fraction of the cost; others, and sides that are no multiple of it, are read whole.

    Returns:
        (H, W, 3) uint8, sRGB, or as many times fewer rows and columns.

    Raises:
        InputError: names the file, which is missing, cut short, damaged, over MAX_PIXELS, of another kind, or of
            one that no package here reads.
    """
    photo = _headers(path)
    with within(str(path)):
        if photo.codec == "heic":
            pixels = _opaque(*heic.decoded(heic.opened(photo.data)))
        elif photo.codec == "pillow":
            pixels = _opaque(*pillow.decoded(pillow.opened(photo.data)[0]))
        else:
            pixels = _opaque(_samples_of(_decode(photo, shrink), photo.is_16_bit), photo.colours)
    return _orient(pixels, photo.orientation) if upright else pixels


def is_transparent(path: StrPath) -> bool:
    """Whether a file is a PNG whose pixels have an opacity each, by its first bytes; not where it cannot be read."""
    try:
        with Path(path).open("rb") as file:
            start = file.read(_PNG_COLOUR_TYPE + 1)
    except OSError:
        return False
    return start.startswith(_PNG_SIGNATURE) and start[_PNG_COLOUR_TYPE:] in _PNG_WITH_ALPHA


def read_opacity(path: StrPath, *, upright: bool = True) -> NDArray:
    """(H, W) uint8 opacities of such a file's pixels, as `read_image` has these; its errors."""
    photo = _headers(path)
    with within(str(path)):
        samples = _samples_of(_decode(photo, 1), photo.is_16_bit)
    opacity = _of_8_bits(samples[..., -1])
    return _orient(opacity, photo.orientation) if upright else opacity


def image_size(path: StrPath) -> tuple[int, int]:
    """(height, width) of a photo as `read_image` would deliver it, from its headers alone.

    Raises:
        InputError: names the file, which is missing, cut short, too large, or of another kind.
    """
    stripped = _headers(path)
    sides = stripped.height, stripped.width
    return sides[::-1] if stripped.orientation >= _FIRST_TRANSPOSED else sides


def is_turned(path: StrPath) -> bool:
    """Whether a file's Exif orientation says to show it otherwise than stored; errors of `image_size`."""
    return _headers(path).orientation != 1


def exif_of(path: StrPath) -> bytes:
    """A photo's Exif, which `exif` reads; empty where it has none; errors of `image_size`."""
    return _headers(path).exif


def _headers(path: StrPath) -> _Stripped:
    """A photo's parts, once they are known to be of a size that may be decoded; errors of `image_size`."""
    with within(str(path)):
        stripped = _strip(read_limited(path, MAX_FILE_BYTES))
        size = f"{stripped.width}x{stripped.height} pixels"
        if not (0 < stripped.width <= MAX_IMAGE_SIDE and 0 < stripped.height <= MAX_IMAGE_SIDE):
            raise InputError(f"{size}, expected sides of 1 to {MAX_IMAGE_SIDE}")
        if stripped.width * stripped.height > MAX_PIXELS:
            raise InputError(f"{size}, expected at most {MAX_PIXELS} in all")
        return stripped


def _strip(data: bytes) -> _Stripped:
    if data.startswith(_PNG_SIGNATURE):
        return _strip_png(data)
    if data.startswith(b"\xff\xd8"):
        return _strip_jpeg(data)
    if heic.is_heic(data):
        picture = heic.opened(data)
        said = (picture.info.get("exif") or b"").removeprefix(_EXIF)
        width, height = picture.size
        return _Stripped("heic", data, width, height, False, 1, None, said)
    if pillow.is_read(data):
        picture, turned = pillow.opened(data)
        said = data if picture.format == "TIFF" else picture.info.get("exif", b"").removeprefix(_EXIF)
        return _Stripped("pillow", data, picture.width, picture.height, False, turned, None, said)
    if text := _TEXTS.match(data):
        pointer, page = "a Git LFS pointer; `git lfs pull` brings the photo", "a web page, no photo: download it again"
        raise InputError(pointer if text[1] else page)
    other = next((name for name, start in _OTHERS.items() if re.match(start, data, re.DOTALL)), None)
    fault = other or f"starts with {data[:4].hex(' ') or 'nothing'}"
    how = f": `ffmpeg -i a.{other.lower()} a.png`" if other else ""
    raise InputError(f"{fault}, expected a JPEG, PNG, HEIC, WebP or TIFF image{how}")


def _strip_png(data: bytes) -> _Stripped:
    """Walk the chunks (PNG specification, section 5), keeping those that pixels depend on."""
    position, kept = len(_PNG_SIGNATURE), [_PNG_SIGNATURE]
    said: dict[bytes, bytes] = {}  # about colours and lenses
    kind = b""
    while kind != b"IEND":
        if position + 12 > len(data):
            raise InputError("PNG cut short")
        length, kind = struct.unpack_from(">I4s", data, position)
        end = position + 12 + length
        if end > len(data):
            raise InputError("PNG cut short")
        if len(kept) == 1 and (kind, length) != (b"IHDR", 13):
            raise InputError("damaged PNG: does not start with its header")
        if kind in _PNG_PIXEL_CHUNKS:
            kept.append(data[position:end])
        elif kind == b"eXIf":
            said[kind] = data[position + 8 : end - 4]
        elif kind in (b"cICP", b"iCCP"):
            said.setdefault(kind, data[position + 8 : end - 4])
        position = end
    width, height, depth = struct.unpack_from(">IIB", kept[1], 8)
    tiff = said.get(b"eXIf", b"")
    turned = exif.orientation(tiff)
    return _Stripped("png", b"".join(kept), width, height, depth == 16, turned, _png_colours(said), tiff)


def _png_colours(said: dict[bytes, bytes]) -> Colours | None:
    """What a PNG's chunks state (PNG specification, third edition, 11.3.2), the weightier of two."""
    if len(said.get(b"cICP", b"")) == 4:
        return of_code_points(*said[b"cICP"][:2])
    _, _, compressed = said.get(b"iCCP", b"").partition(b"\0")
    try:
        return of_icc(zlib.decompressobj().decompress(compressed[1:], MAX_PROFILE_BYTES))
    except zlib.error:
        return None


def _strip_jpeg(data: bytes) -> _Stripped:
    """Walk the marker segments (ITU-T T.81, annex B) up to the end of the image, keeping what pixels depend on."""
    position, scans, tiff, kept = 2, 0, b"", [data[:2]]
    profile: dict[int, bytes] = {}
    size: tuple[int, int] | None = None
    while match := _JPEG_MARKER.search(data, position):
        if scans:
            kept.append(data[position : match.start()])  # entropy-coded data
        marker = match[1][0]
        if marker == _EOI:
            if not (size and scans):
                break
            stated = b"".join(profile[part] for part in sorted(profile))
            colours = of_icc(stated) if stated else adobe_rgb() if exif.is_adobe_rgb(tiff) else None
            pixels = b"".join([*kept, b"\xff\xd9"])
            return _Stripped("mjpeg", pixels, *size, False, exif.orientation(tiff), colours, tiff)
        length = int.from_bytes(data[match.end() : match.end() + 2], "big")
        body = data[match.end() + 2 : match.end() + length]
        if length < 2 or len(body) != length - 2:
            break
        position = match.end() + length
        if marker in _SOF_OTHER:
            raise InputError("lossless, hierarchical or arithmetic-coded JPEG, expected Huffman-coded DCT")
        if marker in _SOF_DECODED:
            if size or len(body) < 6:
                raise InputError("damaged JPEG: frame header doubled or too short")
            size = _jpeg_size(body)
        elif marker == _APP1 and body.startswith(_EXIF):
            tiff = body.removeprefix(_EXIF)
        elif marker == _APP2 and body.startswith(_ICC) and len(body) > len(_ICC) + 2:
            profile.setdefault(body[len(_ICC)], body[len(_ICC) + 2 :])
        scans += marker == _SOS
        if scans > _MAX_SCANS:
            raise InputError(f"JPEG of more than {_MAX_SCANS} scans")
        if marker in _JPEG_PIXEL_SEGMENTS:
            kept.append(b"\xff" + data[match.end() - 1 : position])
    raise InputError("JPEG cut short")


def _jpeg_size(frame_header: bytes) -> tuple[int, int]:
    """(width, height) of a frame header, once its samples are of a kind that can be read."""
    bits, height, width, components = struct.unpack_from(">BHHB", frame_header)
    if bits != 8 or components not in (1, 3):
        kind = "CMYK" if components == 4 else f"{components}-channel"
        raise InputError(f"{kind} JPEG of {bits} bits a sample, expected grey or colour of 8; convert it to RGB first")
    return width, height


def _decode(photo: _Stripped, shrink: int) -> Any:
    """The one frame of a photo as an av.VideoFrame of the size that its header announced, a JPEG's shrunk."""
    codec: Any = av.CodecContext.create(photo.codec, "r")
    codec.thread_count = 1
    codec.options = {"err_detect": "crccheck+explode"}  # otherwise damage is painted over in grey
    size = photo.width, photo.height
    if shrink > 1 and photo.codec == "mjpeg" and not any(side % shrink for side in size):
        codec.options |= {"lowres": str(shrink.bit_length() - 1)}
        size = photo.width // shrink, photo.height // shrink
    try:
        frames = [*codec.decode(av.Packet(photo.data)), *codec.decode(None)]
    except av.FFmpegError:
        frames = []
    if len(frames) != 1 or (frames[0].width, frames[0].height) != size:
        raise InputError(f"damaged {'JPEG' if photo.codec == 'mjpeg' else 'PNG'}: cannot be decoded")
    return frames[0]


def _samples_of(frame: Any, is_16_bit: bool) -> NDArray:
    """(H, W, 3), or 4 where it is transparent, uint8 or uint16 of a decoded frame in any pixel format."""
    if frame.format.name.startswith("yuv"):
        return _ycc_to_rgb(*(_samples(plane) for plane in frame.planes))
    opaque = not any(c.is_alpha for c in frame.format.components) and frame.format.name != "pal8"
    pix_fmt = ("rgb48le" if opaque else "rgba64le") if is_16_bit else ("rgb24" if opaque else "rgba")
    samples: NDArray = frame.reformat(format=pix_fmt).to_ndarray()
    return samples


def _opaque(samples: NDArray, colours: Colours | None) -> NDArray:
    """(H, W, 3) uint8 sRGB of samples (H, W, 3 or 4) uint8 or uint16 of some colours, over black."""
    stated, alpha = samples[..., :3], _of_8_bits(samples[..., 3:])
    pixels = _of_8_bits(stated) if colours is None else to_srgb(stated, colours)
    if alpha.size:
        pixels = ((pixels.astype(np.uint16) * alpha + 127) // 255).astype(np.uint8)
    return np.ascontiguousarray(pixels)


def _of_8_bits(samples: NDArray) -> NDArray:
    """Samples uint8, or uint16 rounded to as many."""
    return (
        samples if samples.dtype == np.uint8 else ((samples.astype(np.uint32) * 255 + 32767) // 65535).astype(np.uint8)
    )


def _samples(plane: Any) -> NDArray:
    """(h, w) uint8 view of an av.VideoPlane, without the padding of its lines."""
    return np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)[: plane.height, : plane.width]


def _ycc_to_rgb(luma: NDArray, blue: NDArray, red: NDArray) -> NDArray:
    """(H, W, 3) uint8 of full-range BT.601 planes, as JFIF defines them, chroma at any power-of-two spacing.

    Done here because libswscale's conversion differs between its versions and stretches the chroma of odd sizes:
    48 samples over 95 pixels rather than 96, a colour fringe towards the right and bottom edges.
    """
    cb, cr = (_upsample_chroma(plane, luma.shape) for plane in (blue, red))
    y = luma.astype(np.int16)
    green_offset = (_SIXTY_FOURTHS_OF_GREEN_PER_CB[cb] + _SIXTY_FOURTHS_OF_GREEN_PER_CR[cr] + 32) >> 6
    rgb = np.empty((*luma.shape, 3), np.uint8)
    for channel, offset in enumerate((_RED_PER_CR[cr], green_offset, _BLUE_PER_CB[cb])):
        rgb[..., channel] = np.clip(offset + y, 0, 255)
    return rgb


def _upsample_chroma(plane: NDArray, shape: tuple[int, ...]) -> NDArray:
    """A chroma plane at the luma's shape, uint8: each doubling weighs the two nearest samples 3 to 1, as libjpeg does.

    Chroma samples lie at the centre of the pixels that share them. Plane borders are repeated.
    """
    samples, gain = plane.astype(np.uint16), 1
    for axis in (0, 1):
        while samples.shape[axis] < shape[axis]:
            samples, gain = doubled(samples, axis), 4 * gain
    return ((samples[: shape[0], : shape[1]] + gain // 2) // gain).astype(np.uint8)


def doubled(samples: NDArray, axis: int) -> NDArray:
    """Twice as many samples along one axis, 0 or 1, each 3 × the nearest + 1 × the next: four times the values."""
    padded = np.pad(samples, [(int(a == axis),) * 2 for a in range(samples.ndim)], mode="edge")
    before, after = (padded[:-2], padded[2:]) if axis == 0 else (padded[:, :-2], padded[:, 2:])
    doubled = np.empty([n * (1 + (a == axis)) for a, n in enumerate(samples.shape)], samples.dtype)
    even, odd = (doubled[::2], doubled[1::2]) if axis == 0 else (doubled[:, ::2], doubled[:, 1::2])
    thrice = 3 * samples
    np.add(thrice, before, out=even)
    np.add(thrice, after, out=odd)
    return doubled


def _orient(image: NDArray, orientation: int) -> NDArray:
    """Turn the stored image (H, W, 3) as its Exif orientation says it is meant to be seen."""
    if orientation >= _FIRST_TRANSPOSED:
        image = image.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    return np.ascontiguousarray(image)
