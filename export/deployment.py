"""What a small device needs, in one folder or .zip: the runtime, its models, numpy, onnxruntime and av, nothing else.

    python export/deployment.py OUT[.zip]                        # for machines like this one, from this environment
    python export/deployment.py OUT[.zip] --wheels DIR           # for another, from the wheels of its three packages

Prints what each part takes. On the device, which needs Python of the same version and no pip: `OUT/tinysplat decode …`.
Left out of the packages is what only their developers use; their licences stay. Wheels for an aarch64 device:

    pip download --no-deps --only-binary=:all: --platform manylinux_2_28_aarch64 --python-version 3.11 -d DIR \\
        numpy onnxruntime "av<19"
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path, PurePosixPath

import tinysplat_runtime
from tinysplat_runtime.graphs.artifacts import MANIFEST, models_dir

PACKAGES = ("numpy", "onnxruntime", "av")

DEVELOPERS_FOLDERS = {"__pycache__", "tests", "include", "_pyinstaller"}
DEVELOPERS_PARTS = ("onnxruntime/transformers/", "onnxruntime/quantization/", "onnxruntime/tools/", "numpy/f2py/")
DEVELOPERS_SUFFIXES = {".pyi", ".pyx", ".pxd", ".h", ".c", ".cpp", ".a", ".lib"}
"""What nothing at run time reads."""

_LAUNCHER = """#!/bin/sh
# Runs on this folder alone: neither PYTHONPATH, nor installed packages, nor the current folder.
here=$(dirname "$(readlink -f "$0")")
exec "${{PYTHON:-python{version}}}" -I -S -c \\
    'import sys; sys.path.insert(0, sys.argv.pop(1)); from tinysplat_runtime.cli import main; sys.exit(main())' \\
    "$here/lib" "$@"
"""

Entry = tuple[str, Callable[[Path], object]]
"""Name of a file under lib/, and what writes it to a path."""


def is_needed(name: str) -> bool:
    """Whether a file of a package is more than its developers need."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts:
        return False  # scripts beside the packages
    if any(part.endswith(".dist-info") for part in path.parts):
        return True  # versions and licences
    developers = DEVELOPERS_FOLDERS & set(path.parts) or path.suffix in DEVELOPERS_SUFFIXES
    return not developers and not name.startswith(DEVELOPERS_PARTS)


def installed_files(package: str) -> Iterator[Entry]:
    """Files of a package of this environment."""
    for file in importlib.metadata.distribution(package).files or ():
        source = Path(str(file.locate()))
        if is_needed(str(file)) and source.is_file():
            yield str(file), lambda target, source=source: shutil.copy(source, target)


def wheel_files(wheel: Path) -> Iterator[Entry]:
    """Files of a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        for name in archive.namelist():
            if is_needed(name) and not name.endswith("/"):
                yield name, lambda target, name=name: target.write_bytes(archive.read(name))


def own_files() -> Iterator[Entry]:
    """The runtime and its models, without copies that only save time and stages, which only captures go through."""
    manifest = json.loads((models_dir() / MANIFEST).read_text())
    stages = {name: entry for name, entry in manifest["artifacts"].items() if entry["role"] == "stage"}
    left_out = {entry["file"] for entry in stages.values()}
    for package, folder, patterns in (
        ("tinysplat_runtime", Path(str(tinysplat_runtime.__file__)).parent, ("*.py", "page.html", "*.css", "*.js")),
        ("tinysplat_models", models_dir(), ("__init__.py", "*.onnx", "*.ort")),
    ):
        for pattern in patterns:
            for source in folder.rglob(pattern):
                if source.name.endswith(".optimised.onnx") or source.name in left_out:
                    continue
                name = f"{package}/{source.relative_to(folder).as_posix()}"
                yield name, lambda target, source=source: shutil.copy(source, target)
    manifest["artifacts"] = {name: entry for name, entry in manifest["artifacts"].items() if name not in stages}
    yield f"tinysplat_models/{MANIFEST}", lambda target: target.write_text(json.dumps(manifest, indent=2))


def fill(folder: Path, entries: Iterable[Entry]) -> int:
    """Write files into a folder; returns their bytes."""
    total = 0
    for name, write in entries:
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        write(target)
        total += target.stat().st_size
    return total


def build(folder: Path, wheels: Path | None) -> dict[str, int]:
    """Make the folder; returns the bytes of its parts.

    Raises:
        FileNotFoundError: `wheels` lacks one of the packages.
        FileExistsError: the folder is there.
    """
    lib = folder / "lib"
    lib.mkdir(parents=True)
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    parts = {}
    for package in PACKAGES:
        if wheels is None:
            parts[package] = fill(lib, installed_files(package))
            continue
        built = sorted(wheels.glob(f"{package}-*.whl"))
        if not built:
            raise FileNotFoundError(f"no {package}-*.whl in {wheels}")
        parts[package] = fill(lib, wheel_files(built[-1]))
        tag = built[-1].stem.split("-")[2]  # cp311, or for stable ABIs the oldest version that will do
        version = f"{tag[2]}.{tag[3:]}" if package == "numpy" else version
    parts["runtime and models"] = fill(lib, own_files())
    launcher = folder / "tinysplat"
    launcher.write_text(_LAUNCHER.format(version=version))
    launcher.chmod(0o755)
    return parts


def main(arguments: list[str] | None = None) -> int:
    """Build and print what the parts take; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder that does not exist yet, or a name that ends in .zip")
    parser.add_argument("--wheels", type=Path, help="folder of wheels for the device")
    args = parser.parse_args(arguments)
    is_zip = args.out.suffix == ".zip"
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "tinysplat" if is_zip else args.out
        try:
            parts = build(folder, args.wheels)
        except (FileNotFoundError, FileExistsError) as error:
            print(f"deployment: {error}", file=sys.stderr)
            return 2
        if is_zip:
            shutil.make_archive(str(args.out.with_suffix("")), "zip", scratch, "tinysplat")
    for part, size in (*parts.items(), ("together", sum(parts.values()))):
        print(f"{part:20} {size / 1e6:7.1f} MB")
    if is_zip:
        print(f"{args.out.name:20} {args.out.stat().st_size / 1e6:7.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
