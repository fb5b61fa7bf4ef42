"""The example notebook's code runs, and its stored outputs are those of its own cells."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_the_example_notebook_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = json.loads((EXAMPLES / "notebook.ipynb").read_text())
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] for cell in cells)
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.delitem(sys.modules, "demo", raising=False)
    names: dict[str, Any] = {}
    for cell in cells:
        exec("".join(cell["source"]), names)
    shown = "".join("".join(cell["outputs"][0]["data"].get("text/html", "")) for cell in cells)
    assert "data:image/" in shown
