"""tsplat.js's HEVC against libavcodec, sample by sample."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from page.scripts import run
from web.node import SCRIPT, node

from tinysplat_runtime.codec.hevc import CodedPlane, PictureDecoder, encode_picture, encode_plane, pad_plane
from tinysplat_runtime.codec.profiles import PROFILES, EncoderSettings

LUMA, PHOTO = "gray12le", "yuv420p10le"


def surface(height: int, width: int, seed: int) -> NDArray:
    """Codes with slopes, edges, a texture and noise, so that every kind of block is worth its bits somewhere."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width]
    codes = 900 + 9 * x + 14 * y + 500 * np.sin(x / 5 + y / 9) + 900 * ((x // 13 + y // 11) % 2)
    codes += rng.normal(0, 60, codes.shape) * (x > width // 2) + 800 * (x + 2 * y > height)
    return np.clip(codes, 0, 4095).astype(np.uint16)


def planes() -> dict[str, tuple[CodedPlane, list[NDArray]]]:
    """Pictures of planes: every profile, sizes that fill trees and those that do not, QPs by blocks.

    QPs are those of codes up to 46: of 12 bits from 48 on libavcodec leaves pictures grey, which libx265 and libde265
    read as we do. Planes have at most 24.
    """
    made = {}
    for profile in PROFILES.values():
        for qp, (height, width) in enumerate([(16, 16), (40, 72), (64, 64), (136, 200)]):
            for q in (qp, 12 + qp, 24 + qp, 40 - qp):
                codes = surface(height, width, 100 * qp + q)
                settings = profile.encoder
                offsets = None
                if settings.block_qps:
                    grid = -(-height // 16), -(-width // 16)
                    offsets = np.random.default_rng(q).integers(-6, 7, grid).astype(np.int8)
                made[f"{profile.name}_{height}x{width}_{q}"] = (encode_plane(codes, q, settings, offsets), [codes])
    for params in OTHERS:
        codes = surface(64, 144, 9)
        made["_".join(params)] = (encode_plane(codes, 22, EncoderSettings("medium", params)), [codes])
    return made


OTHERS = [
    ("sar=2", "overscan=show", "videoformat=pal", "range=full", "colorprim=bt709", "chromaloc=2"),
    ("log2-max-poc-lsb=12", "no-deblock=1"),
    ("ctu=16", "deblock=-2,3"),
    ("ctu=32", "min-cu-size=16", "sao=0"),
    ("ctu=64", "max-tu-size=16", "signhide=0"),
    ("tu-intra-depth=4", "strong-intra-smoothing=0", "qg-size=64"),
]
"""What no profile asks of x265, and parameter sets and pictures may hold."""


def photos() -> dict[str, tuple[CodedPlane, list[NDArray]]]:
    """Pictures of photos, with chroma that is not flat."""
    made = {}
    for qp in (4, 20, 33, 47):
        luma = surface(80, 112, qp) >> 2
        chroma = [surface(40, 56, qp + n) >> 2 for n in (1, 2)]
        settings = EncoderSettings("medium", ("cbqpoffs=-3", "crqpoffs=4")) if qp == 33 else PROFILES["fast"].encoder
        settings = EncoderSettings(settings.preset, settings.params)
        made[f"photo_{qp}"] = (encode_picture([luma, *chroma], PHOTO, qp, settings), [luma, *chroma])
    return made


@pytest.fixture(scope="module")
def decoded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[NDArray, NDArray]]:
    """Samples of every picture: libavcodec's and ours."""
    folder: Path = tmp_path_factory.mktemp("pictures")
    coded, listed = planes() | photos(), []
    for name, (picture, samples) in coded.items():
        (folder / f"{name}.sets").write_bytes(picture.parameter_sets)
        (folder / f"{name}.picture").write_bytes(picture.payload)
        height, width = pad_plane(samples[0]).shape
        is_photo = len(samples) > 1
        size = {"width": width, "height": height, "chroma": int(is_photo), "bits": 10 if is_photo else 12}
        listed.append({"name": name, **size})
    (folder / "pictures.json").write_text(json.dumps(listed))
    subprocess.run([node(), str(SCRIPT.with_name("pictures.mjs")), str(folder)], check=True)
    found = {}
    for entry in listed:
        picture = coded[entry["name"]][0]
        decoder = PictureDecoder(
            picture.parameter_sets, entry["height"], entry["width"], PHOTO if entry["chroma"] else LUMA
        )
        theirs = np.concatenate([plane.ravel() for plane in decoder.decode(picture.payload)])
        found[entry["name"]] = (theirs, np.fromfile(folder / f"{entry['name']}.samples", np.uint16))
    return found


def test_every_picture_is_libavcodecs_sample_by_sample(decoded: dict[str, tuple[NDArray, NDArray]]) -> None:
    differing = [name for name, (theirs, ours) in decoded.items() if not np.array_equal(theirs, ours)]
    assert decoded and not differing, " ".join(differing)


@pytest.mark.parametrize("param", ["tskip=1", "lossless=1", "scaling-list=default"])
def test_parts_of_hevc_that_no_file_uses_are_refused(param: str) -> None:
    sets = encode_plane(surface(16, 16, 1), 20, EncoderSettings("medium", (param,))).parameter_sets
    module = SCRIPT.parents[2] / "runtime/tinysplat_runtime/web/hevc/picture.js"
    code = f"new PictureDecoder(Uint8Array.from({list(sets)}), 16, 16, 0, 12);"
    start = f'import {{ PictureDecoder }} from "{module.as_uri()}";'
    assert run(f"try {{ {code} }} catch (error) {{ return error.name; }}", start) == "TsplatError"
