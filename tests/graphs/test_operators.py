"""The shipped graphs run wherever onnxruntime does: standard operators alone, those that docs/EDGE.md lists."""

import re
from pathlib import Path

import onnx
import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "EDGE.md").read_text("utf-8")
STORED = sorted((ROOT / "models").glob("*.optimised.onnx"))
GRAPHS = sorted({*(ROOT / "models").glob("*.onnx")} - {*STORED})


def listed(title: str) -> set[str]:
    """Operators of a line `- title: A B C`."""
    line = re.search(rf"^- {title}: (.+)$", PAGE, flags=re.MULTILINE)
    assert line, title
    return set(line[1].split())


def operators(graph: onnx.GraphProto) -> set[str]:
    """Operators of a graph and of those inside its nodes, such as a Scan's body."""
    inner = [attribute.g for node in graph.node for attribute in node.attribute if attribute.HasField("g")]
    return {node.op_type for node in graph.node}.union(*map(operators, inner))


@pytest.mark.parametrize("path", GRAPHS, ids=lambda path: path.stem)
def test_graphs_use_the_listed_standard_operators(path: Path) -> None:
    model = onnx.load(path)
    assert [opset.domain for opset in model.opset_import] == [""]
    assert 18 <= model.opset_import[0].version <= 21 and model.ir_version <= 10
    used = operators(model.graph)
    if path.stem == "synthesis":
        assert used == listed("synthesis")
    assert used <= listed("synthesis") | listed("analysis and networks besides")


@pytest.mark.parametrize("path", STORED, ids=lambda path: path.stem)
def test_stored_graphs_use_the_listed_ones_and_two_of_onnxruntimes(path: Path) -> None:
    model = onnx.load(path)
    assert {opset.domain for opset in model.opset_import} == {"", "com.microsoft"} and model.ir_version <= 10
    standard = listed("synthesis") | listed("analysis and networks besides")
    assert operators(model.graph) - standard == listed("stored graphs besides")
