"""Servers of strangers: SECURITY promises that what one says is checked, and that nothing is written elsewhere."""

import tempfile
from http.server import BaseHTTPRequestHandler
from pathlib import Path

import pytest
from hostile.strangers import say, serving
from scenes import refusing

from tinysplat.batch.storage import local_folder
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
