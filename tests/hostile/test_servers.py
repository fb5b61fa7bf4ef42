"""Servers of strangers: SECURITY promises that what one says is checked, and that nothing is written elsewhere."""

from __future__ import annotations

import re
import tempfile
import time
from http.server import BaseHTTPRequestHandler
from pathlib import Path

import pytest
from hostile.strangers import Answer, say, serving
from scenes import make_smooth_gaussians, refusing

import tinysplat_runtime as ts
from tinysplat.batch.storage import local_folder
from tinysplat_runtime.codec.byte_ranges import ranges_of
from tinysplat_runtime.errors import InputError

# ---- listings of folders -----------------------------------------------------------------------------------------


def listing(*links: str) -> bytes:
    return "".join(f'<a href="{link}">x</a>' for link in links).encode()


@pytest.mark.parametrize(
    "link", ["../../x/evil.txt", r"..\..\evil.txt", "C:evil.txt", "a/../../evil.txt", "a//evil.txt", "a\x1b]0;evil"]
)
def test_a_listing_leads_nowhere_but_into_its_folder(
    link: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    pages, asked = {"/scene/": listing("good.txt", link)}, []

    def answer(handler: BaseHTTPRequestHandler) -> None:
        asked.append(handler.path)
        say(handler, 200, pages.get(handler.path, b"evil"), Content_Type="text/html")

    with serving(answer) as address, refusing(InputError, f"{address}/scene"):
        local_folder(f"{address}/scene").__enter__()
    assert {path.removesuffix("/") for path in asked} <= {"/scene", "/scene/good.txt"} and not list(tmp_path.rglob("*"))


def test_a_listing_without_an_end_ends() -> None:
    def answer(handler: BaseHTTPRequestHandler) -> None:
        say(handler, 200, listing("deeper/"), Content_Type="text/html")

    with serving(answer) as address, refusing(InputError, f"{address}/scene"):
        local_folder(f"{address}/scene").__enter__()


def test_folders_and_single_files_are_fetched() -> None:
    files = {"/scene": listing("a.txt", "sub/"), "/scene/sub": listing("b.txt")}
    files |= {"/scene/a.txt": b"a", "/scene/sub/b.txt": b"b"}

    def answer(handler: BaseHTTPRequestHandler) -> None:
        kind = "text/plain" if handler.path.endswith("txt") else "text/html"
        say(handler, 200, files.get(handler.path.rstrip("/"), b""), Content_Type=kind)

    with serving(answer) as address:
        with local_folder(f"{address}/scene") as folder:
            found = {str(path.relative_to(folder)): path.read_bytes() for path in Path(folder).rglob("*.txt")}
        with local_folder(f"{address}/scene/a.txt") as file:
            assert Path(file).suffix == ".txt" and Path(file).read_bytes() == b"a"
    assert found == {"a.txt": b"a", "sub/b.txt": b"b"}


# ---- ranges of a file --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def data() -> bytes:
    return ts.compress(make_smooth_gaussians(9, 48, 64, 1), "fast")


def ranges(data: bytes, asked: list[tuple[int, int]]) -> Answer:
    """An honest server, which notes what it is asked for."""

    def answer(handler: BaseHTTPRequestHandler) -> None:
        first, last = map(int, re.findall(r"\d+", handler.headers["Range"]))
        asked.append((first, last))
        part = data[first : last + 1]
        if not part:
            return say(handler, 416)
        return say(handler, 206, part, Content_Range=f"bytes {first}-{first + len(part) - 1}/{len(data)}")

    return answer


def test_an_honest_server_is_read_by_ranges(data: bytes) -> None:
    whole, asked = ts.decompress(data), list[tuple[int, int]]()
    with serving(ranges(data, asked)) as address, ts.open(f"{address}/walk.tsplat") as file:
        assert (file.views([7]).means == whole.means[7:8]).all()
    assert asked[0][0] == 0


LIES = {
    "no ranges": ({"status": 200}, "gives no ranges of a file, .* download it"),
    "no Content-Range": ({"stated": None}, "Content-Range ''"),
    "another place": ({"stated": "bytes 5-104/200"}, "Content-Range 'bytes 5-104/200' where bytes 0-65535"),
    "less than asked for": ({"stated": "bytes 0-9/99999"}, "Content-Range"),
    "more than asked for": ({"stated": "bytes 0-99999999/999999999"}, "Content-Range"),
    "no end": ({"stated": "bytes 0-65535/99999999"}, "sends more bytes where it announces 65536"),
    "cut short": ({"stated": "bytes 0-65535/99999999", "most": 1000}, "sends 1000 bytes where it announces 65536"),
    "an error": ({"status": 403}, "answers 403"),
    "a loop": ({"status": 302, "to": "/walk.tsplat"}, "redirects more than 5 times"),
    "another way": ({"status": 302, "to": "file:///etc/passwd"}, "answers 302"),
}


@pytest.mark.parametrize("lie", LIES)
def test_a_server_that_lies_is_named_within_what_was_asked_for(lie: str) -> None:
    told, message = LIES[lie]
    sent = []

    def answer(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(told.get("status", 206))
        for name, value in (("Content-Range", told.get("stated")), ("Location", told.get("to"))):
            if value is not None:
                handler.send_header(name, value)
        handler.end_headers()
        for _ in range(0, told.get("most", 64 << 20), 1000):
            handler.wfile.write(bytes(1000))
            sent.append(1000)

    with serving(answer) as address, refusing(InputError, message) as caught:
        ts.open(f"{address}/walk.tsplat")
    assert "\n" not in str(caught.value) and sum(sent) < 16 << 20  # what is in the buffers of two sockets at most


def test_a_server_that_says_nothing_is_given_up() -> None:
    begun = time.monotonic()
    with serving(lambda _: time.sleep(5)) as address, refusing(InputError, f"{address}/walk.tsplat 0.3"):
        ranges_of(f"{address}/walk.tsplat", 0.3).read([(0, 10)])
    assert time.monotonic() - begun < 4
