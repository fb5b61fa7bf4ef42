"""The modules as one text: what a page carries, and what the package ships."""

from __future__ import annotations

import re
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from golden.cases import DATA
from web.node import node

import tinysplat_runtime
from tinysplat_runtime.web import bundled

RUNTIME = Path(tinysplat_runtime.__file__).parent
FOLDER = RUNTIME / "web"


@pytest.mark.parametrize(("folder", "apart"), [("web", "adapters"), ("page", "start.js")])
def test_names_at_the_top_of_modules_are_unique(folder: str, apart: str) -> None:
    names = r"^(?:export )?(?:async )?(?:function\*?|class) (\w+)|^(?:export )?(?:const|let) (?:.*, )?(\w+) ="
    pattern = re.compile(names, re.MULTILINE)
    texts = [path.read_text("utf-8") for path in (RUNTIME / folder).rglob("*.js") if apart not in path.parts]
    found = Counter(first or other for text in texts for first, other in pattern.findall(text))
    assert found and [name for name, count in found.items() if count > 1] == []


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
        [node(), str(script), str(DATA / "free_balanced.tsplat")], capture_output=True, text=True, check=True
    )
    mean, mode = done.stdout.split()
    assert mode == "free"
    gaussians = tinysplat_runtime.decompress((DATA / "tiny_paper.tsplat").read_bytes())
    assert abs(float(mean) - gaussians.flat().means[1, 1]) < 1e-4
