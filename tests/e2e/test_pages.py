"""What README and tutorial tell newcomers to type runs as pasted, from the root of a clone, in order of the page."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tinysplat_runtime.cli.parser import build_parser, join_commands

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("README.md", "docs/TUTORIAL.md")
INSTALLS = ("pip", "make")
"""Words that set up what the tests run in."""


def blocks(page: str, *kinds: str) -> list[tuple[str, str]]:
    """Kind and text of a page's blocks."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return [(kind, block) for kind, block in re.findall(r"```(\w+)\n(.*?)```", text, re.DOTALL) if kind in kinds]


def command_lines(block: str) -> list[list[str]]:
    return [words for line in block.splitlines() if (words := shlex.split(line, comments=True))]


@pytest.mark.parametrize("page", PAGES)
def test_every_command_line_is_one_of_ours(page: str) -> None:
    """Those for a reader's own files, too, in blocks called sh."""
    for _, block in blocks(page, "bash", "sh"):
        for words in command_lines(block):
            if words[0] == "tinysplat":
                parser, commands = build_parser()
                join_commands(commands, words[1:])
                parser.parse_args(words[1:])
            else:
                assert words[0] in (*INSTALLS, "python") and (words[0] != "python" or (ROOT / words[1]).is_file())


def run(words: list[str], folder: Path) -> None:
    here = Path(sys.executable).parent
    program = [sys.executable] if words[0] == "python" else [str(here / words[0])]
    arguments = [*program, *words[1:]]
    env = {**os.environ, "BROWSER": "true"}
    if words[:2] == ["tinysplat", "view"] and not {"--html", "--player"} & set(words):
        with subprocess.Popen(
            [*arguments, "--no-browser"], cwd=folder, env=env, stdout=subprocess.PIPE, text=True
        ) as page:
            assert page.stdout is not None and "http://127.0.0.1:" in page.stdout.readline()
            page.terminate()
        return
    done = subprocess.run(arguments, cwd=folder, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (words, done.stderr)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("page", PAGES)
def test_every_block_runs_as_pasted(page: str, tmp_path: Path) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for kind, block in blocks(page, "bash", "python"):
        if kind == "python":
            run(["python", "-c", block], tmp_path)
            continue
        for words in command_lines(block):
            if words[0] not in INSTALLS:
                run(words, tmp_path)
