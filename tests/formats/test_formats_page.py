"""docs/FORMATS.md's table is that of the code, row by row."""

from pathlib import Path

from scenes import refusing

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import FORMATS, endings, find_format

PAGE = Path(__file__).resolve().parents[2] / "docs" / "FORMATS.md"


def test_the_page_has_the_rows_of_the_table() -> None:
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in PAGE.read_text(encoding="utf-8").split("| format | endings |")[1].split("\n\n")[0].splitlines()[2:]
    ]
    expected = [
        [
            form.name if form.write else f"{form.name} (read only)",
            ", ".join(f"`{ending}`" for ending in form.endings),
            form.keeps,
            f"`{form.extra}`" if form.extra else "–",
            form.checked,
        ]
        for form in FORMATS
    ]
    assert rows == expected


def test_the_longest_ending_tells_the_format() -> None:
    assert find_format("a.compressed.ply", written=True).name == "compressed PLY"
    assert find_format("A.PLY", written=True).name == "PLY (3DGS)"
    assert find_format("folder/meta.json", written=False).name == "SOG"
    assert ".splat" in endings(written=False) and ".splat" not in endings(written=True)
    with refusing(InputError, "'.splat' .npz"):
        find_format("a.splat", written=True)
