"""What is said of tests whose extra is not installed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = """
import pytest
def test_of_an_extra(): import numba
def test_of_nothing(): import nowhere
"""


@pytest.mark.parametrize(
    ("variables", "outcome"), [({}, "1 failed, 2 skipped"), ({"TINYSPLAT_ALL_EXTRAS": "1"}, "error")]
)
def test_a_missing_extra_is_named_and_where_all_are_wanted_it_is_a_failure(tmp_path, variables, outcome):
    shutil.copy(Path(__file__).parents[1] / "conftest.py", tmp_path)
    (tmp_path / "numba.py").write_text("raise ModuleNotFoundError('No module named numba', name='numba')")
    (tmp_path / "test_a.py").write_text(TESTS)
    (tmp_path / "test_b.py").write_text("import numba")
    environment = {name: value for name, value in os.environ.items() if name != "TINYSPLAT_ALL_EXTRAS"}
    environment |= {"PYTHONPATH": str(tmp_path), **variables}
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-ra",
        "-p",
        "no:cacheprovider",
        "--rootdir",
        str(tmp_path),
        str(tmp_path),
    ]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert outcome in done.stdout.splitlines()[-1]
    assert done.stdout.count('needs numba: pip install "tinysplat[fast]"') == (2 if not variables else 0)
