"""Chunks of the paper's data sets are prepared as the official evaluations do, and damaged ones refused in a line."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from datasets.chunks import encoded, make_chunk_scene, write_chunks
from PIL import Image
from scenes import make_cameras, make_photo, refusing, tells

from tinysplat.datasets import SPECS, ChunkFolder, read_paper_index
from tinysplat.datasets.chunks import prepare_image
from tinysplat_runtime.errors import InputError

RE10K = SPECS["re10k"]


def refusal(folder: Path, key: str = "a", frames=(0,), spec=RE10K) -> str:
    with pytest.raises(InputError) as caught:
        ChunkFolder(folder, spec).scene(key).views(frames, (64, 64))
    message = str(caught.value)
    assert "\n" not in message
    return message


def changed(folder: Path, **fields) -> Path:
    """A folder with one scene, some of whose fields are others."""
    return write_chunks(folder, [[{**make_chunk_scene("a", frames=2), **fields}]])


# ---- preparing ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shape", "size"), [((360, 640), (256, 256)), ((540, 960), (256, 448)), ((270, 480), (256, 448))]
)
def test_photos_are_scaled_with_pillows_lanczos_to_cover_and_cropped_at_a_corner_rounded_down(shape, size):
    pixels = make_photo(*shape)
    scale = max(size[0] / shape[0], size[1] / shape[1])
    height, width = round(shape[0] * scale), round(shape[1] * scale)
    scaled = np.asarray(Image.fromarray(pixels).resize((width, height), Image.LANCZOS)) / 255
    row, column = (height - size[0]) // 2, (width - size[1]) // 2
    expected = scaled[row : row + size[0], column : column + size[1]]
    np.testing.assert_allclose(prepare_image(pixels, size), expected, atol=1e-7)


# ---- reading -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    scenes = [make_chunk_scene(key, seed=10 * n) for n, key in enumerate("abc")]
    return write_chunks(tmp_path_factory.mktemp("re10k"), [scenes[:2], scenes[2:]])


def test_scenes_are_found_over_several_chunks(folder):
    chunks = ChunkFolder(folder, RE10K)
    for n, key in enumerate("abc"):
        images, cameras = chunks.scene(key).views((2, 0), (256, 256))
        assert images.shape == (2, 256, 256, 3) and images.dtype == np.float32
        np.testing.assert_array_equal(images[0], prepare_image(make_photo(360, 640, 10 * n + 2), (256, 256)))
        assert cameras[1].centre == pytest.approx(make_cameras(4, 360, 640)[0].centre, abs=1e-6)


def test_frames_that_do_not_exist_or_have_another_shape_are_named(folder, tmp_path):
    assert tells(refusal(folder, "c", (9,)), "frame 9 of 0 to 3")
    changed(tmp_path, images=[encoded(make_photo(360, 640)), encoded(make_photo(90, 160))])
    assert tells(refusal(tmp_path, frames=(0, 1)), "frame 1 160x90 re10k 640x360")


def test_a_field_of_view_over_the_limit_is_not_evaluated(folder):
    narrow = replace(RE10K, max_fov_degrees=40)
    assert "40" in refusal(folder, "a", (0,), narrow)
    assert ChunkFolder(folder, replace(RE10K, max_fov_degrees=50)).scene("a").views((0,), (64, 64))


@pytest.mark.parametrize(
    ("fields", "named"),
    [
        ({"cameras": torch.zeros(2, 18)}, "cameras"),
        ({"cameras": torch.full((2, 18), torch.nan)}, "cameras"),
        ({"cameras": torch.ones(2, 18)}, "frame 0"),
        ({"images": [torch.zeros(3, dtype=torch.uint8)]}, "images"),
        ({"images": [torch.zeros(3, dtype=torch.uint8)] * 2}, "frame 0"),
        ({"images": [encoded(make_photo(360, 640))[:2000]] * 2}, "frame 0"),
    ],
)
def test_scenes_that_break_the_layout_are_refused_with_what_is_wrong(tmp_path, fields, named):
    message = refusal(changed(tmp_path, **fields))
    assert message.startswith(f"{tmp_path / '000000.torch'}: a: ") and named in message


@pytest.mark.parametrize("content", [b"", b"junk" * 100, "cut", "list of numbers"])
def test_unreadable_chunks_are_named(tmp_path, content):
    path = changed(tmp_path) / "000000.torch"
    if content == "list of numbers":
        torch.save([1, 2], path)
    else:
        path.write_bytes(path.read_bytes()[:3000] if content == "cut" else content)
    assert f"{path}: " in refusal(tmp_path)


class _Exploit:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def test_a_chunk_cannot_run_code(tmp_path):
    changed(tmp_path)
    torch.save([{"key": "a", "cameras": _Exploit(tmp_path / "ran")}], tmp_path / "000000.torch")
    assert str(tmp_path / "000000.torch") in refusal(tmp_path)
    assert not (tmp_path / "ran").exists()


def test_an_index_stays_inside_its_folder(tmp_path):
    changed(tmp_path)
    for document in ({"a": "../000000.torch"}, {"a": 3}, ["a"], {"a": ""}):
        (tmp_path / "index.json").write_text(json.dumps(document))
        assert str(tmp_path / "index.json") in refusal(tmp_path)
    (tmp_path / "index.json").write_text(json.dumps({"b": "000000.torch"}))
    for key in "ab":  # which is not in the index, and which is in it alone
        assert f"'{key}'" in refusal(tmp_path, key)


# ---- the public indices ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[]", ""),
        ("{", ""),
        ("[" * 100_000, ""),
        ('{"a": {"context": [0, 1]}}', "a.target"),
        ('{"a": {"context": [0, -1], "target": [0]}}', "a.context [0, -1]"),
        ('{"a": {"context": [0, 1], "target": []}}', "a.target"),
    ],
)
def test_what_names_no_frames_is_refused_by_its_place(tmp_path, text, said):
    path = tmp_path / "index.json"
    path.write_text(text)
    with refusing(InputError, f"{path} {said}"):
        read_paper_index(path, "re10k")
