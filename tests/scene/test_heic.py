"""HEIC photos are those that the same photo is as JPEG, whatever lies beside it in the file."""

import builtins
from pathlib import Path
from typing import Any

import numpy as np
import pillow_heif
import pytest
from PIL import Image
from scene.test_images import icc_profile, photo_like
from scenes import refusing

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.images import image_size, is_turned, read_image


def write_heic(path: Path, pixels: np.ndarray, **options: Any) -> None:
    mode = {2: "L", 3: "RGB"}[pixels.ndim] + (";16" if pixels.dtype == np.uint16 else "")
    picture = pillow_heif.from_bytes(mode, pixels.shape[1::-1], pixels.tobytes())
    picture.save(path, quality=-1, chroma=444, **options)


@pytest.mark.parametrize("profile", [None, "Display P3"])
def test_heic_shows_what_the_same_photo_shows_as_png(tmp_path: Path, profile: str | None) -> None:
    pixels = photo_like(48, 64)
    said = {"icc_profile": icc_profile(profile)} if profile else {}
    Image.fromarray(pixels).save(tmp_path / "photo.png", **said)
    write_heic(tmp_path / "photo.HEIC", pixels, **said)
    expected = read_image(tmp_path / "photo.png").astype(int)
    assert image_size(tmp_path / "photo.HEIC") == (48, 64) and not is_turned(tmp_path / "photo.HEIC")
    assert np.abs(read_image(tmp_path / "photo.HEIC") - expected).mean() < 1.5


def test_deep_and_grey_ones_are_rounded_and_coloured(tmp_path: Path) -> None:
    pixels = photo_like(48, 64)
    write_heic(tmp_path / "deep.heic", pixels.astype(np.uint16) * 257)
    assert np.abs(read_image(tmp_path / "deep.heic").astype(int) - pixels).mean() < 1.5
    write_heic(tmp_path / "grey.heic", pixels[..., 0].copy())
    assert np.abs(read_image(tmp_path / "grey.heic").astype(int) - pixels[..., :1]).mean() < 1.5


def test_what_is_damaged_or_cannot_be_read_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_heic(tmp_path / "photo.heic", photo_like(48, 64))
    data = (tmp_path / "photo.heic").read_bytes()
    for damaged in (data[:30], data[:-200], b"\0\0\0\x18ftypheic" + bytes(40)):
        (tmp_path / "damaged.heic").write_bytes(damaged)
        with refusing(InputError, "damaged.heic HEIC") as caught:
            read_image(tmp_path / "damaged.heic")
        assert "\n" not in str(caught.value)
    found = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name == "pillow_heif":
            raise ImportError(name)
        return found(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with refusing(InputError, "photo.heic tinysplat[heic]"):
        image_size(tmp_path / "photo.heic")
