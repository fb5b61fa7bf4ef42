"""The page's modules in node."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

from web.node import node

import tinysplat_runtime as ts

PAGE = Path(ts.__file__).parent / "page"


def run(code: str, start: str = "", **given: Any) -> Any:
    """What `code` returns, in a function that may wait; `start` imports what it needs, and `given` are constants."""
    constants = "".join(f"const {name} = {json.dumps(value)};\n" for name, value in given.items())
    text = (
        f"{start}\n{constants}const answer = await (async () => {{ {code} }})();\nconsole.log(JSON.stringify(answer));"
    )
    command = [node(), "--input-type=module", "-e", text]
    done = subprocess.run(command, cwd=PAGE, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
