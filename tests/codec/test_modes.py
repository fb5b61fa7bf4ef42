"""Files of photos and hybrid files: what they decode to, what they need, and what is refused."""

from __future__ import annotations

import shutil
from dataclasses import replace
from inspect import signature
from itertools import accumulate
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from scenes import make_photo, write_scene
from sections import file_of, sections_of

import tinysplat_runtime as ts
from tinysplat_runtime.api import DEFAULT_MODEL
from tinysplat_runtime.codec.adaptive import kept_components
from tinysplat_runtime.codec.analysis import coefficient_moment
from tinysplat_runtime.codec.base import as_codes, fitted_sh
from tinysplat_runtime.codec.basis import second_moment_weighting, view_directions, weighted_spectrum
from tinysplat_runtime.codec.modes import AUTO, CHOICES
from tinysplat_runtime.codec.modes.choice import AUTO_SECONDS, choose
from tinysplat_runtime.codec.modes.registry import MODES
from tinysplat_runtime.codec.photos import _image, _planes, decode_photos, encode_photos, photo_qp
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.codec.residual import _colours
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container import photos as records
from tinysplat_runtime.container.records import StreamRef
from tinysplat_runtime.errors import FormatError, InputError, ModelError
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
    return {mode: RUNTIME.encode(scene, mode=mode, gaussians=raw) for mode in ("gaussians", "photos", "hybrid")}


def _psnr(a: ts.Gaussians, b: ts.Gaussians) -> float:
    pairs = [(RUNTIME.render(a, camera), RUNTIME.render(b, camera)) for camera in a.cameras]
    return float(np.mean([-10 * np.log10(np.mean((x - y) ** 2)) for x, y in pairs]))


def _there_and_back(images: np.ndarray, qp: float) -> np.ndarray:
    coded = encode_photos(images, qp, PROFILES["fast"].encoder, threads=2)
    ends = accumulate(map(len, coded.payloads), initial=0)
    streams = tuple(StreamRef(end, len(p), crc32(p)) for end, p in zip(ends, coded.payloads, strict=False))
    data = memoryview(b"".join(coded.payloads))
    header = records.PhotoHeader(coded.height, coded.width, coded.qp, 255, streams, data)
    return decode_photos(header, coded.parameter_sets, threads=2)


@pytest.mark.parametrize("size", [(40, 56), (33, 47), (16, 16), (7, 9)])
def test_photos_come_back_at_their_size_and_near_what_they_were(size):
    images = np.stack([make_photo(*size, seed=i) for i in range(2)]).astype(np.float32) / 255
    decoded = _there_and_back(images, qp=-10)
    assert decoded.shape == images.shape and decoded.dtype == np.float32
    assert decoded.min() >= 0 and decoded.max() <= 1
    difference = decoded - images
    assert np.sqrt(np.mean((difference @ [0.2126, 0.7152, 0.0722]) ** 2)) < 0.01
    assert np.sqrt(np.mean(difference**2)) < 0.08  # chroma has half the resolution


def test_planes_of_photos_are_those_of_bt_709():
    """Luma and chroma of the primaries by the numbers that ITU-R BT.709 prints, times 1023 and about 512."""
    printed = {
        (1, 0, 0): (0.2126, -0.2126 / 1.8556, 0.5), (0, 1, 0): (0.7152, -0.7152 / 1.8556, -0.7152 / 1.5748),
        (0, 0, 1): (0.0722, 0.5, -0.0722 / 1.5748), (1, 1, 1): (1, 0, 0), (0, 0, 0): (0, 0, 0),
    }  # fmt: skip
    for rgb, (y, blue, red) in printed.items():
        planes = _planes(np.full((16, 16, 3), rgb, np.float32))
        assert [plane.shape for plane in planes] == [(16, 16), (8, 8), (8, 8)]
        wanted = [min(max(round(value), 0), 1023) for value in (1023 * y, 512 + 1023 * blue, 512 + 1023 * red)]
        assert [set(plane.ravel().tolist()) for plane in planes] == [{value} for value in wanted]
        np.testing.assert_allclose(_image(planes, 16, 16), np.broadcast_to(rgb, (16, 16, 3)), atol=1.5 / 1023)


def test_chroma_is_the_mean_of_four_and_comes_back_between_them():
    image = np.zeros((16, 16, 3), np.float32)
    image[:, :, 2] = np.arange(16) / 15
    luma, blue, red = _planes(image)
    np.testing.assert_array_equal(blue[0], np.rint(512 + 1023 * 0.5 * (np.arange(8) * 2 + 0.5) / 15))
    found = _image([np.full_like(luma, 500), blue, np.full_like(red, 512)], 16, 16)
    wanted = 500 / 1023 + 1.8556 * 0.5 * np.arange(16) / 15  # a slope comes back as it was, but for the border
    np.testing.assert_allclose(found[:, 1:-1, 2], np.clip(wanted, 0, 1)[None, 1:-1].repeat(16, 0), atol=2e-3)


def test_a_grey_photo_stays_grey():
    images = np.full((1, 24, 40, 3), 0.5, np.float32)
    np.testing.assert_allclose(_there_and_back(images, qp=0), 0.5, atol=2e-3)


def test_the_qp_of_photos_follows_that_of_planes_one_for_one():
    assert [photo_qp(qp) for qp in (0, 6.4, 6.6, -20, -30, 31, 40)] == [20, 26, 27, 0, 0, 51, 51]


def test_photo_files_are_small_and_decode_to_what_the_network_makes_of_them(files, raw):
    decoded = RUNTIME.decompress(files["photos"])
    assert len(files["photos"]) < 0.5 * len(files["gaussians"])
    assert [layer.opacities.shape for layer in decoded.layers] == [layer.opacities.shape for layer in raw.layers]
    assert _psnr(raw, decoded) > 26  # colours are sharpened, and with them what coding did to the photos


def test_hybrid_files_are_nearer_to_the_raw_gaussians_than_photos(files, raw):
    photos, hybrid = (_psnr(raw, RUNTIME.decompress(files[mode])) for mode in ("photos", "hybrid"))
    assert hybrid > photos + 5


def test_a_hybrid_file_of_coarse_photos_still_reaches_the_planes_fidelity(scene, raw, files):
    fine = RUNTIME.decompress(RUNTIME.encode(scene, mode="hybrid", gaussians=raw, qp=-12))
    assert _psnr(raw, fine) > _psnr(raw, RUNTIME.decompress(files["hybrid"])) + 3


@pytest.mark.parametrize(("functions", "wanted"), [(1, 1), (1, 9), (4, 1), (4, 9), (9, 4)])
def test_coefficients_are_cut_or_filled_with_zeros(functions, wanted):
    sh = np.arange(2 * 3 * 2 * functions * 3, dtype=np.float32).reshape(2, 3, 2, functions, 3) + 1
    found = fitted_sh(sh, (2, 3, 2, wanted, 3))
    kept = min(functions, wanted)
    assert found.shape == (2, 3, 2, wanted, 3)
    np.testing.assert_array_equal(found[..., :kept, :], sh[..., :kept, :])
    assert not found[..., kept:, :].any()


@pytest.mark.parametrize("k", [1, 2])
def test_a_correction_has_the_components_that_carry_more_than_a_step(raw, k):
    """As many as leave at most `energy_floor` squared steps of weighted energy out."""
    difference = replace(raw, extra_layers=())
    settings = PROFILES["fast"].settings
    weighting = second_moment_weighting(view_directions(raw.cameras), raw.degree)
    energies = weighted_spectrum(coefficient_moment(RUNTIME.store, difference), weighting)[0]
    for factor, wanted in ((1.01, k), (0.99, k + 1)):
        step = np.sqrt(factor * energies[k:].sum() / settings.energy_floor)
        assert _colours(RUNTIME.store, difference, step, settings)[1].k == wanted
        assert kept_components(energies, step, settings) == wanted


def test_predictions_enter_synthesis_to_float_precision():
    planes = np.random.default_rng(0).normal(size=(2, 3, 5, 6)).astype(np.float32) * [[[[1]], [[1e-4]], [[300]]]]
    codes, mix = as_codes(planes.astype(np.float32))
    ones = np.ones_like(codes[:, :1])
    found = np.einsum("cp,vphw->vchw", mix, np.concatenate([codes, ones], axis=1))
    span = np.ptp(planes, axis=(0, 2, 3))[:, None, None]
    assert (np.abs(found - planes) / span).max() < 1e-7


def test_bytes_do_not_depend_on_threads(scene, raw, files):
    for mode in ("photos", "hybrid"):
        assert ts.Runtime(threads=1).encode(scene, mode=mode, gaussians=raw) == files[mode]


def test_info_names_network_and_photos(files):
    for mode in ("photos", "hybrid"):
        described = ts.inspect(files[mode])
        assert described["network"]["name"] == DEFAULT_MODEL and len(described["network"]["sha256"]) == 64
        assert described["photos"]["bytes"] == described["bytes_by_class"]["photos"] > 0


def test_a_hybrid_prefix_falls_back_to_the_photos(files, raw):
    described = ts.inspect(files["hybrid"])
    start = described["bytes"] - sum(plane["bytes"] for plane in described["planes"])
    least = RUNTIME.decompress(files["hybrid"], max_bytes=start)
    assert abs(_psnr(raw, least) - _psnr(raw, RUNTIME.decompress(files["photos"]))) < 6
    with pytest.raises(FormatError, match="no picture"):
        RUNTIME.decompress(files["hybrid"], max_bytes=start - 1)


def test_every_choice_is_a_mode_or_auto():
    assert set(CHOICES) - {AUTO} <= set(MODES) and AUTO not in MODES


def test_functions_take_what_their_methods_do():
    for name in ("predict", "refine", "compress", "encode", "decompress", "render"):
        method, function = getattr(ts.Runtime, name), getattr(ts, name)
        assert list(signature(method).parameters)[1:] == list(signature(function).parameters)
        assert function.__doc__ == method.__doc__


def test_another_network_at_decode_is_a_model_error_with_name_and_hash(files, tmp_path):
    other = tmp_path / "other.onnx"
    other.write_bytes((models_dir() / f"{DEFAULT_MODEL}.onnx").read_bytes() + b"\0")
    wanted = ts.inspect(files["photos"])["network"]["sha256"]
    with pytest.raises(ModelError, match=f"(?s)other.onnx.*'{DEFAULT_MODEL}' of sha256 {wanted}"):
        RUNTIME.decompress(files["photos"], model=str(other))


def test_a_missing_network_at_decode_is_a_model_error_that_names_the_option(files):
    sections = sections_of(files["photos"])
    for section in sections:
        if section[0] == records.NETWORK:
            section[3] = bytes(32) + section[3][32:]
    with pytest.raises(ModelError, match=rf"'{DEFAULT_MODEL}' of sha256 {'0' * 64} is not at hand; .*another.*--model"):
        RUNTIME.decompress(file_of(sections))


def test_a_users_own_network_is_found_when_it_is_given(scene, tmp_path):
    own = shutil.copy(models_dir() / "sweep.onnx", tmp_path / "mine.onnx")
    Path(own).write_bytes(Path(own).read_bytes())
    data = RUNTIME.encode(scene, str(own), mode="photos")
    assert ts.inspect(data)["network"]["name"] == "mine"
    decoded = RUNTIME.decompress(data, model=str(own))
    assert all(np.isfinite(getattr(decoded, name)).all() for name in FIELDS)


def test_auto_weighs_size_time_and_availability():
    shipped = records.NetworkRef("sweep", RUNTIME.store.network_ref("sweep")[1], 1.0, 2.0)
    own = records.NetworkRef("mine", "00" * 32, 1.0, 2.0)
    small, large = b"x" * 10, b"x" * 20
    assert choose(large, small, shipped, 0.1)[0] == "photos"
    assert choose(small, large, shipped, 0.1)[0] == "gaussians"
    assert choose(large, small, own, 0.1)[0] == "gaussians"
    assert choose(large, small, shipped, 2 * AUTO_SECONDS)[0] == "gaussians"


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"mode": "film"}, "gaussians, photos, hybrid, auto"),
        ({"mode": "photos", "target_size": 9000}, "target"),
        ({"mode": "hybrid", "target_psnr": 40.0}, "target"),
        ({"mode": "hybrid", "profile": "paper"}, "fast, balanced, max"),
        ({"mode": "photos", "qp": float("nan")}, "qp"),
    ],
)
def test_contradictory_modes_are_refused(scene, raw, options, named):
    with pytest.raises(InputError, match=named):
        RUNTIME.encode(scene, gaussians=raw, **options)


def _damaged(data: bytes, kind: bytes, change) -> bytes:
    sections = sections_of(data)
    for section in sections:
        if (section[0] == kind and section[2] != 0) or (section[0] == kind and kind != L.PARAMETER_SETS):
            section[3] = change(section[3])
    return file_of(sections)


def _photos_header(**fields):
    names = ("height", "width", "format", "qp", "parameter_set", "reserved")

    def change(section: bytes) -> bytes:
        values = dict(zip(names, records.PHOTOS_FIXED.unpack(section[: records.PHOTOS_FIXED.size]), strict=True))
        return records.PHOTOS_FIXED.pack(*{**values, **fields}.values()) + section[records.PHOTOS_FIXED.size :]

    return change


HOSTILE = {
    "photos of no rows": (records.PHOTOS, _photos_header(height=0)),
    "photos too large": (records.PHOTOS, _photos_header(height=1 << 16, width=1 << 16)),
    "photos of another size": (records.PHOTOS, _photos_header(height=90)),
    "an unknown format": (records.PHOTOS, _photos_header(format=7)),
    "QP beyond HEVC's": (records.PHOTOS, _photos_header(qp=90)),
    "a parameter set that is not there": (records.PHOTOS, _photos_header(parameter_set=9)),
    "a table cut short": (records.PHOTOS, lambda section: section[:-1]),
    "pictures cut short": (records.PHOTO_PICTURES, lambda section: section[:-1]),
    "pictures altered": (
        records.PHOTO_PICTURES,
        lambda section: section[:40] + bytes([section[40] ^ 1]) + section[41:],
    ),
    "near beyond far": (records.NETWORK, lambda section: section[:96] + section[104:] + section[96:104]),
    "a name with a line feed": (records.NETWORK, lambda section: section[:32] + b"\n" + section[33:]),
    "a network cut short": (records.NETWORK, lambda section: section[:-1]),
    "parameter sets of planes": (L.PARAMETER_SETS, lambda section: b""),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_photo_sections_are_format_errors(files, case):
    kind, change = HOSTILE[case]
    with pytest.raises(FormatError):
        RUNTIME.decompress(_damaged(files["photos"], kind, change))
