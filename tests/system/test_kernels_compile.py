"""Compiled code is kept for the next process, and compiled anew where another version has left it behind."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("numba")

PAIR = "from typing import NamedTuple\nclass Pair(NamedTuple):\n    a: int\n    b: int\n"
KERNEL = """
from tinysplat_runtime.system.kernels_compile import compiled
@compiled
def total(pair):
    return pair.a + pair.b
"""


def test_types_that_have_moved_do_no_harm(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    for home, other in (("here", "there"), ("there", "here")):
        (tmp_path / f"{home}.py").write_text(PAIR)
        (tmp_path / f"{other}.py").write_text("")
        code = f"from {home} import Pair; from kernel import total; print(total(Pair(1, 2)))"
        done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout) == (0, "3\n"), done.stderr


WITHIN = """
from tinysplat_runtime.system.kernels_compile import compiled, within
from tinysplat_runtime.system.progress import compiling
@within
def twice(x):
    return 2 * x
@compiled
def quadruple(x):
    return twice(twice(x))
print(quadruple(3), compiling.seconds > 0)
"""


def test_a_second_process_compiles_nothing_of_what_calls_others(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(WITHIN)
    said = [
        subprocess.run(
            [sys.executable, "-c", "import kernel"], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        for _ in range(2)
    ]
    assert [one.stdout for one in said] == ["12 True\n", "12 False\n"]
