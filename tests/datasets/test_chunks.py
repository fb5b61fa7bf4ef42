"""Chunks of the paper's data sets are prepared as the official evaluations do, and damaged ones refused in a line."""

from __future__ import annotations

import io
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from datasets.chunks import camera_row, encoded, make_chunk_scene, write_chunks
from PIL import Image
from scenes import make_cameras, make_photo, tells

from tinysplat.datasets import SPECS, ChunkFolder, read_paper_index
from tinysplat.datasets.chunks import fields_of_view, prepare_camera, prepare_image
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


def test_focal_lengths_follow_scale_and_crop_while_the_principal_point_keeps_its_share():
    camera = make_cameras(2, 360, 640)[1]
    prepared = prepare_camera(np.array(camera_row(camera)), (256, 256), (360, 640))
    assert prepared.K[0, 0] == pytest.approx(camera.K_unit[0, 0] * 455)  # 640·256/360 = 455.1, rounded
    assert prepared.K[1, 1] == pytest.approx(camera.K_unit[1, 1] * 256)
    assert prepared.K_unit[:2, 2] == pytest.approx(camera.K_unit[:2, 2])
    np.testing.assert_allclose(prepared.c2w, camera.c2w, atol=1e-12)


def test_field_of_view_is_the_angle_between_opposite_edges():
    horizontal, vertical = fields_of_view(np.array([0.5, 1.0, 0.5, 0.5, *[0] * 14]))
    assert horizontal == pytest.approx(90) and vertical == pytest.approx(2 * np.degrees(np.arctan(0.5)))


# ---- reading -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    scenes = [make_chunk_scene(key, seed=10 * n) for n, key in enumerate("abc")]
    return write_chunks(tmp_path_factory.mktemp("re10k"), [scenes[:2], scenes[2:]])


def test_scenes_are_found_over_several_chunks(folder):
    chunks = ChunkFolder(folder, RE10K)
    assert chunks.chunks == {"a": "000000.torch", "b": "000000.torch", "c": "000001.torch"}
    for n, key in enumerate("abc"):
        images, cameras = chunks.scene(key).views((2, 0), (256, 256))
        assert images.shape == (2, 256, 256, 3) and images.dtype == np.float32
        np.testing.assert_array_equal(images[0], prepare_image(make_photo(360, 640, 10 * n + 2), (256, 256)))
        assert cameras[1].centre == pytest.approx(make_cameras(4, 360, 640)[0].centre, abs=1e-6)


def test_dl3dv_frames_are_taken_at_both_stored_sizes(tmp_path):
    for height, width in SPECS["dl3dv"].frame_shapes:
        write_chunks(tmp_path, [[make_chunk_scene("a", 1, height, width)]])
        images, cameras = ChunkFolder(tmp_path, SPECS["dl3dv"]).scene("a").views((0,), (256, 448))
        assert images.shape == (1, 256, 448, 3) and (cameras[0].height, cameras[0].width) == (256, 448)


def test_frames_that_do_not_exist_or_have_another_shape_are_named(folder, tmp_path):
    assert "c: frame 9, but there are 0 to 3" in refusal(folder, "c", (9,))
    changed(tmp_path, images=[encoded(make_photo(360, 640)), encoded(make_photo(90, 160))])
    assert "frame 1: 160x90 pixels, re10k has 640x360" in refusal(tmp_path, frames=(0, 1))


def test_a_field_of_view_over_the_limit_is_not_evaluated(folder):
    narrow = replace(RE10K, max_fov_degrees=40)
    assert "field of view 48.9°, scenes over 40° are not evaluated" in refusal(folder, "a", (0,), narrow)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"cameras": torch.zeros(2, 12)}, "cameras: expected a tensor (N, 18)"),
        ({"cameras": torch.zeros(2, 18)}, "cameras: holds focal lengths"),
        ({"cameras": torch.full((2, 18), torch.nan)}, "cameras: holds focal lengths"),
        ({"cameras": torch.ones(2, 18)}, "frame 0: cameras: no pose"),
        ({"images": [torch.zeros(3, dtype=torch.uint8)]}, "images: expected a list of 2 photos"),
        ({"images": [torch.zeros(3)] * 2}, "images[0]: expected a photo's file"),
        ({"images": [torch.zeros(3, dtype=torch.uint8)] * 2}, "frame 0: cannot be decoded"),
        ({"images": [encoded(make_photo(360, 640))[:2000]] * 2}, "frame 0: cannot be decoded"),
    ],
)
def test_scenes_that_break_the_layout_are_refused_with_what_is_wrong(tmp_path, fields, said):
    assert tells(refusal(changed(tmp_path, **fields)), said)


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
    assert "unreadable chunk" in refusal(tmp_path)
    assert not (tmp_path / "ran").exists()


def test_an_index_stays_inside_its_folder(tmp_path):
    changed(tmp_path)
    for document in ({"a": "../000000.torch"}, {"a": 3}, ["a"], {"a": ""}):
        (tmp_path / "index.json").write_text(json.dumps(document))
        assert "expected an object of chunk files of this folder" in refusal(tmp_path)
    (tmp_path / "index.json").write_text(json.dumps({"b": "000000.torch"}))
    assert "no scene 'a' in index.json" in refusal(tmp_path)
    assert "no scene 'b', though index.json says so" in refusal(tmp_path, "b")


def test_pictures_of_another_kind_are_refused(tmp_path):
    buffer = io.BytesIO()
    Image.fromarray(make_photo(360, 640)).save(buffer, "BMP")
    photo = torch.frombuffer(bytearray(buffer.getvalue()), dtype=torch.uint8)
    assert "cannot be decoded" in refusal(changed(tmp_path, images=[photo, photo]))


# ---- the public indices ------------------------------------------------------------------------------------------


def test_scenes_given_as_null_are_not_evaluated(tmp_path):
    path = tmp_path / "index.json"
    path.write_text(json.dumps({"a": None, "b": {"context": [58, 133], "target": [84, 102, 129]}}))
    index = read_paper_index(path)
    assert list(index) == ["b"] and index["b"].context == (58, 133) and index["b"].targets == (84, 102, 129)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ([], "expected an object"),
        ({"context": [0, 1]}, "a.target: null, expected a list"),
        ({"context": [0, -1], "target": [0]}, "a.context: [0, -1], expected a list"),
        ({"context": [0, 1.5], "target": [0]}, "a.context: [0, 1.5], expected a list"),
        ({"context": [0, 1], "target": []}, "a.target: no frames"),
    ],
)
def test_windows_that_name_no_frames_are_refused(tmp_path, entry, said):
    path = tmp_path / "index.json"
    path.write_text(json.dumps({"a": entry}))
    with pytest.raises(InputError) as caught:
        read_paper_index(path)
    assert tells(str(caught.value), said)


@pytest.mark.parametrize("text", ["[]", "{", "[" * 100_000])
def test_an_index_that_is_none_is_refused(tmp_path, text):
    path = tmp_path / "index.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"index\.json"):
        read_paper_index(path)
