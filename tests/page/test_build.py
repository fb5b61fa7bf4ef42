"""The viewer's page: whole, self-contained, and its data are the Gaussians. A browser opens it in checks/viewer.py."""

from __future__ import annotations

import base64
import gzip
import io
import json
import subprocess
import sys
import urllib.error
import urllib.request
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scenes import make_cameras, make_gaussians, make_photo, make_smooth_gaussians, write_scene

import tinysplat_runtime as ts
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.page.build import DEPTH, build_page
from tinysplat_runtime.render import DEFINITION
from tinysplat_runtime.render.paths import outside

SCRIPT = Path(sys.executable).with_name("tinysplat")


class Elements(HTMLParser):
    """Texts of elements by id, and every address that a browser would load."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.texts: dict[str, str] = {}
        self.addresses: list[str] = []
        self._inside: str | None = None
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self._inside = given.get("id") or tag
        self.addresses += [str(given[name]) for name in ("src", "href") if name in given]

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.texts[self._inside] = self.texts.get(self._inside, "") + data


def page_of(gaussians: Gaussians, **options: object) -> Elements:
    return Elements(build_page(gaussians, gaussians.cameras, title="a <b>", **options).whole())  # type: ignore[arg-type]


def columns_of(elements: Elements) -> tuple[dict[str, NDArray], dict]:
    """Columns of whole numbers as unpack.js reads them, and the page's JSON."""
    scene = json.loads(elements.texts["scene"])
    data = gzip.decompress(base64.b64decode(elements.texts["data"]))
    columns, at, n = {}, 0, scene["count"]
    for name, width in scene["columns"]:
        planes = np.frombuffer(data[at : at + n * width], np.uint8).reshape(width, n).astype(np.int64)
        code = (planes << (8 * np.arange(width))[:, None]).sum(axis=0)
        columns[name] = np.cumsum((code >> 1) ^ -(code & 1))
        at += n * width
    assert at == len(data)
    return columns, scene


def gaussians_of(columns: dict[str, NDArray], scene: dict) -> Gaussians:
    """What unpack.js and splats.js make of a page's columns, in page units."""
    if "view" in columns:
        means = np.empty((scene["count"], 3))
        for v, view in enumerate(scene["views"]):
            own = columns["view"] % 64 == v  # layers behind the first are 64 on
            fx, skew, fy, cx, cy = view["K"]
            K = np.array([[fx, skew, cx], [0, fy, cy], [0, 0, 1]])
            pixel = np.stack([columns["pixel_0"][own], columns["pixel_1"][own]]) / scene["pixelSteps"]
            ray = np.linalg.inv(K) @ np.vstack([pixel, np.ones(own.sum())])
            depth = 2 ** (columns["depth"][own] / scene["depthSteps"])
            means[own] = (ray * depth).T @ np.array(view["rotation"]) + view["position"]
    else:
        codes = np.stack([columns[f"mean_{k}"] for k in range(3)], axis=1)
        means = np.sinh(codes * scene["meanStep"]) * scene["meanKnee"]
    steps, lowest = scene["logSteps"]
    codes = np.stack([columns[f"scale_{k}"] for k in range(3)], axis=1)
    three = np.stack([columns[f"quat_{k}"] for k in range(3)], axis=1) / scene["quatSteps"]
    quats = np.array([np.insert(q, k, np.sqrt(1 - q @ q)) for q, k in zip(three, columns["quat_largest"], strict=True)])
    sh, basis = scene["sh"], scene["sh"]["basis"]
    parts = np.stack([columns[name] for name in columns if name.startswith("sh_")], axis=1) * sh["step"]
    coefficients = np.array(sh["mean"]) + (parts if basis is None else parts @ np.array(basis))
    return Gaussians(
        means=means, quats=quats, scales=2 ** (codes / steps - lowest), opacities=columns["opacity"] / 255,
        sh=coefficients.reshape(len(means), -1, 3),
    )  # fmt: skip


def view_of(view: dict) -> ts.Camera:
    fx, skew, fy, cx, cy = view["K"]
    c2w = np.eye(4)
    c2w[:3, :3], c2w[:3, 3] = np.array(view["rotation"]).T, view["position"]
    return ts.Camera(np.array([[fx, skew, cx], [0, fy, cy], [0, 0, 1]]), c2w, view["width"], view["height"])


def psnr(a: NDArray, b: NDArray) -> float:
    return float(-10 * np.log10(np.mean((a.astype(float) - b) ** 2)))


def test_the_page_loads_nothing_and_escapes_what_it_is_given() -> None:
    elements = page_of(make_gaussians(degree=2), summary="</script><script>alert(1)</script>")
    assert elements.addresses == ["data:,"]
    assert elements.texts["title"].strip() == "a <b>"
    assert json.loads(elements.texts["scene"])["summary"] == "</script><script>alert(1)</script>"
    assert "http" not in build_page(make_gaussians(), (), title="").whole()


@pytest.mark.parametrize("degree", [0, 1, 4])
def test_the_page_s_data_draw_the_scene_s_picture_at_every_view(degree: int) -> None:
    scene = make_smooth_gaussians(2, 24, 32, degree=degree, layers=2, origin=np.array([1e5, -3e5, 0.0]))
    columns, described = columns_of(page_of(scene))
    packed = gaussians_of(columns, described)
    assert described["hasCameras"] and "view" in columns and packed.degree == degree
    for camera, view in zip(scene.cameras, described["views"], strict=True):
        assert psnr(ts.render(packed, view_of(view), **DEFINITION), ts.render(scene, camera, **DEFINITION)) > 50
    depths = (packed.means - view_of(described["views"][0]).centre) @ np.array(described["views"][0]["rotation"])[2]
    assert 0.5 * DEPTH < np.median(depths) < 2 * DEPTH


def test_gaussians_of_no_views_are_packed_by_coordinates_and_seen_from_outside() -> None:
    flat = make_gaussians(2, 24, 32, degree=3).flat()
    columns, described = columns_of(Elements(build_page(flat, (), title="").whole()))
    assert not described["hasCameras"] and len(described["views"]) == 1
    packed, view = gaussians_of(columns, described), view_of(described["views"][0])
    picture = ts.render(packed, view)
    assert picture.max() > 0.1
    assert psnr(picture, ts.render(flat, outside(flat))) > 45


def test_the_data_are_small_where_neighbours_are_alike() -> None:
    decoded = ts.decompress(ts.compress(make_smooth_gaussians(2, 48, 64, degree=0), qp=12))
    assert len(build_page(decoded, decoded.cameras, title="").data) < 9 * decoded.count  # 52 bytes as they are


def test_photos_and_bytes_are_in_the_page() -> None:
    gaussians = make_gaussians()
    photo = make_photo(8, 12)
    _, scene = columns_of(page_of(gaussians, photos={1: photo}, bytes_by_class={"depth": 7}))
    kind, _, data = scene["views"][1]["photo"].partition(",")
    assert kind == "data:image/jpeg;base64" and "photo" not in scene["views"][0]
    assert psnr(np.array(Image.open(io.BytesIO(base64.b64decode(data)))) / 255, photo / 255) > 32
    assert scene["bytes"] == {"depth": 7}


# ---- the command -------------------------------------------------------------------------------------------------


def tinysplat(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(SCRIPT), *map(str, arguments)], capture_output=True, text=True, check=False, timeout=120)


@pytest.fixture(scope="module")
def encoded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("view")
    scene = write_scene(folder / "desk", views=3, height=24, width=32)
    cameras = make_cameras(3, 24, 32)
    gaussians = make_gaussians(3, 24, 32).with_cameras(cameras)
    noted = gaussians.with_notes(ts.Notes(attribution="Ana <b>", licence="CC-BY-4.0"))
    (folder / "g.tsplat").write_bytes(ts.compress(noted))
    ts.save_gaussians(folder / "g.spz", gaussians)
    return {"folder": folder, "scene": scene, "tsplat": folder / "g.tsplat", "spz": folder / "g.spz"}


def test_a_file_becomes_a_page_with_its_photos(encoded: dict[str, Path], tmp_path: Path) -> None:
    done = tinysplat("view", encoded["tsplat"], "--html", tmp_path / "v.html", "--photos", encoded["scene"])
    assert done.returncode == 0, done.stderr
    _, scene = columns_of(Elements((tmp_path / "v.html").read_text()))
    assert [("photo" in view) for view in scene["views"]] == [True] * 3
    assert set(scene["bytes"]) >= {"depth", "color", "metadata"} and "profile balanced" in scene["summary"]
    assert scene["summary"].endswith("; Ana <b>, CC-BY-4.0")
    done = tinysplat("view", encoded["spz"], "--html", tmp_path / "w.html")
    assert done.returncode == 0, done.stderr
    assert columns_of(Elements((tmp_path / "w.html").read_text()))[1]["hasCameras"] is False


def test_the_server_gives_the_page_and_nothing_else(encoded: dict[str, Path]) -> None:
    command = [str(SCRIPT), "view", str(encoded["tsplat"]), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            address = server.stdout.readline().split()[0]
            assert address.startswith("http://127.0.0.1:")
            with urllib.request.urlopen(address) as response:
                text = response.read()
            assert b"<title>g</title>" in text and len(text) < 100_000
            with urllib.request.urlopen(f"{address}data") as response:
                assert gzip.decompress(response.read())
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(f"{address}etc/passwd")
        finally:
            server.terminate()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--photos", "nowhere"), "nowhere"),
        (("--port", "70000"), "expected a port"),
        (("--html", "no/such/folder.html"), "does not exist"),
    ],
)
def test_bad_input_of_view_is_one_line(encoded: dict[str, Path], options: tuple[str, str], words: str) -> None:
    done = tinysplat("view", encoded["tsplat"], "--no-browser", *options)
    assert done.returncode == 2 and words in done.stderr and done.stderr.count("\n") == 1


def test_photos_of_another_place_are_refused(encoded: dict[str, Path], tmp_path: Path) -> None:
    other = write_scene(tmp_path / "other", views=2, height=24, width=32)
    path = other / "cameras.json"
    document = json.loads(path.read_text())
    for frame in document["frames"]:
        frame["c2w"][2][3] += 5
    path.write_text(json.dumps(document))
    done = tinysplat("view", encoded["tsplat"], "--html", tmp_path / "v.html", "--photos", other)
    assert done.returncode == 2 and "no photo was taken from any of the file's views" in done.stderr


# ---- notebooks ---------------------------------------------------------------------------------------------------


def test_a_notebook_shows_a_picture_and_figures() -> None:
    gaussians = make_smooth_gaussians(2, 500, 30, degree=1)
    picture = gaussians._repr_png_()
    assert picture is not None and Image.open(io.BytesIO(picture)).size == (23, 384)
    text = gaussians._repr_html_()
    assert "30,000" in text and "2x500x30" in text and "data:image/png;base64," in text
    assert gaussians.flat()._repr_png_() is None and "<img" not in gaussians.flat()._repr_html_()
