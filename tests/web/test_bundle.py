"""The modules as one text: what a page carries, and what the package ships."""

import subprocess
from pathlib import Path

import pytest
from golden.cases import DATA
from web.node import node

import tinysplat_runtime
from tinysplat_runtime.web import bundled

RUNTIME = Path(tinysplat_runtime.__file__).parent
FOLDER = RUNTIME / "web"


@pytest.mark.parametrize("given", [(), ("page.js", "tinysplat_runtime.page")], ids=["web", "page"])
def test_modules_as_one_text_are_a_module(given: tuple[str, ...], tmp_path: Path) -> None:
    """Which two of one name at the top would not be."""
    (tmp_path / "one.mjs").write_text(bundled(*given))
    done = subprocess.run([node(), "--check", tmp_path / "one.mjs"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("entry", ["bundle", "modules"])
def test_the_bundle_decodes_as_the_modules_do(entry: str, tmp_path: Path) -> None:
    text = bundled()
    assert "import {" not in text
    (tmp_path / "tsplat.js").write_text(text)
    module = tmp_path / "tsplat.js" if entry == "bundle" else FOLDER / "tsplat.js"
    script = tmp_path / "run.mjs"
    script.write_text(
        f"import {{ decode, inspect }} from {module.as_uri()!r};\n"
        "import { readFileSync } from 'node:fs';\n"
        f"const scene = await decode(readFileSync({str(DATA / 'tiny_paper.tsplat')!r}));\n"
        "console.log(scene.means[4].toFixed(5), inspect(readFileSync(process.argv[2])).mode);\n"
    )
    done = subprocess.run(
        [node(), str(script), str(DATA / "list_balanced.tsplat")], capture_output=True, text=True, check=True
    )
    mean, mode = done.stdout.split()
    assert mode == "list"
    gaussians = tinysplat_runtime.decompress((DATA / "tiny_paper.tsplat").read_bytes())
    assert abs(float(mean) - gaussians.flat().means[1, 1]) < 1e-4
