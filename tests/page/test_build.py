"""The viewer's page: whole, self-contained, and its data are the Gaussians. A browser opens it in test_browser.py."""

import base64
import hashlib
import io
import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from console import tinysplat
from PIL import Image
from scenes import make_cameras, make_gaussians, make_photo, psnr, write_scene

import tinysplat_runtime as ts
from tinysplat_runtime.page.build import PageContent, player_page, scene_page


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
        if given.get("http-equiv") == "Content-Security-Policy":
            self.policy = str(given["content"])
        self.addresses += [str(given[name]) for name in ("src", "href") if name in given]

    def handle_endtag(self, tag: str) -> None:
        self._inside = None

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.texts[self._inside] = self.texts.get(self._inside, "") + data


def file_of(elements: Elements) -> bytes:
    """The file that a page carries."""
    return base64.b85decode(elements.texts.get("file", "").encode().translate(bytes.maketrans(b",./:[", b"<>&$`")))


def test_the_page_loads_nothing_and_escapes_what_it_is_given() -> None:
    page = scene_page(b"", PageContent("a <b> </script><script>alert(1)</script>", photos={0: make_photo(8, 12)}))
    elements = Elements(page)
    assert all(address.startswith("data:") for address in elements.addresses)
    assert elements.texts["title"].strip() == "a <b> </script><script>alert(1)</script>"
    assert "http:" not in page and "https:" not in page
    assert page.count("<script") == player_page().count("<script")  # none of the title's


def test_the_policy_names_the_page_s_own_script_and_style() -> None:
    elements = Elements(player_page())
    for name in ("script", "style"):
        digest = base64.b64encode(hashlib.sha256(elements.texts[name].encode()).digest()).decode()
        assert f"{name}-src 'sha256-{digest}'" in elements.policy
    assert "default-src 'none'" in elements.policy and "unsafe" not in elements.policy
    assert "connect-src blob:;" in Elements(scene_page(b"", PageContent(""))).policy + ";"


def test_the_page_carries_the_file_as_it_is_and_grows_by_little_more() -> None:
    lengths = []
    for size in range(4):  # what fills groups of base 85, and what does not
        data = np.random.default_rng(size).integers(0, 256, 20_000 * size + size).astype(np.uint8).tobytes()
        page = scene_page(data, PageContent(""))
        assert file_of(Elements(page)) == data
        lengths.append(len(page))
    assert max(np.diff(lengths)) < 20_001 * 1.5


def test_photos_and_cameras_are_in_the_page() -> None:
    photo, camera = make_photo(8, 12), make_cameras(1, 24, 32)[0]
    scene = json.loads(Elements(scene_page(b"", PageContent("", cameras=[camera], photos={1: photo}))).texts["scene"])
    kind, _, data = scene["photos"]["1"].partition(",")
    assert kind.startswith("data:image/") and list(scene["photos"]) == ["1"]
    assert psnr(np.array(Image.open(io.BytesIO(base64.b64decode(data)))) / 255, photo / 255) > 25
    assert "background" not in scene
    on_white = json.loads(Elements(scene_page(b"", PageContent("", background=(1.0, 1.0, 1.0)))).texts["scene"])
    assert on_white["background"] == [1, 1, 1]
    view = scene["cameras"][0]
    assert (view["width"], view["fx"], view["c2w"]) == (32, camera.K[0, 0], camera.c2w.reshape(-1).tolist())


# ---- the command -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def encoded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("view")
    scene = write_scene(folder / "desk", views=3, height=24, width=32)
    cameras = make_cameras(3, 24, 32)
    gaussians = replace(make_gaussians(3, 24, 32), cameras=tuple(cameras))
    noted = gaussians.with_notes(ts.Notes(attribution="Ana <b>", licence="CC-BY-4.0"))
    (folder / "g.tsplat").write_bytes(ts.compress(noted))
    ts.save_gaussians(folder / "g.spz", gaussians)
    return {"folder": folder, "scene": scene, "tsplat": folder / "g.tsplat", "spz": folder / "g.spz"}


def test_a_file_becomes_a_page_with_its_photos(encoded: dict[str, Path], tmp_path: Path) -> None:
    done = tinysplat("view", encoded["tsplat"], "--html", tmp_path / "v.html", "--photos", encoded["scene"])
    assert done.returncode == 0, done.stderr
    page = Elements((tmp_path / "v.html").read_text())
    assert list(json.loads(page.texts["scene"])["photos"]) == ["0", "1", "2"]
    assert file_of(page) == encoded["tsplat"].read_bytes()
    done = tinysplat("view", encoded["spz"], "--html", tmp_path / "w.html")
    assert done.returncode == 0, done.stderr
    assert ts.inspect(file_of(Elements((tmp_path / "w.html").read_text())))["mode"] == "list"


def test_files_of_photos_become_gaussians_in_the_page(encoded: dict[str, Path], tmp_path: Path) -> None:
    scene, photos = encoded["scene"], tmp_path / "p.tsplat"
    assert tinysplat("encode", scene, "--mode", "photos", "-o", photos, "--model", "sweep", "-q").returncode == 0
    done = tinysplat("view", photos, "--html", tmp_path / "p.html")
    assert done.returncode == 0, done.stderr
    assert ts.inspect(file_of(Elements((tmp_path / "p.html").read_text())))["mode"] == "gaussians"
