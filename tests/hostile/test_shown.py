"""Where strangers' names, texts and files are shown: what SECURITY and PLAYER promise of terminals and pages."""

import http.client
import json
import os
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from conformance.run import CASES
from console import tinysplat
from scenes import make_smooth_gaussians, refusing, write_scene
from sections import changed_section, file_of, sections_of
from web.node import Decoder

import tinysplat_runtime as ts
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.errors import InputError, InputWarning, warn
from tinysplat_runtime.system.printable import UNPRINTED

STEERING = "\x1b]0;owned\x07\x9b31m\u202egnp"


def prints(line: str) -> bool:
    """Whether a line holds no character that steers."""
    return not any(first <= ord(letter) <= last for letter in line.removesuffix("\n") for first, last in UNPRINTED)


# ---- terminals ---------------------------------------------------------------------------------------------------


def test_names_in_errors_and_warnings_do_not_steer_a_terminal(tmp_path: Path) -> None:
    assert prints(str(InputError(f"no {STEERING}", where=f"a{STEERING}.png")))
    with pytest.warns(InputWarning) as said:
        warn(f"photo {STEERING}")
    assert prints(str(said[0].message))
    scene = write_scene(tmp_path / "s", views=2, height=32, width=48)
    document = json.loads((scene / "cameras.json").read_text())
    document["frames"][0]["file"] = f"{STEERING}.png"
    (scene / "cameras.json").write_text(json.dumps(document))
    done = tinysplat("encode", scene, "-o", tmp_path / "o.tsplat")
    assert done.returncode == 2 and r"\x1b]0;owned\x07\x9b31m" in done.stderr
    assert all(prints(line) for line in done.stderr.splitlines(keepends=True))


# ---- the page that `view` serves -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Of `view` of a file whose name is not UTF-8."""
    folder = tmp_path_factory.mktemp("view")
    name = b"n\xff\x1b" if sys.platform == "linux" else b"n"
    file = folder / os.fsdecode(name + b".tsplat")
    file.write_bytes(ts.compress(make_smooth_gaussians(1, 24, 32, degree=0)))
    command = [sys.executable, "-m", "tinysplat_runtime", "view", file, "--port", "0", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        line = process.stdout.readline()
        yield int(line.split(":")[2].split("/")[0])
        process.kill()


def asked(port: int, method: str, host: str | None) -> tuple[int, bytes, http.client.HTTPMessage]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.putrequest(method, "/", skip_host=True)
    if host is not None:
        connection.putheader("Host", host.replace("PORT", str(port)))
    connection.endheaders()
    answer = connection.getresponse()
    said = answer.status, answer.read(), answer.headers
    connection.close()
    return said


@pytest.mark.parametrize(
    "host", ["127.0.0.1:PORT", "localhost:PORT", "localhost:9000", "[::1]:PORT", "192.168.0.7", None]
)
def test_this_machine_is_served_under_its_own_names(port: int, host: str | None) -> None:
    status, body, headers = asked(port, "GET", host)
    assert status == 200 and b"<script" in body and int(headers["Content-Length"]) == len(body)
    body.decode("utf-8")


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:PORT", "127.0.0.1.evil.example", "localhost.evil.example"]
)
def test_a_site_whose_name_leads_to_this_machine_reads_nothing(port: int, host: str) -> None:
    """DNS rebinding: the browser takes its scripts for the page's own, but says their name."""
    status, body, _ = asked(port, "GET", host)
    assert status == 403 and b"<" not in body


# ---- files that cost much --------------------------------------------------------------------------------------------

OF_PAGES = {"maxPixels": 2**25, "maxMemory": 2**31, "maxPerByte": 256}


def constants(side: int) -> bytes:
    """A file mostly of numbers for whole planes: its size says nothing of the grid's."""

    def grow(text: bytearray) -> None:
        text[:8] = struct.pack("<II", side, side)

    def widen(text: bytearray) -> None:
        at = 0
        for column in range(7):
            if column in (5, 6):
                text[at : at + 5] = struct.pack("<Bf", 2, side)
            at += 5 if text[at] & 2 else 9

    data = (CASES / "constants" / "constants.tsplat").read_bytes()
    return changed_section(changed_section(data, L.LAYER, grow), L.CAMERAS, widen)


def test_a_few_bytes_do_not_fill_a_visitors_memory() -> None:
    """PLAYER.md states the limits that a page gives to the decoder."""
    assert len(constants(2000)) < 2000
    with Decoder() as decoder:
        said, _ = decoder(constants(2000), limits=OF_PAGES)
        assert said["error"] == "TsplatError" and "256" in said["message"]
        said, _ = decoder(ts.compress(make_smooth_gaussians(2, 48, 48, 0)), limits=OF_PAGES)
        assert said["count"] == 2 * 48 * 48


def test_parameter_sets_hold_no_more_than_their_place() -> None:
    data = ts.compress(make_smooth_gaussians(1, 16, 16, 0), "fast")
    long = [[k, f, i, d + bytes(4 << 20) if k == L.PARAMETER_SETS else d] for k, f, i, d in sections_of(data)]
    with refusing(ts.FormatError, "HEVC[0] 1024"):
        ts.decompress(file_of(long))
    with Decoder() as decoder:
        said, _ = decoder(file_of(long))
    assert (said["error"], said["section"]) == ("TsplatError", "HEVC[0]")
