"""SOG and compressed .ply value by value: small files made by hand from the formats' pages, and ours taken apart."""

import io
import json
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scenes import refusing

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians

C0 = 0.28209479177387814


def webp(rows: list[list[int]], width: int) -> bytes:
    """A picture of these RGBA pixels."""
    pixels = np.array(rows, np.uint8).reshape(-1, width, 4)
    buffer = io.BytesIO()
    Image.fromarray(pixels, "RGBA").save(buffer, "WEBP", lossless=True, exact=True)
    return buffer.getvalue()


def sog_by_hand(path: Path, change: Any = None) -> None:
    """Two Gaussians with SH of degree 1 from a palette of three vectors, in a folder's files."""
    book = [n / 100 for n in range(256)]
    vectors = np.zeros((64, 3, 4), int)
    vectors[..., 3] = 255
    vectors[:3, :, :3] = np.arange(27).reshape(3, 3, 3)
    files = {
        "l.webp": webp([[255, 0, 7, 255], [0, 128, 9, 255]], 2),
        "u.webp": webp([[255, 0, 1, 255], [0, 2, 3, 255]], 2),
        "s.webp": webp([[0, 1, 2, 255], [253, 254, 255, 255]], 2),
        "q.webp": webp([[255, 128, 0, 252], [10, 20, 30, 254]], 2),
        "c.webp": webp([[3, 4, 5, 255], [6, 7, 8, 51]], 2),
        "p.webp": webp(vectors.reshape(-1, 4).tolist(), 192),
        "i.webp": webp([[2, 0, 0, 255], [1, 0, 0, 255]], 2),
    }
    meta: dict[str, Any] = {
        "version": 2,
        "count": 2,
        "means": {"mins": [-1, 0, 2], "maxs": [1, 3, 2.5], "files": ["l.webp", "u.webp"]},
        "scales": {"codebook": [-v for v in book], "files": ["s.webp"]},
        "quats": {"files": ["q.webp"]},
        "sh0": {"codebook": book, "files": ["c.webp"]},
        "shN": {"count": 3, "bands": 1, "codebook": [10 + v for v in book], "files": ["p.webp", "i.webp"]},
    }
    if change:
        change(meta, files)
    path.mkdir(exist_ok=True)
    for name, data in {**files, "meta.json": json.dumps(meta).encode()}.items():
        (path / name).write_bytes(data)


def test_every_value_of_a_sog_file_is_where_the_format_has_it(tmp_path: Path) -> None:
    sog_by_hand(tmp_path / "a")
    g = load_gaussians(tmp_path / "a")
    codes = np.array([[65535, 0, 263], [0, 640, 777]]) / 65535
    logs = [-1, 0, 2] + codes * np.array([2, 3, 0.5])
    np.testing.assert_allclose(g.means, np.sign(logs) * np.expm1(np.abs(logs)), rtol=1e-6)
    np.testing.assert_allclose(g.scales, np.exp([[0, -0.01, -0.02], [-2.53, -2.54, -2.55]]), rtol=1e-6)
    np.testing.assert_allclose(g.opacities, [1, 0.2], rtol=1e-6)
    np.testing.assert_allclose(g.sh[:, 0], [[0.03, 0.04, 0.05], [0.06, 0.07, 0.08]], rtol=1e-5)
    index = np.arange(27).reshape(3, 3, 3)
    np.testing.assert_allclose(g.sh[:, 1:], 10 + index[[2, 1]] / 100, rtol=1e-6)
    for found, bytes_, largest in zip(g.quats, ([255, 128, 0], [10, 20, 30]), (0, 2), strict=True):
        three = (np.array(bytes_) / 255 - 0.5) * np.sqrt(2)
        whole = np.insert(three, largest, np.sqrt(max(1 - (three**2).sum(), 0)))
        np.testing.assert_allclose(found / np.linalg.norm(found), whole / np.linalg.norm(whole), atol=1e-6)


def entry(name: str, **fields: Any) -> Any:
    return lambda meta, files: meta[name].update(fields)


def top(**fields: Any) -> Any:
    return lambda meta, files: meta.update(fields)


def picture(name: str, rows: list[list[int]], width: int) -> Any:
    return lambda meta, files: files.update({name: webp(rows, width)})


BAD_SOG = [
    (top(version=3), "meta.json: version 3, expected 2"),
    (top(count=0), "meta.json: 0"),
    (top(count=3), "means: 2 pixels for 3 Gaussians"),
    (top(means=3), "meta.json.means"),
    (entry("means", mins=[1, 2]), "means.mins (3,)"),
    (entry("means", files=["l.webp"]), "means"),
    (entry("quats", files=["a/q.webp"]), "quats"),
    (entry("quats", files=["other.webp"]), "other.webp"),
    (picture("q.webp", [[1, 2, 3, 251], [1, 2, 3, 255]], 2), "quats: tag 251, expected 252 to 255"),
    (entry("shN", bands=4), "shN: degree 4, palette of 3"),
    (entry("shN", count=65537), "shN: degree 1, palette of 65537"),
    (entry("shN", bands=2), "shN: a palette 192 pixels wide, expected 512"),
    (picture("i.webp", [[63, 0, 0, 255], [64, 0, 0, 255]], 2), "shN: index 64 into a palette of 64"),
    (lambda meta, files: meta.pop("version"), "meta.json.means.shape"),
    (lambda meta, files: meta["sh0"]["codebook"].pop(), "codebook (255,) (256,)"),
    (lambda _, files: files.update({"s.webp": files["s.webp"].replace(b"/\x01\0\0", b"/\xfe\xbf\xff")}), "16383 1023"),
    (lambda meta, files: files.update({"q.webp": files["q.webp"] + bytes(50_000_000)}), "q.webp"),
]


@pytest.mark.parametrize(("change", "words"), BAD_SOG)
def test_what_a_sog_file_may_not_say(tmp_path: Path, change: Any, words: str) -> None:
    sog_by_hand(tmp_path / "a", change)
    with refusing(InputError, words):
        load_gaussians(tmp_path / "a")


@pytest.mark.parametrize(
    "change",
    [
        entry("shN", count=1),
        entry("shN", count=65536),
        picture("i.webp", [[63, 0, 9, 255], [0, 0, 9, 255]], 2),
        picture("q.webp", [[1, 2, 3, 255], [1, 2, 3, 252]], 2),
        top(count=1),
    ],
)
def test_what_a_sog_file_may_say(tmp_path: Path, change: Any) -> None:
    sog_by_hand(tmp_path / "a", change)
    assert load_gaussians(tmp_path / "a").degree == 1


@pytest.mark.parametrize(("data", "words"), [(b"{", "meta.json: not JSON"), (b"[1]", "meta.json: no JSON object")])
def test_a_meta_json_is_an_object(tmp_path: Path, data: bytes, words: str) -> None:
    (tmp_path / "meta.json").write_bytes(data)
    with refusing(InputError, words):
        load_gaussians(tmp_path)
    with zipfile.ZipFile(tmp_path / "a.sog", "w") as archive:
        archive.writestr("other.json", b"{}")
    with refusing(InputError, "meta.json"):
        load_gaussians(tmp_path / "a.sog")


# ---- compressed .ply ------------------------------------------------------------------------------------------------


def compressed_ply(path: Path, *, colours: bool = True, sh: int | None = 9, words: int = 2) -> None:
    """Two Gaussians in one chunk; with SH of so many values."""
    ends = [-1, 0, 2, 1, 4, 2, -3, -2, -1, -1, -2, 1] + [0, 0.25, 0.5, 1, 0.75, 1] * colours
    names = [f"{end}_{axis}" for end in ("min", "max") for axis in "xyz"]
    names += [f"{end}_scale_{axis}" for end in ("min", "max") for axis in "xyz"]
    names += [f"{end}_{channel}" for end in ("min", "max") for channel in "rgb"] * colours
    header = "ply\nformat binary_little_endian 1.0\nelement chunk 1\n"
    header += "".join(f"property float {name}\n" for name in names) + f"element vertex {words}\n"
    header += "".join(f"property uint packed_{name}\n" for name in ("position", "rotation", "scale", "color"))
    if sh is not None:
        header += f"element sh {words}\n" + "".join(f"property uchar f_rest_{n}\n" for n in range(sh))
    body = struct.pack(f"<{len(ends)}f", *ends)
    body += struct.pack("<4I", 2047 << 21 | 0 << 11 | 1024, 2 << 30 | 1023 << 20 | 512 << 10, 0, 255 << 24 | 51)
    body += struct.pack(
        "<4I", 1 << 21 | 1023 << 11 | 2047, 0 << 30 | 1 << 20 | 2 << 10 | 3, 0xFFFFFFFF, 51 << 16 | 102 << 8 | 255
    )
    if sh is not None:
        body += bytes([0, 1, 127, 128, 254, 255, 64, 192, 7][:sh]) + bytes(range(sh))
    path.write_bytes(header.encode() + b"end_header\n" + body)


def test_every_value_of_a_compressed_ply_is_where_the_format_has_it(tmp_path: Path) -> None:
    compressed_ply(tmp_path / "a.ply")
    g = load_gaussians(tmp_path / "a.ply")
    np.testing.assert_allclose(g.means, [[1, 0, 2], [-1 + 2 / 2047, 4, 2]], rtol=1e-6)
    np.testing.assert_allclose(np.log(g.scales), [[-3, -2, -1], [-1, -2, 1]], atol=1e-6)
    np.testing.assert_allclose(g.opacities, [51 / 255, 1], rtol=1e-6)
    rgb = np.array([[1, 0.25, 0.5], [0, 0.25 + 0.2 * 0.5, 0.5 + 0.4 * 0.5]])
    np.testing.assert_allclose(g.sh[:, 0], (rgb - 0.5) / C0, atol=1e-6)
    codes = np.array([[0, 1, 127, 128, 254, 255, 64, 192, 7], range(9)], float)
    middles = np.where(codes == 0, 0, np.where(codes == 255, 1, (codes + 0.5) / 256))
    np.testing.assert_allclose(g.sh[:, 1:], ((middles - 0.5) * 8).reshape(2, 3, 3).swapaxes(1, 2), atol=1e-6)
    for found, three, largest in zip(g.quats, ([1023, 512, 0], [1, 2, 3]), (2, 0), strict=True):
        parts = (np.array(three) / 1023 - 0.5) * np.sqrt(2)
        whole = np.insert(parts, largest, np.sqrt(max(1 - (parts**2).sum(), 0)))
        np.testing.assert_allclose(found / np.linalg.norm(found), whole / np.linalg.norm(whole), atol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"float max_scale_z", b"float max_scale_q", "chunk: lacks max_scale_z"),
        (b"uint packed_color", b"uint packed_colou", "vertex: lacks packed_color"),
        (b"element chunk 1", b"element chunk 0", "0 2"),
        (struct.pack("<f", -3), struct.pack("<f", np.nan), ""),
    ],
)
def test_compressed_ply_that_lacks_something(tmp_path: Path, old: bytes, new: bytes, words: str) -> None:
    compressed_ply(tmp_path / "a.ply")
    data = (tmp_path / "a.ply").read_bytes()
    assert data.count(old) == 1
    (tmp_path / "a.ply").write_bytes(data.replace(old, new))
    with refusing(InputError, words):
        load_gaussians(tmp_path / "a.ply")
