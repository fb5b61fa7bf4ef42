"""The table of checks/mutants.py: what it names is there, so that no bug goes without its nearest tests."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]


def nearest_tests() -> dict[str, list[str]]:
    """The table, read and not run: what makes mutants is an extra."""
    tree = ast.parse((ROOT / "checks" / "mutants.py").read_text(encoding="utf-8"))
    (table,) = (node.value for node in tree.body if isinstance(node, ast.AnnAssign) and node.target.id == "NEAREST")
    return {module: names.split() for module, names in ast.literal_eval(table).items()}


def test_every_module_and_every_test_file_that_is_named_exists() -> None:
    table = nearest_tests()
    assert len(table) > 50
    for module, names in table.items():
        assert (ROOT / "runtime" / "tinysplat_runtime" / module).is_file(), module
        assert names, module
        for name in names:
            assert (ROOT / "tests" / "unit" / f"test_{name}.py").is_file(), f"{module}: {name}"
