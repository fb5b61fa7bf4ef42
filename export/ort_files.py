"""Graphs in onnxruntime's own format, and the operators that a build of it reduced to them needs.

    python export/ort_files.py OUT [--models FOLDER] [--types]
    TINYSPLAT_MODELS=OUT tinysplat decode F.tsplat -o F.npz

OUT gets a .ort file of each graph of models/, a manifest of them, and `required_operators.config` for onnxruntime's
`build.sh --minimal_build --include_ops_by_config`. A network's hash is another there: files of mode `photos`
name the .onnx file.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import logging
import shutil
import sys
import tempfile
from pathlib import Path

import extra  # noqa: F401  (first: names what is missing)
from manifest import MODELS
from onnxruntime.tools.convert_onnx_models_to_ort import OptimizationStyle, convert_onnx_models_to_ort

from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.graphs.artifacts import MANIFEST, load_manifest


def convert(models: Path, out: Path, types: bool) -> dict[str, int]:
    """Write the folder; returns bytes by name.

    Args:
        models: folder of a manifest and its .onnx files.
        out: folder to make.
        types: list the types of each operator, too, for a smaller build.

    Raises:
        InputError: `out` is there.
        ModelError: the models are not what their manifest says.
    """
    if out.exists():
        raise InputError("is there, expected a folder to make", where=str(out))
    entries = {}
    with tempfile.TemporaryDirectory() as folder:
        plain, made = Path(folder, "models"), Path(folder, "ort")
        plain.mkdir()
        for name, artifact in load_manifest(models).items():
            (plain / f"{name}.onnx").write_bytes(artifact.read())
            entries[name] = {**(artifact.entry or {}), "file": f"{name}.ort"}
            entries[name].pop("optimised", None)
        logging.disable(logging.INFO)
        with contextlib.redirect_stdout(io.StringIO()):
            convert_onnx_models_to_ort(plain, made, [OptimizationStyle.Fixed], enable_type_reduction=types)
        for name, entry in entries.items():
            data = (made / f"{name}.ort").read_bytes()
            entry.update(sha256=hashlib.sha256(data).hexdigest(), bytes=len(data))
        (made / MANIFEST).write_text(json.dumps({"artifacts": entries}, indent=2, ensure_ascii=False) + "\n", "utf-8")
        shutil.copytree(made, out)
    return {name: entry["bytes"] for name, entry in entries.items()}


def main() -> None:
    """Convert, and print what each graph takes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder that does not exist yet")
    parser.add_argument("--models", type=Path, default=MODELS, help="folder of a manifest and .onnx files")
    parser.add_argument("--types", action="store_true", help="list operators' types, too (a still smaller build)")
    options = parser.parse_args()
    try:
        sizes = convert(options.models, options.out, options.types)
    except TinySplatError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    print(json.dumps(sizes))


if __name__ == "__main__":
    main()
