"""The documentation site's sources: the menu and the guides lead somewhere, the references are complete."""

from __future__ import annotations

import pkgutil
import re
import runpy
from pathlib import Path

import tinysplat_runtime as ts
from tinysplat_runtime import errors
from tinysplat_runtime.cli.parser import build_parser

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def test_every_entry_of_the_menu_is_a_page() -> None:
    listed = re.findall(r": (\w+\.md)$", (ROOT / "mkdocs.yml").read_text(), flags=re.MULTILINE)
    assert listed and all((DOCS / name).exists() for name in listed)


def test_the_reference_has_every_command_and_option() -> None:
    hooks = runpy.run_path(str(DOCS / "site_hooks.py"))
    text = hooks["on_page_markdown"]((DOCS / "CLI.md").read_text(), page=None)
    _, commands = build_parser()
    for name, parser in commands.choices.items():
        assert f"## {name}\n" in text
        for action in parser.format_help().split():
            assert not action.startswith("--") or action.strip(",]") in text


def test_the_python_reference_has_every_public_name_and_none_that_there_is_not() -> None:
    names = re.findall(r"^::: ([\w.]+)$", (DOCS / "API.md").read_text(), flags=re.MULTILINE)
    shown = {name.rpartition(".")[2] for name in names if pkgutil.resolve_name(name)}
    assert set(ts.__all__) - shown - set(vars(errors)) == set()
