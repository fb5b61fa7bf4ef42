"""Docstrings state what arrays hold and where formulas are from; pages name files, tests and terms that exist."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RUNTIME = ROOT / "runtime" / "tinysplat_runtime"
PAGES = [ROOT / name for name in ("README.md", "ARCHITECTURE.md", "SECURITY.md", "CHANGELOG.md")]
PAGES += sorted((ROOT / "docs").glob("*.md")) + sorted((ROOT / "docs" / "lab").glob("*.md"))

ARRAYS = re.compile(r"\b(?:NDArray|Tensor)\b")
_INNER = r"(?:[^()]|\([^()]*\))*"
SHAPE = re.compile(rf"\({_INNER}[\w…]{_INNER}[,…]{_INNER}\)|\(\w+\)|\bshapes?\b|\bscalar\b")
DTYPE = re.compile(r"float|u?int(?:\d+|p)?\b|bool|dtype|integer|object")
REFERENCE = re.compile(r"\b(?:[Aa]s(?: for)?|[Ss]ee|those of) `")
"""Docstrings that leave shapes and dtypes to another one, which they name."""


def public_functions(path: Path) -> Iterator[tuple[str, ast.FunctionDef]]:
    def walk(body: list[ast.stmt], prefix: str) -> Iterator[tuple[str, ast.FunctionDef]]:
        for node in body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                yield from walk(node.body, f"{prefix}{node.name}.")
            elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                yield f"{prefix}{node.name}", node

    yield from walk(ast.parse(path.read_text(encoding="utf-8")).body, f"{path.relative_to(ROOT)}: ")


def annotations_of(function: ast.FunctionDef) -> str:
    arguments = function.args
    every = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    found = [ast.unparse(argument.annotation) for argument in every if argument.annotation]
    return " ".join(found + ([ast.unparse(function.returns)] if function.returns else []))


@pytest.mark.parametrize("folder", [RUNTIME, ROOT / "tinysplat"], ids=lambda folder: folder.name)
def test_public_functions_state_shape_and_dtype_of_their_arrays(folder: Path) -> None:
    """Tensors need no dtype: they are float32, or the docstring says otherwise."""
    checked, silent = 0, []
    for path in sorted(folder.rglob("*.py")):
        for name, function in public_functions(path):
            types, text = annotations_of(function), ast.get_docstring(function) or ""
            if not ARRAYS.search(types):
                continue
            checked += 1
            if not REFERENCE.search(text):
                missing = "" if SHAPE.search(text) else "shape "
                missing += "dtype" if "NDArray" in types and not DTYPE.search(text) else ""
                silent += [f"{name}: {missing}"] if missing else []
    assert checked > 150
    assert silent == []


def test_formulas_of_the_paper_name_it() -> None:
    """Every function that the map from the paper names says where its formula is from."""
    rows = [line for line in (ROOT / "docs" / "PAPER_MAP.md").read_text("utf-8").splitlines() if "VPT" in line]
    rows += [line for line in (ROOT / "docs" / "PAPER_MAP.md").read_text("utf-8").splitlines() if "VABR" in line]
    wanted = {name for row in rows if row.startswith("|") for name in re.findall(r"`(\w+)`", row)}
    sources = [*RUNTIME.glob("*/*.py"), ROOT / "tinysplat/transforms.py", ROOT / "tinysplat/reference/transforms.py"]
    found = {}
    for path in sources:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name in wanted:
                found[f"{path.name}: {node.name}"] = "2506.09479" in (ast.get_docstring(node) or "")
    assert len(found) > 15
    assert [name for name, cited in found.items() if not cited] == []


PATH = re.compile(r"`((?:[\w.-]+/)*[\w.{},*-]+\.(?:py|js|md|toml))`")
ELSEWHERE = {"three.webgpu.js", "MODEL_ZOO.md", "count.mjs", "container/toy.py", "codec/modes/toy.py"}
"""Files of other projects, and of examples."""


def exists(name: str) -> bool:
    """As a page names it: from the root, a room of the runtime, tinysplat, or by a test's own name."""
    head, brace, options = name.partition("{")
    choices, _, tail = options.partition("}")
    patterns = [f"{head}{choice}{tail}" for choice in choices.split(",")] if brace else [name]
    bases = (ROOT, RUNTIME, ROOT / "tinysplat", ROOT / "docs")
    return all(
        any(list(base.glob(pattern)) for base in bases) or ("/" not in pattern and list(ROOT.glob(f"*/**/{pattern}")))
        for pattern in patterns
    )


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages_name_files_that_exist(page: Path) -> None:
    named = set(PATH.findall(page.read_text("utf-8"))) - ELSEWHERE
    assert sorted(name for name in named if not exists(name)) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_pages_that_exist(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.DOTALL)
    links = {link for link in re.findall(r"\]\(([^)#\s]+)", text) if "://" not in link}
    assert sorted(link for link in links if not (page.parent / link).exists()) == []
