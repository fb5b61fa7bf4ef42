"""What users wait for: commands of a checkout, their memory, and what is said of rows."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from tinysplat.measure.studies.waiting import call_of, peak_bytes

ENTRIES = {"main of its own": "__main__.py", "main of the command line": "cli.py"}


def checkout(root: Path, entry: str, body: str) -> Path:
    """A checkout whose command writes its words into `words` and then does something."""
    package = root / "runtime" / "tinysplat_runtime"
    package.mkdir(parents=True)
    for name in ("__init__.py", "__main__.py"):
        (package / name).touch()
    (package / entry).write_text(
        f"import sys\ndef main():\n    open({str(root / 'words')!r}, 'w').write(' '.join(sys.argv[1:]))\n    {body}\n"
    )
    return root


@pytest.mark.parametrize("entry", ENTRIES.values(), ids=ENTRIES)
def test_a_checkouts_own_command_is_called(entry, tmp_path) -> None:
    root = checkout(tmp_path, entry, "return 0")
    call_of(root, ["decode", "a.tsplat"])()
    assert (root / "words").read_text() == "decode a.tsplat -q --force"
    call_of(root, ["info", "a.tsplat"])()
    assert (root / "words").read_text() == "info a.tsplat"


def test_a_command_that_fails_is_no_figure(tmp_path) -> None:
    with pytest.raises(subprocess.CalledProcessError):
        call_of(checkout(tmp_path, "cli.py", "return 2"), ["info"])()


def test_the_peak_is_the_commands_own(tmp_path) -> None:
    """A process begins with the peak of the one that started it: here, at least 300 MB."""
    here = np.ones(300_000_000, np.uint8)
    peak = peak_bytes(checkout(tmp_path, "cli.py", "len(b'x' * 60_000_000)"), ["decode"])
    assert here[-1] == 1 and 60e6 < peak < 110e6
