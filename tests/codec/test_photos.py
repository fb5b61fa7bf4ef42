"""Photos as pictures of video: colours by BT.709's formulas pixel by pixel, sizes, padding, and what comes back."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scenes import make_photo, refusing

from tinysplat_runtime.codec.photos import decode_photos, encode_photos, photo_qp, picture_planes, planes_picture
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.container.records import Picture
from tinysplat_runtime.errors import FormatError


def ycc(rgb: NDArray) -> NDArray:
    """ITU-R BT.709 in words: luma of 0.2126, 0.7152 and 0.0722; differences to blue and red that span one."""
    r, g, b = np.moveaxis(rgb.astype(np.float64), -1, 0)
    y = 0.2126 * r + 0.7152 * g + 0.0722 * b
    return np.stack([y, (b - y) / 1.8556, (r - y) / 1.5748], axis=-1)


def test_planes_are_luma_and_means_of_four_colours_in_ten_bits() -> None:
    image = 1.4 * np.random.default_rng(0).random((17, 30, 3), np.float32) - np.float32(0.2)  # some beyond full range
    planes = picture_planes(image)
    assert [plane.shape for plane in planes] == [(32, 32), (16, 16), (16, 16)]
    assert {plane.dtype for plane in planes} == {np.dtype(np.uint16)}
    whole = ycc(image[np.minimum(np.arange(32), 16)][:, np.minimum(np.arange(32), 29)])
    assert np.abs(planes[0] - (whole[..., 0] * 1023).clip(0, 1023)).max() <= 0.5 + 1e-3
    for plane, values in zip(planes[1:], np.moveaxis(whole[..., 1:], -1, 0), strict=True):
        wanted = [[values[2 * i : 2 * i + 2, 2 * j : 2 * j + 2].mean() for j in range(16)] for i in range(16)]
        assert np.abs(plane - (np.array(wanted) * 1023 + 512).clip(0, 1023)).max() <= 0.5 + 1e-3


def test_an_image_is_made_of_luma_and_of_chroma_between_its_neighbours() -> None:
    """A sample of chroma lies in the middle of four pixels: each is 9/16 of it, 3/16 of two neighbours, 1/16 of one."""
    rng = np.random.default_rng(1)
    luma = rng.integers(300, 700, (16, 16)).astype(np.uint16)
    blue, red = rng.integers(450, 570, (2, 8, 8)).astype(np.uint16)
    found = planes_picture([luma, blue, red], 13, 11)
    assert found.shape == (13, 11, 3) and found.dtype == np.float32 and found.flags.c_contiguous

    def at(plane: NDArray, row: int, column: int) -> float:
        total = 0.0
        for i, of_row in ((row // 2, 0.75), (row // 2 + (1 if row % 2 else -1), 0.25)):
            for j, of_column in ((column // 2, 0.75), (column // 2 + (1 if column % 2 else -1), 0.25)):
                total += of_row * of_column * (float(plane[np.clip(i, 0, 7), np.clip(j, 0, 7)]) - 512)
        return total / 1023

    for row, column in ((0, 0), (0, 5), (1, 1), (6, 3), (7, 10), (12, 0), (12, 10), (5, 6)):
        y, cb, cr = luma[row, column] / 1023, at(blue, row, column), at(red, row, column)
        r, b = y + 1.5748 * cr, y + 1.8556 * cb
        g = (y - 0.2126 * r - 0.0722 * b) / 0.7152
        np.testing.assert_allclose(found[row, column], np.clip([r, g, b], 0, 1), atol=2e-6)
    assert planes_picture([np.full((16, 16), 1023), np.full((8, 8), 1023), np.full((8, 8), 512)], 2, 2).max() == 1


def test_photos_come_back_nearly_and_the_worse_the_coarser_on_any_threads() -> None:
    images = np.stack([make_photo(40, 52, seed).astype(np.float32) / 255 for seed in (0, 1)])
    settings = PROFILES["fast"].encoder
    errors = []
    for qp in (-15.0, 0.0, 15.0):
        coded = encode_photos(images, qp, settings, 2)
        assert (coded.height, coded.width, coded.qp, len(coded.pictures)) == (40, 52, photo_qp(qp), 2)
        assert encode_photos(images, qp, replace(settings, block_qps=True), 1) == coded
        back = decode_photos(coded, 1)
        assert back.shape == images.shape and back.dtype == np.float32
        np.testing.assert_array_equal(back, decode_photos(coded, 3))
        errors.append(float(np.sqrt(((back - images) ** 2).mean())))
    assert errors[0] < errors[1] < errors[2]


def test_a_damaged_photo_is_named() -> None:
    images = np.stack([make_photo(16, 16, seed).astype(np.float32) / 255 for seed in (0, 1)])
    coded = encode_photos(images, 0.0, PROFILES["fast"].encoder, 1)
    damaged = replace(coded, pictures=(coded.pictures[0], *Picture.each_of([b"no picture"])))
    with refusing(FormatError, "1"):
        decode_photos(damaged, 1)
