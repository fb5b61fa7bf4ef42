"""Tables as text."""

from __future__ import annotations

from tinysplat.measure.show.tables import format_table, within


def test_wide_tables_go_on_below_with_their_first_column() -> None:
    header = ["scene", *(f"figure {i}" for i in range(9))]
    rows = [["desk", *"012345678"], ["room", *"abcdefghi"]]
    table = format_table(header, rows)
    text = within(f"Title\n{table}\n\nmore", 40)
    assert max(map(len, text.splitlines())) <= 40
    assert text.startswith("Title\n| scene") and text.endswith("more")
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if "|" in line]
    assert all(line[0] in ("scene", "desk", "room") or set(line[0]) <= set("-:") for line in cells)
    assert [cell for line in cells if line[0] == "room" for cell in line[1:]] == [*"abcdefghi"]
    assert within(table, 200) == table
