"""Photos as HEVC pictures: what a file of mode `photos` carries for its receiver's network.

One intra picture per photo, BT.709 YCbCr of full range, 4:2:0 at 10 bits: at equal bytes 0.1 to 0.5 dB better than
8 bits or 4:4:4; predicting one photo from another saved at most 8 %, and nothing on wide baselines. The conversions are
done here, since those of libswscale differ between versions.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..container.photos import PHOTO_SIDE_MULTIPLE, CodedPhotos
from ..container.records import Picture
from ..errors import within
from ..gaussian.planes import MAX_QP
from ..scene.images import doubled
from ..system.blas import product
from ..system.threads import Crew
from .hevc import CodedPlane, PictureDecoder, encode_picture
from .profiles import EncoderSettings

BASE_QP = 20
"""QP of the photos at Q_g = 0; Q_g moves it one for one, as it does the planes' steps."""

_PIXEL_FORMAT = "yuv420p10le"
_WHITE, _GREY = 1023, 512

_KR, _KB = 0.2126, 0.0722
_RGB_TO_YCC = np.array(
    [
        [_KR, 1 - _KR - _KB, _KB],
        [-_KR / (2 - 2 * _KB), -(1 - _KR - _KB) / (2 - 2 * _KB), 0.5],
        [0.5, -(1 - _KR - _KB) / (2 - 2 * _KR), -_KB / (2 - 2 * _KR)],
    ]
)
"""Rows Y, Cb, Cr (ITU-R BT.709, section 3), full range."""

_YCC_TO_RGB = np.linalg.inv(_RGB_TO_YCC)


def photo_qp(qp: float) -> int:
    """QP of the photos at Q_g = `qp`."""
    return min(max(round(BASE_QP + qp), 0), MAX_QP)


def encode_photos(images: NDArray, qp: float, settings: EncoderSettings, threads: int) -> CodedPhotos:
    """Code photos.

    Args:
        images: (V, H, W, 3) float32 RGB in [0, 1].
        qp: Q_g.
        settings: libx265's preset and parameters.
        threads: photos coded at a time; never changes the bytes.
    """
    picture_qp = photo_qp(qp)

    def encode(image: NDArray) -> CodedPlane:
        return encode_picture(picture_planes(image), _PIXEL_FORMAT, picture_qp, replace(settings, block_qps=False))

    coded = Crew(threads).map(encode, images)
    height, width = images.shape[1:3]
    (sets,) = {picture.parameter_sets for picture in coded}  # the same of all pictures of one size
    return CodedPhotos(height, width, picture_qp, sets, Picture.each_of(picture.payload for picture in coded))


def decode_photos(photos: CodedPhotos, threads: int) -> NDArray:
    """(V, H, W, 3) float32 RGB in [0, 1] of photos: what the network is given on either side.

    Raises:
        FormatError: a picture is damaged, or not of the announced size and format; names the photo.
    """
    size = photos.height, photos.width
    height, width = coded_photo_size(*size)

    def decode(view: int) -> NDArray:
        with within(f"photo {view}"):
            planes = PictureDecoder(photos.parameter_sets, height, width, _PIXEL_FORMAT).decode(photos.payload(view))
        return planes_picture(planes, *size)

    return np.stack(Crew(threads).map(decode, range(len(photos.pictures))))


def coded_photo_size(height: int, width: int) -> tuple[int, int]:
    """Size at which a photo is coded: sides in multiples of 16, so that chroma's are in multiples of 8."""
    multiple = PHOTO_SIDE_MULTIPLE
    return -(-height // multiple) * multiple, -(-width // multiple) * multiple


def picture_planes(image: NDArray) -> list[NDArray]:
    """Y, Cb, Cr uint16 of an (H, W, 3) image, padded by repeating its border; chroma is the mean of four samples."""
    height, width = coded_photo_size(*image.shape[:2])
    grow = ((0, height - image.shape[0]), (0, width - image.shape[1]), (0, 0))
    ycc = product(np.pad(image, grow, mode="edge").astype(np.float32), _RGB_TO_YCC.T.astype(np.float32))
    chroma = ycc[..., 1:].reshape(height // 2, 2, width // 2, 2, 2).mean(axis=(1, 3))
    planes = [ycc[..., 0], *np.moveaxis(chroma + np.float32(_GREY / _WHITE), -1, 0)]
    return [np.clip(np.rint(plane * _WHITE), 0, _WHITE).astype(np.uint16) for plane in planes]


def planes_picture(planes: Sequence[NDArray], height: int, width: int) -> NDArray:
    """(H, W, 3) float32 of decoded planes."""
    luma, blue, red = planes
    chroma = [doubled(doubled(plane - np.float32(_GREY), 0), 1) / 16 for plane in (blue, red)]
    ycc = np.stack([luma.astype(np.float32), *chroma])
    rgb = np.einsum("ij,jhw->ihw", _YCC_TO_RGB.astype(np.float32) / np.float32(_WHITE), ycc[:, :height, :width])
    return np.ascontiguousarray(np.moveaxis(rgb.clip(0, 1), 0, -1))
