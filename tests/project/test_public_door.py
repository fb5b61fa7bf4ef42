"""The names of `import tinysplat_runtime as ts`, in whatever order they are first used."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

RUNTIME = Path(__file__).resolve().parents[2] / "runtime"


@pytest.mark.parametrize("first", ["compress", "predict", "Runtime", "render"])
def test_render_is_the_function_whatever_was_used_first(first):
    code = f"import tinysplat_runtime as ts; ts.{first}; assert callable(ts.render), ts.render"
    subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ, "PYTHONPATH": str(RUNTIME)})


def test_render_stays_the_function_when_its_subpackage_is_imported_first():
    code = "from tinysplat_runtime.render import Renderer; import tinysplat_runtime as ts; assert callable(ts.render)"
    subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ, "PYTHONPATH": str(RUNTIME)})
