"""`view`: pages that are served or written, what goes into them, and a player's folder."""

import http.server
import json
import queue
import threading
import urllib.error
import urllib.request
import webbrowser
from pathlib import Path

import console
import numpy as np
import pytest
from scenes import make_list, make_smooth_gaussians, write_scene

import tinysplat_runtime as ts
from tinysplat_runtime.cli.view import serve
from tinysplat_runtime.scene.intake.layouts import load_scene


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene, `f.tsplat` and `g.npz` seen by its first two cameras, and `free.ply` without any."""
    path = tmp_path_factory.mktemp("view")
    write_scene(path / "desk", 3, 24, 32)
    g = make_smooth_gaussians(2, 24, 32, degree=0)
    cameras = tuple(frame.camera for frame in load_scene(path / "desk").frames[:2])
    g = ts.Gaussians(g.means, g.quats, g.scales, g.opacities, g.sh, cameras)
    ts.save_gaussians(path / "g.npz", g)
    (path / "f.tsplat").write_bytes(ts.compress(make_smooth_gaussians(2, 24, 32, degree=0)))
    ts.save_gaussians(path / "free.ply", make_list(40, 0, np.random.default_rng(1)))
    return path


@pytest.mark.parametrize("browser", [True, False])
def test_a_page_is_served_to_this_machine_alone(monkeypatch: pytest.MonkeyPatch, capsys, browser: bool) -> None:
    servers, opened = queue.Queue[http.server.ThreadingHTTPServer](), queue.Queue[str]()

    class Server(http.server.ThreadingHTTPServer):
        def serve_forever(self, poll_interval: float = 0.01) -> None:
            servers.put(self)
            super().serve_forever(poll_interval)

    monkeypatch.setattr(http.server, "ThreadingHTTPServer", Server)
    monkeypatch.setattr(webbrowser, "open", opened.put)
    thread = threading.Thread(target=serve, args=("<p>Größe", 0), kwargs={"quiet": False, "browser": browser})
    thread.start()
    server = servers.get(timeout=20)
    try:
        address = f"http://127.0.0.1:{server.server_address[1]}/"
        assert server.server_address[0] == "127.0.0.1"
        for path in ("", "index.html", "?a=1", "index.html?a=1"):
            with urllib.request.urlopen(address + path, timeout=20) as answer:
                assert (answer.status, answer.read().decode()) == (200, "<p>Größe")
                assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
                assert answer.headers["Content-Length"] == str(len("<p>Größe".encode()))
        with pytest.raises(urllib.error.HTTPError) as error:
            urllib.request.urlopen(address + "other", timeout=20)
        assert error.value.code == 404
        error.value.close()
        if browser:
            assert opened.get(timeout=20) == address
    finally:
        server.shutdown()
        thread.join()
    out, err = capsys.readouterr()
    assert address in out.split() and err == "" and opened.empty()


@pytest.mark.parametrize(("words", "named"), [("--player", ("--player", "--html")), ("", ("F: ", "--player"))])
def test_what_is_missing_is_said(tmp_path: Path, words: str, named: tuple[str, ...]) -> None:
    said = console.fail("view", *words.split())
    assert all(name in said for name in named)


def test_a_page_is_one_file_of_a_scene_and_its_photos_and_a_player_one_of_none(folder: Path, tmp_path: Path) -> None:
    sizes = []
    for words in (("--player",), (folder / "f.tsplat",), (folder / "g.npz", "--photos", folder / "desk")):
        page = tmp_path / f"{len(sizes)}.html"
        assert str(page) in console.succeed("view", *words, "--html", page)
        text = page.read_text("utf-8")
        assert "<script" in text and "https://" not in text
        sizes.append(len(text))
    assert sizes[0] < sizes[1] < sizes[2]


def test_a_folder_of_plain_files_holds_the_scene(folder: Path, tmp_path: Path) -> None:
    words = ("view", folder / "f.tsplat", "--files", "--html", f"{tmp_path / 'site'}/")
    assert "index.html" in console.succeed(*words)
    assert (tmp_path / "site" / "scene.tsplat").read_bytes() == (folder / "f.tsplat").read_bytes()
    assert "index.html" in console.succeed(*words)  # again, over its own


def test_photos_must_be_of_the_files_views(folder: Path, tmp_path: Path) -> None:
    write_scene(tmp_path / "far", 2, 24, 32)
    document = json.loads((tmp_path / "far" / "cameras.json").read_text())
    for frame in document["frames"]:
        frame["c2w"][0][3] += 50
    (tmp_path / "far" / "cameras.json").write_text(json.dumps(document))
    assert "far" in console.fail("view", folder / "g.npz", "--html", tmp_path / "o.html", "--photos", tmp_path / "far")
