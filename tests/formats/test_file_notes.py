"""Notes in files of other tools."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import refusing

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.arrays import read_npz
from tinysplat_runtime.formats.ply_notes import ply_notes


@pytest.mark.parametrize(
    ("comments", "notes"),
    [
        ("comment unit: a\\u00e9\ncomment licence:CC0\r\ncomment other: x\n", {"unit": "aé", "licence": "CC0"}),
        ('comment unit: a"b\\\n', {"unit": 'a"b\\'}),
        ("comment SplatRenderMode: mip\n", {"antialiased": "yes"}),
        ("comment antialiased 1\n", {"antialiased": "yes"}),
        ("comment splatrendermode: MIP\n", {"antialiased": "yes"}),
        ("comment antialiased 0\n", {}),
        ("comment SplatRenderMode: default\n", {}),
    ],
)
def test_notes_in_comments_of_a_ply(tmp_path: Path, comments: str, notes: dict[str, str]) -> None:
    (tmp_path / "a.ply").write_bytes(f"ply\n{comments}end_header\ncomment unit: b\n".encode())
    assert ply_notes(tmp_path / "a.ply") == notes


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b'{"unit": "m", "x": 1}', {"unit": "m"}),
        (b"{", "JSON"),
        (b"[]", "JSON"),
        (b'"' + b"x" * 100_000 + b'"', "notes"),
    ],
)
def test_notes_in_an_npz(tmp_path: Path, data: bytes, expected: Any) -> None:
    np.savez(tmp_path / "a.npz", notes=np.frombuffer(data, np.uint8))
    if isinstance(expected, dict):
        assert read_npz(tmp_path / "a.npz", 1 << 20)[1] == expected
    else:
        with refusing(InputError, expected):
            read_npz(tmp_path / "a.npz", 1 << 20)
    np.savez(tmp_path / "b.npz", other=np.zeros(1))
    assert read_npz(tmp_path / "b.npz", 1 << 20)[1] == {}
