"""The names of `import tinysplat_runtime as ts`, in whatever order they are first used."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

RUNTIME = Path(__file__).resolve().parents[2] / "runtime"


@pytest.mark.parametrize(
    "first", ["ts.compress", "ts.predict", "ts.Runtime", "ts.render", "from tinysplat_runtime.render import Renderer"]
)
def test_render_is_the_function_whatever_was_used_first(first):
    code = f"import tinysplat_runtime as ts; {first}; assert callable(ts.render), ts.render"
    subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ, "PYTHONPATH": str(RUNTIME)})
