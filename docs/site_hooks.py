"""Hooks of the documentation site: files outside docs/ are named, and the player is at hand."""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "runtime"), str(ROOT)]


def on_page_markdown(markdown: str, page: object, **_: object) -> str:
    """Links that leave docs/ become the names of files of the repository."""
    return re.sub(r"\[([^\]]+)\]\(\.\./[^)]+\)", r"`\1`", markdown)


def on_post_build(config: object, **_: object) -> None:
    """The player, which PLAYER.md links to."""
    from tinysplat_runtime.page.build import player_page

    (Path(config["site_dir"]) / "player.html").write_text(player_page(), "utf-8")  # type: ignore[index]
