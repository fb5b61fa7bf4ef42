"""The app for people without a terminal: what is dropped becomes a page, and what cannot be used is said."""

import json
import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from poses.walls import write_photos_of_walls

import tinysplat_runtime as ts

ROOT = Path(__file__).resolve().parents[2]
pytest.importorskip("gradio", reason="pip install '.[app]' brings it")


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port = found.getsockname()[1]
    environment = os.environ | {"GRADIO_SERVER_PORT": str(port), "GRADIO_ANALYTICS_ENABLED": "False"}
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), str(ROOT / "runtime")])
    server = subprocess.Popen([sys.executable, ROOT / "examples/app/app.py"], env=environment)
    try:
        for _ in range(600):
            try:
                urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=5).close()
                break
            except OSError:
                assert server.poll() is None, "the app ended"
                time.sleep(0.1)
        yield f"http://127.0.0.1:{port}/"
    finally:
        server.terminate()
        server.wait()


ASK = """
import json, sys
from gradio_client import Client, handle_file
client = Client(sys.argv[1], verbose=False)
try:
    print(json.dumps(client.predict([handle_file(name) for name in sys.argv[2:]], api_name="/make")))
except Exception as error:
    print(json.dumps(str(error)))
"""


def made_of(address: str, *files: Path) -> object:
    """What the app gives for files, through its own client in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", ASK, address, *map(str, files)], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def test_photos_become_a_page_and_a_file(address: str, tmp_path: Path) -> None:
    write_photos_of_walls(tmp_path / "photos", 3)
    stages, frame, results = made_of(address, *sorted((tmp_path / "photos").glob("*.png")))
    assert "3" in stages and "<iframe" in frame
    page, file = (Path(result) for result in results)
    assert page.suffix == ".html" and page.read_text("utf-8").startswith("<!DOCTYPE html>")
    assert len(ts.inspect(file.read_bytes())["viewpoints"]) == 3


def test_what_cannot_be_used_is_said(address: str, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("words")
    write_photos_of_walls(tmp_path / "one", 1)
    said = [made_of(address, tmp_path / name) for name in ("notes.txt", "one/0.png")]
    assert all(isinstance(words, str) for words in said) and ".jpg" in str(said[0])  # no page, but what is wrong
