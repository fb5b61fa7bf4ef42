"""Commands that write models/, run in a checkout: `python -m export.network edge`. A missing package is one line."""

import sys
from importlib.util import find_spec

for _package in ("onnx", "onnxscript", "torch"):
    if find_spec(_package) is None:
        print(f'export: needs the package {_package}; pip install "tinysplat[export]" brings it', file=sys.stderr)
        raise SystemExit(2)
