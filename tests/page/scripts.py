"""The page's modules in one node process, which evaluates script after script."""

import atexit
import json
import re
import subprocess
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from web.node import node

import tinysplat_runtime as ts

PAGE = Path(ts.__file__).parent / "page"

SERVER = """
import { createInterface } from "node:readline";
for await (const line of createInterface({ input: process.stdin })) {
  let said;
  try {
    said = { answer: await (await import(`data:text/javascript,${encodeURIComponent(JSON.parse(line))}`)).default };
  } catch (error) {
    said = { error: error.stack ?? String(error) };
  }
  console.log(JSON.stringify(said));
}
"""


@lru_cache(maxsize=1)
def _process() -> subprocess.Popen[str]:
    command = [node(), "--input-type=module", "-e", SERVER]
    started = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    atexit.register(started.kill)  # a script may never end
    return started


def ask(script: str) -> Any:
    """What a module exports by default, once that is there."""
    process = _process()
    assert process.stdin and process.stdout
    process.stdin.write(json.dumps(script) + "\n")
    process.stdin.flush()
    said = json.loads(process.stdout.readline())
    assert "error" not in said, said["error"]
    return said.get("answer")


def run(code: str, start: str = "", **given: Any) -> Any:
    """What `code` returns, in a function that may wait; `start` imports what it needs, and `given` are constants."""
    start = re.sub(r'from "\./', f'from "{PAGE.as_uri()}/', start)
    constants = "".join(f"const {name} = {json.dumps(value)};\n" for name, value in given.items())
    return ask(f"{start}\n{constants}export default await (async () => {{ {code} }})();")


def close(found: Any, wanted: Any, atol: float = 1e-9) -> None:
    """Fail where numbers differ by more than rounding."""
    np.testing.assert_allclose(np.array(found, float), np.array(wanted, float), rtol=1e-9, atol=atol)
