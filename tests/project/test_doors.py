"""Tests come in by the door: they name nothing private of the project and replace none of its parts.

What a test holds to is then what somebody outside the module relies on. The clock, memory, processes, the network and
packages that are missing are the world's, not ours, and tests/conftest.py has a fixture for each.
"""

import ast
import contextlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

TESTS = Path(__file__).parents[1]
OURS = ("tinysplat", "tinysplat_runtime", "tinysplat_models", "export")
ALLOWED = Path(__file__).with_name("allowed.txt")
"""How many uses of either kind a file still has; no number in it may rise, and none may be added."""

REPLACES = {"setattr", "delattr", "object", "patch", "setitem", "delitem"}
NAMED_TUPLES = {"_replace", "_asdict", "_fields", "_make"}


def by_the_back_door(text: str) -> Iterator[tuple[str, int, str]]:
    """(kind, line, what it says) of each private name and of each patch of ours in a file of tests."""
    tree = ast.parse(text)
    origins = _origins(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and "import " in node.value:
            with contextlib.suppress(SyntaxError):  # code for a process of its own
                yield from ((kind, node.lineno, what) for kind, _, what in by_the_back_door(node.value))
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in OURS:
            yield from (("private", node.lineno, alias.name) for alias in node.names if _is_private(alias.name))
            continue
        if isinstance(node, ast.Attribute) and _is_private(node.attr):
            kind, owner = "private", _origin(node.value, origins)
        elif isinstance(node, ast.Call) and _replaces(node.func) and node.args:
            kind, owner = "patch", _origin(node.args[0], origins)
        else:
            continue
        if owner == "ours" or (kind == "patch" and owner == "itself"):
            yield kind, node.lineno, ast.unparse(node)


def _is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__") and name not in NAMED_TUPLES and name != "_"


def _replaces(function: ast.expr) -> bool:
    if not isinstance(function, ast.Attribute):
        return False
    holder = ast.unparse(function.value).rpartition(".")[2]
    return function.attr in REPLACES and holder in {"monkeypatch", "patch", "mock", "patches"}


def _origins(tree: ast.Module) -> dict[str, str]:
    """Whose each imported name of a file is."""
    found = {"self": "itself", "cls": "itself"}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = {(alias.asname or alias.name.partition(".")[0]): alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = {(alias.asname or alias.name): node.module for alias in node.names}
        else:
            continue
        for name, module in names.items():
            package = module.partition(".")[0]
            is_ours = package in OURS or (TESTS / package).exists() or (TESTS / f"{package}.py").exists()
            found[name] = "ours" if is_ours else "the world's"
    return found


def _origin(value: ast.expr, origins: dict[str, str]) -> str:
    """Whose an object is; what nobody imported is taken for ours, and so is all that is reached through ours."""
    if isinstance(value, ast.Constant) and isinstance(value.value, str):
        return "ours" if value.value.partition(".")[0] in OURS else "the world's"
    if any(isinstance(node, ast.Constant) and str(node.value).startswith(OURS) for node in ast.walk(value)):
        return "ours"
    while isinstance(value, ast.Attribute | ast.Subscript | ast.Call):
        value = value.func if isinstance(value, ast.Call) else value.value
    return origins.get(value.id, "ours") if isinstance(value, ast.Name) else "ours"


def uses() -> dict[str, Counter[str]]:
    """How many of either kind each file under tests/ has; conftest.py, where the world is replaced, is left out."""
    found = {}
    for path in sorted(TESTS.rglob("*.py")):
        if "__pycache__" not in path.parts and path.name not in ("conftest.py", Path(__file__).name):
            kinds = Counter(kind for kind, _, _ in by_the_back_door(path.read_text(encoding="utf-8")))
            if kinds:
                found[path.relative_to(TESTS).as_posix()] = kinds
    return found


def allowed() -> dict[str, Counter[str]]:
    rows = [line.split() for line in ALLOWED.read_text(encoding="utf-8").splitlines()]
    return {name: Counter({"private": int(private), "patch": int(patches)}) for private, patches, name in rows}


def test_tests_name_nothing_private_of_the_project_and_replace_none_of_its_parts() -> None:
    most = allowed()
    more = {name: dict(kinds) for name, kinds in uses().items() if not kinds <= most.get(name, Counter())}
    said = [
        f"tests/{name}:{line}: {what}"
        for name in more
        for _, line, what in by_the_back_door((TESTS / name).read_text(encoding="utf-8"))
    ]
    assert more == {}, "\n".join(["reach it by a public name, or make it one:", *said])


if __name__ == "__main__":  # writes the list anew, which only ever makes it shorter
    rows = [f"{kinds['private']:3} {kinds['patch']:3} {name}\n" for name, kinds in uses().items()]
    ALLOWED.write_text("".join(rows), encoding="utf-8")
