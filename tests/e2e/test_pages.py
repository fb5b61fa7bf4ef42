"""What pages tell people to type runs as pasted: README in a fresh folder, every other page where README has run.

Blocks called bash and python run, and lines of text behind `$`; sh and py are for a reader's own files.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tinysplat_runtime.cli.parser import build_parser, join_commands

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("README.md", *sorted(f"docs/{page.name}" for page in (ROOT / "docs").glob("*.md")))
INSTALLS = ("pip", "make")
"""Words that set up what the tests run in."""


def blocks(page: str, *kinds: str) -> list[tuple[str, str]]:
    """Kind and text of a page's blocks."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return [(kind, block) for kind, block in re.findall(r"```(\w+)\n(.*?)```", text, re.DOTALL) if kind in kinds]


def command_lines(block: str) -> list[list[str]]:
    return [words for line in block.replace("\\\n", "").splitlines() if (words := shlex.split(line, comments=True))]


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
                is_script = words[0] == "python" and not words[1].startswith("-")
                assert not is_script or (ROOT / words[1]).is_file()


def run(words: list[str], folder: Path) -> None:
    env = {**os.environ, "BROWSER": "true", "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    if words[:2] == ["tinysplat", "view"] and not {"--html", "--player"} & set(words):
        serving = [*words, "--no-browser"]
        with subprocess.Popen(serving, cwd=folder, env=env, stdout=subprocess.PIPE, text=True) as page:
            assert page.stdout is not None and "http://127.0.0.1:" in page.stdout.readline()
            page.terminate()
        return
    done = subprocess.run(words, cwd=folder, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (words, done.stderr)


def run_page(page: str, folder: Path) -> None:
    """Its commands, its Python, and after `$` what it shows the output of."""
    for kind, block in blocks(page, "bash", "python", "text"):
        if kind == "python":
            run([sys.executable, "-c", block], folder)
        elif kind == "text":
            for line in re.findall(r"^\$ (.*)$", block, re.MULTILINE):
                run(["bash", "-c", line], folder)
        else:
            for words in command_lines(block):
                if words[0] not in INSTALLS:
                    run(words, folder)


@pytest.fixture(scope="module")
def after_readme(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("readme")
    (folder / "examples").symlink_to(ROOT / "examples")
    run_page("README.md", folder)
    return folder


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    "page", [page for page in PAGES[1:] if blocks(page, "bash", "python") or "\n$ " in (ROOT / page).read_text("utf-8")]
)
def test_every_block_runs_as_pasted(page: str, after_readme: Path, tmp_path: Path) -> None:
    shutil.copytree(after_readme, tmp_path, symlinks=True, dirs_exist_ok=True)
    run_page(page, tmp_path)
