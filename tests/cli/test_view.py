"""`view`: pages that are served or written, what goes into them, and a player's folder."""

from __future__ import annotations

import http.server
import json
import queue
import threading
import urllib.error
import urllib.request
import webbrowser
from pathlib import Path
from types import SimpleNamespace

import console
import numpy as np
import pytest
from scenes import make_free_gaussians, make_smooth_gaussians, write_scene

import tinysplat_runtime as ts
from tinysplat_runtime.cli import player, view
from tinysplat_runtime.cli.player import write_player
from tinysplat_runtime.cli.view import _file, _photos, serve
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.graphs.enlarge import LARGE_PIXELS
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
    ts.save_gaussians(path / "free.ply", make_free_gaussians(40, 0, np.random.default_rng(1)))
    return path


@pytest.fixture
def pages(monkeypatch: pytest.MonkeyPatch) -> list[tuple[bytes, dict]]:
    """What pages are made of."""
    made: list[tuple[bytes, dict]] = []
    monkeypatch.setattr(view, "scene_page", lambda data, **parts: made.append((data, parts)) or "<p>ä" + "x" * 1496)
    monkeypatch.setattr(view, "player_page", lambda: "player")
    return made


def test_a_page_holds_the_file_its_views_and_the_photos_taken_from_them(
    folder: Path, tmp_path: Path, pages, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(view, "compress", lambda gaussians, qp: f"{gaussians.count} at {qp}".encode())
    page = tmp_path / "o.html"
    said = console.succeed("view", folder / "f.tsplat", "--html", page, "--cameras", folder / "desk")
    assert said == f"{page}: 2 KB, opens without a network\n" and page.read_text("utf-8").startswith("<p>äxxx")
    assert pages[-1] == ((folder / "f.tsplat").read_bytes(), {"title": "f", "cameras": [], "photos": {}})

    console.succeed("view", folder / "free.ply", "--html", page, "--force", "--cameras", folder / "desk", "-q")
    data, parts = pages[-1]
    assert data == b"40 at -6.0" and len(parts["cameras"]) == 3 and parts["photos"] == {}

    for file, words, views in (("g.npz", (), 2), ("free.ply", ("--cameras", folder / "desk"), 3)):
        console.succeed("view", folder / file, "-o", page, "--force", "--photos", folder / "desk", *words)
        assert [*pages[-1][1]["photos"]] == [*range(views)]
    console.succeed("view", folder / "free.ply", "-o", page, "--force", "--photos", folder / "desk")
    assert pages[-1][1] == {"title": "free", "cameras": [], "photos": {}}


def test_photos_are_those_of_the_frames_at_the_views_sizes(folder: Path) -> None:
    scene = load_scene(folder / "desk")
    frames = [scene.frames[n].camera for n in (2, 0)]
    elsewhere = np.eye(4)
    elsewhere[:3, 3] = 50, 0, 0
    smaller = ts.Camera(np.diag([0.5, 0.5, 1]) @ frames[0].K, frames[0].c2w, 16, 12)
    found = _photos(scene, [smaller, ts.Camera(frames[0].K, elsewhere, 32, 24), frames[1]])
    assert [*found] == [0, 2] and found[0].shape == (12, 16, 3) and found[2].shape == (24, 32, 3)
    np.testing.assert_array_equal(found[2], scene.frames[0].resized(24, 32).image())
    np.testing.assert_array_equal(found[0], scene.frames[2].resized(12, 16).image())
    with pytest.raises(InputError, match=r"desk: no photo was taken from any of the file's views"):
        _photos(scene, [ts.Camera(frames[0].K, elsewhere, 32, 24)])


def test_files_of_networks_and_other_formats_become_files_that_any_page_decodes(tmp_path: Path, monkeypatch) -> None:
    g = make_smooth_gaussians(2, 16, 24, degree=0)
    ts.save_gaussians(tmp_path / "g.NPZ".lower(), g)
    data, views = _file(str(tmp_path / "g.npz"))
    assert data == ts.compress(ts.load_gaussians(tmp_path / "g.npz"), qp=-6) and len(views) == 2
    (tmp_path / "f.TSPLAT").write_bytes(plain := ts.compress(g))
    assert _file(str(tmp_path / "f.TSPLAT"))[0] == plain
    monkeypatch.setattr(view, "decompress", lambda data: (data, "decoded"))
    monkeypatch.setattr(view, "compress", lambda gaussians: (gaussians, "coded"))
    for mode in ("photos", "hybrid", "gaussians", "lossless", "free"):
        monkeypatch.setattr(view, "read_container", lambda data, mode=mode: SimpleNamespace(mode=mode, cameras=[1]))
        expected = ((plain, "decoded"), "coded") if mode in ("photos", "hybrid") else plain
        assert _file(str(tmp_path / "f.TSPLAT")) == (expected, [1])
    (tmp_path / "bad.npz").write_bytes(b"x")
    with pytest.raises(InputError, match=r"bad\.npz"):
        _file(str(tmp_path / "bad.npz"))


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
        assert error.value.code == 404 and error.value.headers["Content-Type"] == "text/plain"
        error.value.close()
        if browser:
            assert opened.get(timeout=20) == address
    finally:
        server.shutdown()
        thread.join()
    out, err = capsys.readouterr()
    assert (out, err) == (f"{address} (Ctrl-C ends)\n", "") and opened.empty()


@pytest.mark.parametrize(
    ("words", "expected"), [((), (0, False, True)), (("-q", "--no-browser", "--port", 9), (9, True, False))]
)
def test_without_an_output_the_page_is_served(folder: Path, monkeypatch, pages, words, expected) -> None:
    asked = []
    monkeypatch.setattr(
        view, "serve", lambda page, port, *, quiet, browser: asked.append((page[:4], port, quiet, browser))
    )
    console.succeed("view", folder / "f.tsplat", *words)
    assert asked == [("<p>ä", *expected)]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("--networks none", "--networks: goes with --player -o FOLDER"),
        ("--networks none --player", "--networks: goes with --player -o FOLDER"),
        ("--networks none -o NEW", "--networks: goes with --player -o FOLDER"),
        ("--player", "--player: missing; -o names the page to write"),
        ("", "F: missing; name a scene, or write a player of any with --player"),
    ],
)
def test_what_is_missing_is_said(tmp_path: Path, words: str, line: str) -> None:
    assert console.fail("view", *words.replace("NEW", str(tmp_path / "new")).split()) == f"tinysplat: {line}\n"


@pytest.mark.parametrize("option", ["-o", "--html"])
def test_a_player_is_a_page_without_a_scene(tmp_path: Path, pages, option: str) -> None:
    assert "0 KB, opens" in console.succeed("view", "--player", option, tmp_path / "p.html")
    assert (tmp_path / "p.html").read_text() == "player" and pages == []


def test_a_player_with_networks_is_a_folder_for_a_web_server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "ort"
    (package / "dist").mkdir(parents=True)
    (package / "package.json").write_text('{"name": "onnxruntime-web"}')
    (package / "dist" / "ort.wasm.bundle.min.mjs").write_bytes(b"code")
    (package / "dist" / "ort-wasm-simd-threaded.wasm").write_bytes(b"w" * 700_000)
    told = []
    limits = SimpleNamespace(stride=16, min_side=32)
    monkeypatch.setattr(player, "GraphStore", lambda: SimpleNamespace(network=lambda name: name))
    monkeypatch.setattr(player, "NetworkLimits", SimpleNamespace(of=lambda network: limits))
    monkeypatch.setattr(player, "player_page", lambda networks: told.append(networks) or "<p>")
    said = write_player(str(tmp_path / "out"), str(package))
    (networks,) = told
    artifacts = [a for a in player.load_manifest().values() if a.role == "network"]
    assert networks["most"] == LARGE_PIXELS
    assert (networks["runtime"], networks["wasm"]) == ("ort.wasm.bundle.min.mjs", "ort-wasm-simd-threaded.wasm")
    assert {sha: model["file"] for sha, model in networks["models"].items()} == {
        a.sha256: a.path.name for a in artifacts
    }
    assert all((model["stride"], model["minSide"]) == (16, 32) for model in networks["models"].values())
    files = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert files["index.html"] == b"<p>" and files["ort.wasm.bundle.min.mjs"] == b"code"
    assert all(files[a.path.name] == a.path.read_bytes() for a in artifacts) and len(files) == 3 + len(artifacts)
    size = sum(map(len, files.values())) / 1e6
    assert said == f"{tmp_path / 'out' / 'index.html'}: {size:.1f} MB in {len(files)} files, for a web server to give"
    assert write_player(str(tmp_path / "out"), str(package)) == said  # a folder that is there is written to


@pytest.mark.parametrize(
    ("text", "words"), [(None, "no npm package"), ("{", "no npm package"), ("[]", "another npm package"),
                        (json.dumps({"name": "three"}), "another npm package")]
)  # fmt: skip
def test_folders_that_are_not_onnxruntime_web_are_refused(tmp_path: Path, text: str | None, words: str) -> None:
    if text is not None:
        (tmp_path / "package.json").write_text(text)
    with pytest.raises(InputError) as error:
        write_player(str(tmp_path / "out"), str(tmp_path))
    advice = "expected the folder of onnxruntime-web; `npm install onnxruntime-web` brings it"
    assert str(error.value) == f"{tmp_path}: {words}, {advice}"
