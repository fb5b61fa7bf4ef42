"""SOG and compressed .ply value by value: small files made by hand from the formats' pages, and ours taken apart."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.notes import Notes

C0 = 0.28209479177387814
ROOT = np.sqrt(0.5)


def points(count: int, degree: int = 0, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)
    return Gaussians(
        rng.normal(size=(count, 3)), rng.normal(size=(count, 4)), rng.uniform(0.01, 0.2, (count, 3)),
        rng.uniform(0, 1, count), 0.5 * rng.normal(size=(count, (degree + 1) ** 2, 3)),
    )  # fmt: skip


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
        "version": 2, "count": 2, "means": {"mins": [-1, 0, 2], "maxs": [1, 3, 2.5], "files": ["l.webp", "u.webp"]},
        "scales": {"codebook": [-v for v in book], "files": ["s.webp"]}, "quats": {"files": ["q.webp"]},
        "sh0": {"codebook": book, "files": ["c.webp"]},
        "shN": {"count": 3, "bands": 1, "codebook": [10 + v for v in book], "files": ["p.webp", "i.webp"]},
    }  # fmt: skip
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


LONG = "0123456789" * 30
BAD_SOG = [
    (top(version=LONG), f"meta.json: version {LONG[:20]}, expected 2"),
    (top(count=LONG), f"meta.json: count {LONG[:20]}, which "),
    (entry("shN", bands=LONG), f"shN: degree {LONG[:20]}, palette of 3"),
    (entry("shN", count=LONG), f"shN: degree 1, palette of {LONG[:20]}"),
    (top(version=3), "meta.json: version 3, expected 2"), (top(count=0), "meta.json: count 0, which "),
    (top(count=2.0), "meta.json: count 2.0, which "), (top(count=3), "means: 2 pixels for 3 Gaussians"),
    (top(means=3), "meta.json: lacks 'means'"), (entry("means", mins=[1, 2]), "means: expected 3 numbers in 'mins'"),
    (entry("means", maxs=[1, 2, "3"]), "means: expected 3 numbers in 'maxs'"),
    (entry("means", mins=5), "means: expected 3 numbers in 'mins'"),
    (entry("means", files=["l.webp"]), "means: no plain name of picture 1"),
    (entry("means", files="l.webp"), "means: no plain name of picture 0"),
    (entry("quats", files=["a/q.webp"]), "quats: no plain name of picture 0"),
    (entry("quats", files=["a\\q.webp"]), "quats: no plain name of picture 0"),
    (entry("quats", files=[""]), "quats: no plain name of picture 0"),
    (entry("quats", files=["q" * 200]), "quats: no plain name of picture 0"),
    (entry("quats", files=[7]), "quats: no plain name of picture 0"),
    (entry("quats", files=["q" * 199]), "no such file"),
    (picture("q.webp", [[1, 2, 3, 251], [1, 2, 3, 255]], 2), "quats: tag 251, expected 252 to 255"),
    (entry("shN", bands=0), "shN: degree 0, palette of 3"), (entry("shN", bands=4), "shN: degree 4, palette of 3"),
    (entry("shN", count=0), "shN: degree 1, palette of 0"),
    (entry("shN", count=65537), "shN: degree 1, palette of 65537"),
    (entry("shN", count="3"), "shN: degree 1, palette of 3"),
    (entry("shN", bands=2), "shN: a palette 192 pixels wide, expected 512"),
    (picture("i.webp", [[63, 0, 0, 255], [64, 0, 0, 255]], 2), "shN: index 64 into a palette of 64"),
    (picture("i.webp", [[0, 1, 0, 255], [0, 0, 0, 255]], 2), "shN: index 256 into a palette of 64"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "words"), BAD_SOG)
def test_what_a_sog_file_may_not_say(tmp_path: Path, change: Any, words: str) -> None:
    sog_by_hand(tmp_path / "a", change)
    with pytest.raises(InputError) as error:
        load_gaussians(tmp_path / "a")
    assert words in str(error.value)


@pytest.mark.parametrize(
    "change",
    [
        entry("shN", count=1), entry("shN", count=65536), picture("i.webp", [[63, 0, 9, 255], [0, 0, 9, 255]], 2),
        picture("q.webp", [[1, 2, 3, 255], [1, 2, 3, 252]], 2), top(count=1),
    ],
)  # fmt: skip
def test_what_a_sog_file_may_say(tmp_path: Path, change: Any) -> None:
    sog_by_hand(tmp_path / "a", change)
    assert load_gaussians(tmp_path / "a").degree == 1


@pytest.mark.parametrize(("data", "words"), [(b"{", "meta.json: not JSON"), (b"[1]", "meta.json: no JSON object")])
def test_a_meta_json_is_an_object(tmp_path: Path, data: bytes, words: str) -> None:
    (tmp_path / "meta.json").write_bytes(data)
    with pytest.raises(InputError, match=words):
        load_gaussians(tmp_path)
    with zipfile.ZipFile(tmp_path / "a.sog", "w") as archive:
        archive.writestr("other.json", b"{}")
    with pytest.raises(InputError, match=r"lacks meta\.json"):
        load_gaussians(tmp_path / "a.sog")


def test_pictures_hold_little_more_than_their_gaussians(tmp_path: Path) -> None:
    def of(width: int, height: int) -> Any:
        return picture("s.webp", [[0, 0, 0, 255]] * (width * height), width)

    for width, height, is_fine in ((50, 82, True), (4100, 1, True), (51, 82, False), (4101, 1, False)):
        sog_by_hand(tmp_path / f"{width}", of(width, height))
        if is_fine:  # 2 · 2 + 4096 pixels
            assert load_gaussians(tmp_path / f"{width}").count == 2
        else:
            with pytest.raises(InputError, match=rf"s\.webp: {width}x{height} pixels, expected about 2"):
                load_gaussians(tmp_path / f"{width}")


def taken_apart(path: Path) -> tuple[dict[str, Any], dict[str, NDArray]]:
    """A written file's meta.json and pictures (h, w, 4)."""
    with zipfile.ZipFile(path) as archive:
        assert {info.compress_type for info in archive.infolist()} == {zipfile.ZIP_STORED}
        names = archive.namelist()
        assert names[-1] == "meta.json"
        pictures = {name: np.asarray(Image.open(io.BytesIO(archive.read(name))).convert("RGBA")) for name in names[:-1]}
        return json.loads(archive.read("meta.json")), pictures


def test_every_value_that_is_written_to_a_sog_file(tmp_path: Path) -> None:
    """Three Gaussians, in the order of a Morton curve; values of up to 256 kinds are kept as they are."""
    means = np.array([[-3, 0.5, 2], [0, 0.5, 2.5], [4, 0.5, 9]])
    quats = np.array([[1, 0, 0, 0], [-0.5, 0.5, 0.5, -0.6], [0, 0.6, 0, -0.8]])
    sh = np.arange(36).reshape(3, 4, 3) / 30.0
    g = Gaussians(means, quats, np.arange(1, 10).reshape(3, 3) / 10, np.array([0, 0.5, 1]), sh)
    save_gaussians(tmp_path / "a.sog", g)
    meta, pictures = taken_apart(tmp_path / "a.sog")
    assert all(
        found.shape == ((4, 4, 4) if name != "shN_centroids.webp" else (1, 192, 4)) for name, found in pictures.items()
    )
    assert (meta["version"], meta["asset"], meta["count"], "model" in meta) == (2, {"generator": "tinysplat"}, 3, False)
    rows = {name.removesuffix(".webp"): found.reshape(-1, 4) for name, found in pictures.items()}
    assert all((found[3:] == [0, 0, 0, 255]).all() for name, found in rows.items() if name != "shN_centroids")
    logs = np.sign(means) * np.log1p(np.abs(means))
    np.testing.assert_allclose(meta["means"]["mins"], logs.min(axis=0), rtol=1e-6)
    np.testing.assert_allclose(meta["means"]["maxs"], logs.max(axis=0), rtol=1e-6)
    span = np.ptp(logs, axis=0)
    codes = np.rint((logs - logs.min(axis=0)) / np.where(span > 0, span, 1) * 65535)
    found = rows["means_l"][:3, :3] + 256.0 * rows["means_u"][:3, :3]
    order = [int(np.flatnonzero((np.abs(codes - row) <= 1).all(axis=1))[0]) for row in found]
    assert sorted(order) == [0, 1, 2] and not found[:, 1].any()
    book = np.array(meta["scales"]["codebook"])
    np.testing.assert_allclose(np.exp(book[rows["scales"][:3, :3]]), g.scales[order], rtol=1e-6)
    book = np.array(meta["sh0"]["codebook"])
    np.testing.assert_allclose(book[rows["sh0"][:3, :3]], sh[order, 0], atol=1e-7)
    assert rows["sh0"][:3, 3].tolist() == [[0, 128, 255][n] for n in order]
    three = [(0, [0, 0, 0]), (3, [0.5, -0.5, -0.5]), (3, [0, -0.6, 0])]  # the rest, with the largest made positive
    norms = np.linalg.norm(quats, axis=1)
    wanted = [
        [*np.rint((np.array(rest) / norm * ROOT + 0.5) * 255), 252 + n]
        for (n, rest), norm in zip(three, norms, strict=True)
    ]
    assert np.abs(rows["quats"][:3] - np.array(wanted)[order]).max() <= 1  # a half may go either way
    assert rows["quats"][:3, 3].tolist() == [wanted[n][3] for n in order]
    higher = meta["shN"]
    assert (higher["bands"], higher["count"]) == (1, 3) and higher["files"] == ["shN_centroids.webp", "shN_labels.webp"]
    vectors = np.array(higher["codebook"])[rows["shN_centroids"].reshape(64, 3, 4)[..., :3]]
    labels = rows["shN_labels"][:3, 0] + 256 * rows["shN_labels"][:3, 1].astype(int)
    np.testing.assert_allclose(vectors[labels], sh[order, 1:], atol=1e-6)
    assert (rows["shN_centroids"][:, 3] == 255).all() and not rows["shN_labels"][:3, 2].any()


def test_antialiased_gaussians_are_said_to_be_so(tmp_path: Path) -> None:
    g = points(5)
    for given, model in ((g, None), (g.with_notes(Notes(antialiased="yes")), "antialiased")):
        save_gaussians(tmp_path / "a.sog", given)
        assert taken_apart(tmp_path / "a.sog")[0].get("model") == model
        assert bool(load_gaussians(tmp_path / "a.sog").notes.antialiased) == bool(model)


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


def test_chunks_without_colours_have_those_of_0_to_1(tmp_path: Path) -> None:
    compressed_ply(tmp_path / "a.ply", colours=False, sh=None)
    g = load_gaussians(tmp_path / "a.ply")
    assert g.degree == 0
    np.testing.assert_allclose(g.sh[:, 0], (np.array([[1, 0, 0], [0.0, 0.2, 0.4]]) - 0.5) / C0, atol=1e-6)


def test_sh_of_other_numbers_than_degrees_have(tmp_path: Path) -> None:
    compressed_ply(tmp_path / "a.ply", sh=8)
    with pytest.raises(InputError, match="2 rows of 8 SH values for 2 Gaussians"):
        load_gaussians(tmp_path / "a.ply")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"float max_scale_z", b"float max_scale_q", "chunk: lacks max_scale_z"),
        (b"uint packed_color", b"uint packed_colou", "vertex: lacks packed_color"),
        (b"uint packed_color", b"float packed_color", "vertex: lacks packed_color"),
        (struct.pack("<f", -3), struct.pack("<f", np.nan), "chunk: a range that is not finite"),
    ],
)
def test_compressed_ply_that_lacks_something(tmp_path: Path, old: bytes, new: bytes, words: str) -> None:
    compressed_ply(tmp_path / "a.ply")
    data = (tmp_path / "a.ply").read_bytes()
    assert data.count(old) == 1
    (tmp_path / "a.ply").write_bytes(data.replace(old, new))
    with pytest.raises(InputError, match=words):
        load_gaussians(tmp_path / "a.ply")


def test_every_value_that_is_written_to_a_compressed_ply(tmp_path: Path) -> None:
    """257 Gaussians are two chunks, the last with one; ends of ranges are kept exactly."""
    g = points(257, 1)
    save_gaussians(tmp_path / "a.compressed.ply", g)
    import plyfile

    file = plyfile.PlyData.read(str(tmp_path / "a.compressed.ply"))
    chunk, vertex, sh = (file[name].data for name in ("chunk", "vertex", "sh"))
    assert (len(chunk), len(vertex), len(sh)) == (2, 257, 257)
    last = load_gaussians(tmp_path / "a.compressed.ply").means[-1]
    row = int(np.abs(g.means - last).sum(axis=1).argmin())
    for n, axis in enumerate("xyz"):
        assert chunk[f"min_{axis}"][1] == chunk[f"max_{axis}"][1] == g.means[row, n]
        assert chunk[f"min_scale_{axis}"][1] == pytest.approx(np.log(g.scales[row, n]), rel=1e-6)
        rest = np.delete(g.means[:, n], row)
        assert (chunk[f"min_{axis}"][0], chunk[f"max_{axis}"][0]) == (rest.min(), rest.max())
    for n, channel in enumerate("rgb"):
        rest = np.delete(0.5 + C0 * g.sh[:, 0, n], row)
        np.testing.assert_allclose(
            (chunk[f"min_{channel}"][0], chunk[f"max_{channel}"][0]), (rest.min(), rest.max()), rtol=1e-5
        )
    word = int(vertex["packed_position"][0])
    first = int(np.abs(g.means - load_gaussians(tmp_path / "a.compressed.ply").means[0]).sum(axis=1).argmin())
    low, high = (np.array([chunk[f"{end}_{axis}"][0] for axis in "xyz"], float) for end in ("min", "max"))
    share = (g.means[first] - low) / (high - low)
    assert [word >> 21, word >> 11 & 1023, word & 2047] == np.rint(share * [2047, 1023, 2047]).tolist()
    assert int(vertex["packed_color"][0]) & 255 == round(float(g.opacities[first]) * 255)
    assert int(vertex["packed_position"][-1]) == int(vertex["packed_scale"][-1]) == 0
    quat = g.quats[first] / np.linalg.norm(g.quats[first])
    largest = int(np.abs(quat).argmax())
    three = np.delete(quat, largest) * np.sign(quat[largest])
    word = int(vertex["packed_rotation"][0])
    assert word >> 30 == largest
    assert [word >> 20 & 1023, word >> 10 & 1023, word & 1023] == np.rint((three * ROOT + 0.5) * 1023).tolist()
    codes = np.floor((g.sh[first, 1:].T.ravel() / 8 + 0.5) * 256).clip(0, 255)
    assert [sh[f"f_rest_{n}"][0] for n in range(9)] == codes.tolist()
