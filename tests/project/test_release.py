"""What a release is called is the same wherever it stands."""

import re
from pathlib import Path

import tinysplat_runtime as ts

ROOT = Path(__file__).resolve().parents[2]


def test_the_changelog_begins_with_this_version_or_what_is_to_become_it() -> None:
    heading = re.search(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert heading and ts.__version__ in heading[1]


def test_what_stability_promises_is_of_this_major_version() -> None:
    text = (ROOT / "docs/STABILITY.md").read_text("utf-8")
    assert f"versions {ts.__version__.partition('.')[0]}.x" in text


def test_every_command_of_the_workflows_is_there() -> None:
    made = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    for workflow in sorted((ROOT / ".github/workflows").glob("*.yml")):
        for line in re.findall(r"run: make (.+)$", workflow.read_text("utf-8"), re.MULTILINE):
            assert set(line.split()) <= made, f"{workflow.name}: make {line}"
