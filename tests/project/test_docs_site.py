"""The documentation site's sources: the menu and the guides lead somewhere, the references are complete."""

import re
import runpy
from pathlib import Path

import pytest

import tinysplat_runtime as ts
from tinysplat_runtime.cli.parser import build_parser

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def test_every_entry_of_the_menu_is_a_page() -> None:
    listed = re.findall(r": (\w+\.md)$", (ROOT / "mkdocs.yml").read_text(), flags=re.MULTILINE)
    assert listed and all((DOCS / name).exists() for name in listed)


@pytest.mark.parametrize("page", ["CLI.md", "API.md"])
def test_references_are_as_the_code_has_it(page: str) -> None:
    """Else `make reference`."""
    text = (DOCS / page).read_text("utf-8")
    assert runpy.run_path(str(DOCS / "reference.py"))["filled"](text) == text


def test_the_references_have_every_command_and_every_public_name() -> None:
    _, commands = build_parser()
    text = (DOCS / "CLI.md").read_text("utf-8") + (DOCS / "API.md").read_text("utf-8")
    headings = re.findall(r"^##+ `?(\w+)`?$", text, re.MULTILINE)
    assert {*commands.choices, *ts.__all__} - set(headings) == set()
