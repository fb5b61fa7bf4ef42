"""How much memory there is: the machine's or the container's, whichever is less, and what is known of either."""

from __future__ import annotations

from pathlib import Path

import pytest

from tinysplat_runtime.system import memory

MEMINFO = "MemTotal:       4000 kB\nMemFree:         500 kB\nMemAvailable:   3000 kB\nBuffers:  70 kB\n"


@pytest.mark.parametrize(
    ("meminfo", "limit", "used", "expected"),
    [
        (MEMINFO, None, None, 3000 * 1024),
        (MEMINFO, "max", "1000", 3000 * 1024),
        (MEMINFO, "2000000\n", "300000\n", 1_700_000),
        (MEMINFO, "90000000", "1000", 3000 * 1024),
        (MEMINFO, "2000", None, 3000 * 1024),
        ("MemFree: 500 kB\n", "2000", "500", 1500),
        ("MemFree: 500 kB\n", None, None, None),
        (None, "2000", "500", 1500),
        (None, None, None, None),
    ],
)
def test_the_lesser_of_what_machine_and_container_leave(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, meminfo: str | None, limit: str | None, used: str | None,
    expected: int | None,
) -> None:  # fmt: skip
    for name, text in (("meminfo", meminfo), ("memory.max", limit), ("memory.current", used)):
        if text is not None:
            (tmp_path / name).write_text(text)
    monkeypatch.setattr(memory, "_MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr(memory, "_CGROUP", tmp_path)
    assert memory.available_bytes() == expected


def test_linux_s_own_files_are_read_where_there_are_any() -> None:
    known = Path("/proc/meminfo").exists() and "MemAvailable:" in Path("/proc/meminfo").read_text()
    assert not known or 0 < (memory.available_bytes() or 0) < 2**60
