"""Pictures written as JPEG and 16-bit PNG are what Pillow reads."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image
from scenes import make_photo

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.pictures import jpeg_bytes, png_bytes


@pytest.mark.parametrize("quantiser", [2, 3, 8])
def test_jpeg_files_show_the_picture_the_better_the_finer_they_are(quantiser: int) -> None:
    image = make_photo(37, 50)
    data = jpeg_bytes(image, quantiser)
    shown = np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(float)
    layers = Image.open(io.BytesIO(data)).layer  # type: ignore[attr-defined]
    assert len({layer[1:3] for layer in layers}) == 1  # colours at the resolution of luma
    assert (
        np.abs(shown - image).mean() < 1.5 + 0.6 * quantiser and np.abs((shown - image).mean(axis=(0, 1))).max() < 0.6
    )
    assert data == jpeg_bytes(image / 255.0, quantiser) and jpeg_bytes(image) == jpeg_bytes(image, 3)
    for wrong in (image[..., 0], image[:0], np.zeros((4, 4, 4), np.uint8)):
        with pytest.raises(InputError, match=r"expected \(H, W, 3\)"):
            jpeg_bytes(wrong, quantiser)


@pytest.mark.parametrize("colour", [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255), (10, 200, 90)])
def test_plain_colours_survive_jpeg(colour: tuple[int, int, int]) -> None:
    data = jpeg_bytes(np.full((16, 16, 3), colour, np.uint8), 2)
    found = np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(float)
    np.testing.assert_allclose(found.mean(axis=(0, 1)), colour, atol=3)


def test_grey_of_16_bits_is_written_as_such() -> None:
    grey = np.random.default_rng(0).integers(0, 1 << 16, (5, 7), dtype=np.uint16)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(png_bytes(grey)))), grey)
