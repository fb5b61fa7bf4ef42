"""What ships for JavaScript: the package's description, its files, and the first example of docs/WEB.md."""

import json
import re
import subprocess
from pathlib import Path

from golden.cases import DATA
from page.scripts import run
from web.node import node

import tinysplat_runtime as ts

WEB = Path(ts.__file__).parent / "web"
ROOT = Path(__file__).resolve().parents[2]


def test_the_package_names_files_that_there_are() -> None:
    package = json.loads((WEB / "package.json").read_text())
    assert package["version"] == ts.__version__
    assert package["license"] == "Apache-2.0"
    exports = [entry if isinstance(entry, str) else entry["default"] for entry in package["exports"].values()]
    assert all((WEB / path).is_file() for path in [*exports, package["types"]])
    for path in WEB.rglob("*.*js"):
        for imported in re.findall(r'^} from "(\..*)";|^import .* from "(\..*)";', path.read_text(), re.MULTILINE):
            assert (path.parent / "".join(imported)).is_file()


def test_the_example_for_node_runs_as_pasted(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "WEB.md").read_text()
    found = re.search(r"cat > count\.mjs <<'END'\n(.*?)\nEND\n", text, re.DOTALL)
    assert found
    (tmp_path / "count.mjs").write_text(found[1])
    (tmp_path / "scene.tsplat").write_bytes((DATA / "degree1_balanced.tsplat").read_bytes())
    (tmp_path / "node_modules").mkdir()
    (tmp_path / "node_modules" / "tsplat").symlink_to(WEB)  # as npm installs a folder
    done = subprocess.run([node(), "count.mjs"], cwd=tmp_path, capture_output=True, text=True, check=True)
    gaussians = ts.load_gaussians(DATA / "degree1_balanced.tsplat")
    assert str(gaussians.count) in done.stdout and str(len(gaussians.cameras)) in done.stdout


def test_the_types_declare_what_is_exported() -> None:
    declared = set(re.findall(r"^export (?:function|class) (\w+)", (WEB / "tsplat.d.ts").read_text(), re.MULTILINE))
    assert declared == set(run("return Object.keys(own);", f'import * as own from "{(WEB / "tsplat.js").as_uri()}";'))
