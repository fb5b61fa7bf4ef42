"""Pictures written as JPEG and 16-bit PNG are what Pillow reads."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image
from scenes import make_photo

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.pictures import jpeg_bytes, png_bytes


def test_jpeg_files_show_the_picture_the_better_the_finer_they_are() -> None:
    image, errors = make_photo(37, 50), []
    for quantiser in (2, 3, 8, 31):
        data = jpeg_bytes(image, quantiser)
        shown = Image.open(io.BytesIO(data))
        assert len({layer[1:3] for layer in shown.layer}) == 1  # type: ignore[attr-defined]  # colours as fine as luma
        errors.append(np.abs(np.asarray(shown.convert("RGB")).astype(float) - image).mean())
        assert data == jpeg_bytes(image / 255.0, quantiser)
    assert errors == sorted(errors) and errors[0] < 5
    for wrong in (image[..., 0], image[:0], np.zeros((4, 4, 4), np.uint8)):
        with pytest.raises(InputError):
            jpeg_bytes(wrong)


@pytest.mark.parametrize("colour", [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255), (10, 200, 90)])
def test_plain_colours_survive_jpeg(colour: tuple[int, int, int]) -> None:
    data = jpeg_bytes(np.full((16, 16, 3), colour, np.uint8), 2)
    found = np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(float)
    np.testing.assert_allclose(found.mean(axis=(0, 1)), colour, atol=3)


def test_grey_of_16_bits_is_written_as_such() -> None:
    grey = np.random.default_rng(0).integers(0, 1 << 16, (5, 7), dtype=np.uint16)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(png_bytes(grey)))), grey)
