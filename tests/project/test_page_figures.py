"""What was measured stands between marks in pages, filled from committed rows; the rest of a page holds definitions."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "ARCHITECTURE.md",
    *(page for page in sorted((ROOT / "docs").glob("*.md")) if page.name != "FORMAT.md"),
]

FIGURE = re.compile(
    r"(?<![\w.])\d[\d,.]*(?: (?:to|and) \d[\d,.]*)?\s?(?:dB|KB|MB|GB|MiB|ms|s|seconds|minutes|%|frames/s)(?![\w/])"
)

DEFINITIONS = {
    "CONVENTIONS.md": {"3 %", "10 %", "15 %"},
    "FAQ.md": {"5 %"},
    "FORMATS.md": {"75 %", "95 %", "45 dB", "15 minutes"},
    "MEASURING.md": {"2 %", "150 dB", "15 minutes", "30 ms"},
    "MODELS.md": {"96 %", "15 MiB", "60 MB", "1.9 GB"},
    "MODES.md": {"2 s", "40 dB", "42 dB"},
    "PLAYER.md": {"200 ms"},
    "WEB.md": {"36 dB"},
}
"""Limits, defaults and conventions: numbers that hold by decision."""


def outside_marks(text: str) -> str:
    text = re.sub(r"<!-- (measured|of) .*?<!-- end -->", "", text, flags=re.DOTALL)
    return re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_measured_figure_is_typed_by_hand(page: Path) -> None:
    found = {match[0] for match in FIGURE.finditer(outside_marks(page.read_text(encoding="utf-8")))}
    assert found - DEFINITIONS.get(page.name, set()) == set()
