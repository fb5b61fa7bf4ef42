"""Hooks of the documentation site: the command-line reference comes from the parsers, files outside docs/ are named."""

from __future__ import annotations

import argparse
import io
import re
import sys
from contextlib import redirect_stdout
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "runtime"), str(ROOT)]

COMMANDS = "<!-- commands -->"


def on_page_markdown(markdown: str, page: object, **_: object) -> str:
    """Fill in the reference; links that leave docs/ become the names of files of the repository."""
    markdown = re.sub(r"\[([^\]]+)\]\(\.\./[^)]+\)", r"`\1`", markdown)
    return markdown.replace(COMMANDS, _reference()) if COMMANDS in markdown else markdown


def on_post_build(config: object, **_: object) -> None:
    """The player, which PLAYER.md links to."""
    from tinysplat_runtime.page.build import player_page

    (Path(config["site_dir"]) / "player.html").write_text(player_page(), "utf-8")  # type: ignore[index]


def _reference() -> str:
    from tinysplat_runtime.cli.parser import build_parser, join_commands

    parser, commands = build_parser()
    join_commands(commands, ["--help"])  # those of other packages too
    helps = {action.dest: action.help for action in commands._choices_actions}
    parts = [f"```text\n{_help(parser)}```"]
    for name, command in sorted(commands.choices.items()):
        parts.append(f"## {name}\n\n{helps.get(name, '')}\n\n```text\n{_help(command)}```")
    return "\n\n".join(parts)


def _help(parser: argparse.ArgumentParser) -> str:
    out = io.StringIO()
    with redirect_stdout(out):
        parser.print_help()
    return out.getvalue()
