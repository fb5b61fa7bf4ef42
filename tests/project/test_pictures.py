"""Pictures of the pages have a command that makes them, and show what there is today."""

from pathlib import Path

from checks.pictures import PICTURES, digest, older

ROOT = Path(__file__).resolve().parents[2]
KINDS = {".png", ".jpg", ".webp"}


def test_every_picture_of_the_pages_has_a_command_and_a_page() -> None:
    pictures = {path for path in (ROOT / "docs").rglob("*") if path.suffix in KINDS and "assets" not in path.parts}
    assert pictures | set((ROOT / "docs/pages").glob("*.html")) == {ROOT / name for name in PICTURES}
    pages = "".join(page.read_text("utf-8") for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
    assert [name for name in PICTURES if f"{Path(name).name})" not in pages] == []
    programs = {word for picture in PICTURES.values() for word in picture.command.split() if word.endswith(".py")}
    assert [name for name in sorted(programs) if not (ROOT / name).is_file()] == []


def test_what_pictures_show_is_there_and_seen_to_change(tmp_path: Path) -> None:
    for name, picture in PICTURES.items():
        assert all(list(ROOT.glob(pattern)) for pattern in picture.shows), name
    (tmp_path / "rows.jsonl").write_text("1")
    before = digest(tmp_path, ["*.jsonl"])
    (tmp_path / "rows.jsonl").write_text("2")
    assert digest(tmp_path, ["*.jsonl"]) != before


def test_no_picture_is_older_than_what_it_shows() -> None:
    assert older() == [], "`python checks/pictures.py` prints the command of each"
