"""`make mutants` tries every room of the runtime, and finds each module's tests by the layout."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RUNTIME = ROOT / "runtime" / "tinysplat_runtime"
NOT_ARITHMETIC = {"cli"}
"""Rooms whose tests are other kinds of evidence: tests/e2e."""


@pytest.mark.parametrize("package", [RUNTIME, ROOT / "tinysplat"], ids=["runtime", "tinysplat"])
def test_every_room_has_tests_of_its_own(package: Path) -> None:
    rooms = {path.name for path in package.iterdir() if path.is_dir() and (path / "__init__.py").is_file()}
    houses = {path.name for path in (ROOT / "tests").iterdir() if list(path.glob("test_*.py"))}
    assert rooms - houses - NOT_ARITHMETIC - {"rasteriser", "reference", "batch", "commands"} == set()


def test_nearest_tests_are_found_by_the_layout(monkeypatch: pytest.MonkeyPatch) -> None:
    tree = ast.parse((ROOT / "checks" / "mutants.py").read_text(encoding="utf-8"))
    wanted = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "nearest_tests"]
    scope: dict[str, object] = {"Path": Path, "re": re, "FEW": 4}
    exec(compile(ast.Module(wanted, []), "mutants.py", "exec"), scope)
    nearest = scope["nearest_tests"]
    assert callable(nearest)
    monkeypatch.chdir(ROOT)
    room = sorted(f"tests/codec/{path.name}" for path in (ROOT / "tests/codec").glob("test_*.py"))
    assert nearest("codec/basis.py")[0] == "tests/codec/test_basis.py" and {*room} <= {*nearest("codec/basis.py")}
    assert "tests/hostile/test_free_attacks.py" in nearest("container/free.py")
    assert nearest("web/hevc/intra.js")[0].startswith("tests/web/")
