"""The viewer's page: whole, self-contained, and its data are the Gaussians. A browser opens it in checks/viewer.py."""

from __future__ import annotations

import base64
import gzip
import io
import json
import re
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scenes import make_cameras, make_gaussians, make_photo, make_smooth_gaussians, write_scene

import tinysplat_runtime as ts
from tinysplat.viewer import page
from tinysplat.viewer.page import DEPTH, build_page
from tinysplat_runtime.gaussian.gaussians import Gaussians

SCRIPT = Path(sys.executable).with_name("tinysplat")

LIBRARIES = Path(page.__file__).with_name("libraries.js.gz")


@pytest.fixture(autouse=True, scope="module")
def libraries() -> Iterator[None]:
    """A script in the libraries' place where `make viewer` has not built them; checks/viewer.py runs the real one."""
    if LIBRARIES.exists():
        yield
        return
    LIBRARIES.write_bytes(gzip.compress(b"const Libraries = {};"))
    try:
        yield
    finally:
        LIBRARIES.unlink()


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
    return Elements(build_page(gaussians, gaussians.cameras, title="a <b>", **options))  # type: ignore[arg-type]


def columns_of(elements: Elements) -> tuple[dict[str, NDArray], dict]:
    scene = json.loads(elements.texts["scene"])
    data = gzip.decompress(base64.b64decode(elements.texts["arrays"]))
    columns, at, n = {}, 0, scene["count"]
    for name, width in scene["columns"]:
        planes = np.frombuffer(data[at : at + n * width], np.uint8).reshape(width, n)
        columns[name] = np.ascontiguousarray(planes.T).view("<f4" if width == 4 else "<f2")[:, 0].astype(float)
        at += n * width
    assert at == len(data)
    return columns, scene


def test_the_page_loads_nothing_and_escapes_what_it_is_given() -> None:
    elements = page_of(make_gaussians(degree=2), summary="</script><script>alert(1)</script>")
    assert elements.addresses == []
    assert elements.texts["title"].strip() == "a <b>"
    assert json.loads(elements.texts["scene"])["summary"] == "</script><script>alert(1)</script>"
    assert base64.b64decode(elements.texts["libraries"]) == LIBRARIES.read_bytes()
    assert set(re.findall(r"\$\w+", elements.texts["libraries"])) == set()


def test_the_page_s_columns_project_where_the_scene_s_cameras_put_them() -> None:
    scene = make_smooth_gaussians(2, 12, 16, degree=4, layers=2, origin=np.array([1e5, -3e5, 0.0]))
    columns, described = columns_of(page_of(scene))
    assert described["count"] == scene.count and described["degree"] == 3
    assert sum(name.startswith("f_rest_") for name in columns) == 45
    means = np.stack([columns[axis] for axis in "xyz"], axis=1)
    flat = scene.flat()
    for camera, given in zip(scene.cameras, described["cameras"], strict=True):
        fx, fy, cx, cy = given["intrinsics"]
        local = (means - np.array(given["pose"])[:3, 3]) @ np.array(given["pose"])[:3, :3]  # OpenGL axes
        found = np.stack([cx - fx * local[:, 0] / local[:, 2], cy + fy * local[:, 1] / local[:, 2]], axis=1)
        seen = (flat.means + flat.origin - camera.centre) @ camera.rotation.T
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        pixels = seen @ K.T
        np.testing.assert_allclose(found, pixels[:, :2] / pixels[:, 2:], atol=0.02)
    up = np.mean([np.array(given["pose"])[:3, 1] for given in described["cameras"]], axis=0)
    assert up @ (0, 1, 0) > 0.9
    depths = -means[:, 2]
    np.testing.assert_allclose(np.median(depths[depths > 0]), DEPTH, rtol=1e-3)
    np.testing.assert_allclose(1 / (1 + np.exp(-columns["opacity"])), flat.opacities, atol=1e-3)


def test_photos_and_bytes_are_in_the_page() -> None:
    gaussians = make_gaussians()
    photo = make_photo(8, 12)
    _, scene = columns_of(page_of(gaussians, photos={1: photo}, bytes_by_class={"depth": 7}))
    kind, _, data = scene["cameras"][1]["photo"].partition(",")
    assert kind == "data:image/png;base64" and "photo" not in scene["cameras"][0]
    np.testing.assert_array_equal(np.array(Image.open(io.BytesIO(base64.b64decode(data)))), photo)
    assert scene["bytes"] == {"depth": 7}


def test_libraries_that_were_never_built_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(page.importlib.resources, "files", lambda _: tmp_path)
    with pytest.raises(ts.InputError, match="make viewer"):
        page.libraries()


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
    assert [("photo" in camera) for camera in scene["cameras"]] == [True] * 3
    assert set(scene["bytes"]) >= {"depth", "color", "metadata"} and "profile balanced" in scene["summary"]
    assert scene["summary"].endswith("; Ana <b>, CC-BY-4.0")
    done = tinysplat("view", encoded["spz"], "--html", tmp_path / "v.html")
    assert done.returncode == 0, done.stderr
    assert len(columns_of(Elements((tmp_path / "v.html").read_text()))[1]["cameras"]) == 1


def test_the_server_gives_the_page_and_nothing_else(encoded: dict[str, Path]) -> None:
    command = [str(SCRIPT), "view", str(encoded["tsplat"]), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            address = server.stdout.readline().split()[0]
            assert address.startswith("http://127.0.0.1:")
            with urllib.request.urlopen(address) as response:
                assert b"<title>g.tsplat</title>" in response.read()
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
