"""The import graph of the project's own modules, read off the code, and its circles.

Every import counts: inside functions, and for types alone. A circle is a set of modules that all reach each other.
"""

import ast
from collections.abc import Iterable, Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = {
    "tinysplat_runtime": ROOT / "runtime" / "tinysplat_runtime",
    "tinysplat": ROOT / "tinysplat",
    "export": ROOT / "export",
}

Graph = Mapping[str, frozenset[str]]
"""Module to the modules it imports."""


def modules(packages: Mapping[str, Path] = PACKAGES) -> dict[str, Path]:
    """Every module of the packages by its dotted name."""
    found = {}
    for package, folder in packages.items():
        for path in sorted(folder.rglob("*.py")):
            parts = [package, *path.relative_to(folder).with_suffix("").parts]
            found[".".join(parts).removesuffix(".__init__")] = path
    return found


def import_graph(files: Mapping[str, Path]) -> dict[str, frozenset[str]]:
    """What each module imports of the others; a package stands for its `__init__`."""
    return {name: frozenset(_imported(name, path, files)) - {name} for name, path in files.items()}


def _imported(name: str, path: Path, files: Mapping[str, Path]) -> Iterable[str]:
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in files)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*above, *((node.module or "").split(".") if node.module else [])])
            for alias in node.names:
                whole = f"{base}.{alias.name}"
                if whole in files:
                    yield whole
                elif base in files:
                    yield base


def circles(graph: Graph) -> list[list[str]]:
    """Sets of two and more modules that all reach each other, by name."""
    reached = {module: _reached(module, graph) for module in graph}
    together = {frozenset(other for other in reached[one] if one in reached[other]) for one in graph}
    return sorted(sorted(circle) for circle in together if len(circle) > 1)


def _reached(module: str, graph: Graph) -> set[str]:
    found, left = set[str](), [module]
    while left:
        new = graph[left.pop()] - found
        found |= new
        left += new
    return found
