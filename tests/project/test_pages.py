"""Pages name files that exist, and their links lead somewhere."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RUNTIME = ROOT / "runtime" / "tinysplat_runtime"
PAGES = [ROOT / name for name in ("README.md", "ARCHITECTURE.md", "SECURITY.md", "CHANGELOG.md")]
PAGES += [ROOT / "docs" / "llms.txt", *sorted((ROOT / "docs").rglob("*.md"))]

PATH = re.compile(r"`((?:[\w.-]+/)*[\w.{},*-]+\.(?:py|js|md|toml))`")
ELSEWHERE = {"three.webgpu.js", "MODEL_ZOO.md", "count.mjs", "container/toy.py", "modes/toy.py"}
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
