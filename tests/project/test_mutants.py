"""`make mutants` tries every room of the runtime, and finds each module's tests by the layout."""

from __future__ import annotations

import ast
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


def test_nearest_tests_are_found_by_the_layout() -> None:
    tree = ast.parse((ROOT / "checks" / "mutants.py").read_text(encoding="utf-8"))
    wanted = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "nearest_tests"]
    scope: dict[str, object] = {"Path": Path}
    exec(compile(ast.Module(wanted, []), "mutants.py", "exec"), scope)
    nearest = scope["nearest_tests"]
    assert callable(nearest)
    assert nearest("codec/basis.py") == ["tests/codec/test_basis.py", "tests/codec"]
    assert nearest("codec/free/octree.py") == ["tests/codec"]
