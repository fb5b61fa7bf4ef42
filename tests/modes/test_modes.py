"""Files of photos: what they decode to, what they need, and what is refused."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from scenes import drawn_psnr, refusing, write_scene
from sections import changed_section

import tinysplat_runtime as ts
from tinysplat_runtime.api import DEFAULT_MODEL
from tinysplat_runtime.container import photos as records
from tinysplat_runtime.errors import ModelError
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.graphs.artifacts import models_dir

RUNTIME = ts.Runtime(threads=2)


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> ts.Scene:
    return ts.load_scene(write_scene(tmp_path_factory.mktemp("photos") / "scene", views=2, height=40, width=56))


@pytest.fixture(scope="module")
def raw(scene) -> ts.Gaussians:
    return RUNTIME.predict(scene)


@pytest.fixture(scope="module")
def files(scene, raw) -> dict[str, bytes]:
    return {mode: RUNTIME.encode(scene, mode=mode, gaussians=raw) for mode in ("gaussians", "photos")}


def test_photo_files_are_small_and_decode_to_what_the_network_makes_of_them(files, raw):
    decoded = RUNTIME.decompress(files["photos"])
    assert len(files["photos"]) < len(files["gaussians"])
    assert [layer.opacities.shape for layer in decoded.layers] == [layer.opacities.shape for layer in raw.layers]
    assert drawn_psnr(raw, decoded) > 26  # colours are sharpened, and with them what coding did to the photos


def test_another_network_at_decode_is_a_model_error_with_name_and_hash(files, tmp_path):
    other = tmp_path / "other.onnx"
    other.write_bytes((models_dir() / f"{DEFAULT_MODEL}.onnx").read_bytes() + b"\0")
    wanted = ts.inspect(files["photos"])["network"]["sha256"]
    with refusing(ModelError, f"{other} '{DEFAULT_MODEL}' {wanted}"):
        RUNTIME.decompress(files["photos"], model=str(other))


def test_a_missing_network_at_decode_is_a_model_error_that_names_the_option(files):
    def zero(text: bytearray) -> None:
        text[:32] = bytes(32)

    with refusing(ModelError, f"'{DEFAULT_MODEL}' {'0' * 64} --model"):
        RUNTIME.decompress(changed_section(files["photos"], records.PHOTOS, zero))


def test_a_users_own_network_is_found_when_it_is_given(scene, tmp_path):
    own = shutil.copy(models_dir() / "sweep.onnx", tmp_path / "mine.onnx")
    Path(own).write_bytes(Path(own).read_bytes())
    data = RUNTIME.encode(scene, str(own), mode="photos")
    assert ts.inspect(data)["network"]["name"] == "mine"
    decoded = RUNTIME.decompress(data, model=str(own))
    assert all(np.isfinite(getattr(decoded, name)).all() for name in FIELDS)
