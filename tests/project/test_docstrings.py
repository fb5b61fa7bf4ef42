"""What docstrings name in backticks exists: files such as `recipe/encode.py`, and names such as `start.Surface`."""

import ast
import re
import sys
from collections import defaultdict

from project.imports import ROOT, modules

NAMED = re.compile(r"`([A-Za-z_]\w*(?:[./]\w+)+)`")
CODE = ("py", "js", "css")
DATA = ("jpg", "json", "npy", "png", "sfm", "txt")
FOREIGN = {*sys.stdlib_module_names, "onnxruntime", "torch", "pipeline", "utils"}
"""Modules of others, among them those of papers' code."""


def defined(tree: ast.AST) -> set[str]:
    """Every name that code gives to something, attributes among them."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.alias):
            found.add(getattr(node, "asname", None) or node.name)
        elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            found.add(node.id if isinstance(node, ast.Name) else node.attr)
    return found


def test_files_and_names_in_docstrings_exist() -> None:
    files = [f"/{path.relative_to(ROOT)}" for ending in CODE for path in ROOT.glob(f"[a-z]*/**/*.{ending}")]
    trees = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in modules().items()}
    inside = defaultdict[str, set[str]](set)  # of modules, by each end of their dotted names, and of classes
    for module, tree in trees.items():
        parts, names = module.split("."), defined(tree)
        for owner in [*(node.name for node in ast.walk(tree) if isinstance(node, ast.ClassDef)), *parts[-1:]]:
            inside[owner] |= names
        for start in range(len(parts) - 1):
            inside[".".join(parts[start:])] |= names
            inside[".".join(parts[start:-1])].add(parts[-1])

    def exists(name: str) -> bool:
        parts = re.split("[./]", name)
        if parts[0] in FOREIGN or parts[-1] in DATA:
            return True
        if "/" in name or parts[-1] in CODE:
            return parts[-1] not in CODE or any(path.endswith(f"/{name}") for path in files)
        return any(inside[".".join(parts[:end])] >= set(parts[end:]) for end in range(1, len(parts)))

    stale = [
        f"{module}:{node.lineno}: {name}"
        for module, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        for name in NAMED.findall(str(node.value.value))
        if not exists(name)
    ]
    assert stale == []
