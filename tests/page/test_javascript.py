"""The tests that are written in JavaScript: each passes in node."""

import subprocess
from pathlib import Path

import pytest
from web.node import node

FILES = sorted(Path(__file__).parents[1].glob("*/*.test.mjs"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_its_claims_hold_in_node(file: Path) -> None:
    done = subprocess.run([node(), "--test", str(file)], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "fail 0" in done.stdout and "tests 0" not in done.stdout
