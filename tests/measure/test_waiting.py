"""What users wait for: commands of a checkout, their memory, and what is said of rows."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from tinysplat.measure.rows import Row
from tinysplat.measure.studies.waiting import WAITING, call_of, peak_bytes

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


def waits(thing: str, qp: float, cpu: float) -> Row:
    return Row("waits", "room", f"{thing}, {qp}", {"thing": thing, "qp": qp},
               {"bytes": 1000, "psnr_decoded_raw": 40 - qp}, {"cpu": cpu})  # fmt: skip


def test_the_sentence_is_of_the_default_quality(tmp_path) -> None:
    rows = [
        waits(thing, qp, seconds * (1 if qp == 0 else 9))
        for qp in (-6.0, 0.0)
        for thing, seconds in (
            ("photos to a file", 0.8), ("Gaussians to a file, balanced", 0.4), ("Gaussians to a file, fast", 0.3),
            ("Gaussians to a file, max", 2.0),
        )
    ]  # fmt: skip
    said = "take 800.0 ms of processor time, of which 400.0 ms are coding (`fast` 300.0 ms, `max` 2.00 s)"
    assert said in WAITING.tables["encoding time"](rows)
    assert WAITING.tables["encoding time"](rows[1:4]) == ""
    assert WAITING.plots["waits"](tmp_path / "p.png", rows) and (tmp_path / "p.png").stat().st_size > 1000
