"""Test the runtime at both ends of its dependencies' ranges: the oldest and newest versions that pyproject.toml allows.

    python .ci/ranges.py [oldest] [newest]        # both, when none is named; `make test-ranges`

Makes a virtual environment for each end, installs the project with the extras `io` and `fast` and pytest, prints the
versions that it got, and runs the tests that need nothing else. Takes five minutes and the network.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import venv
from pathlib import Path

import tomllib

ROOT = Path(__file__).resolve().parents[1]

TESTS = (
    "tests/e2e/test_cli.py",
    "tests/container/test_table.py",
    "tests/codec/test_hevc.py",
    "tests/system/test_files.py",
    "tests/formats/test_formats.py",
    "tests/formats/test_ply.py",
    "tests/codec/test_recode.py",
    "tests/render/test_extremes.py",
    "tests/render/test_rasteriser.py",
)
"""The whole chain from the command line, the container, libx265 and libavcodec through PyAV, Gaussian files, and both
ways to draw them."""

EXTRAS = ("io", "fast")


def requirements(end: str) -> list[str]:
    """The dependencies of the runtime and of its extras at one end of their ranges, for instance `numpy==1.26.0`."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    listed = [*project["dependencies"], *(r for extra in EXTRAS for r in project["optional-dependencies"][extra])]
    if end == "newest":
        return listed
    return [requirement.split(",")[0].replace(">=", "==") for requirement in listed]


def run(end: str) -> int:
    """Test one end; the status of pytest or pip."""
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=True)
        python = str(Path(folder) / "bin" / "python")
        install = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check"]
        # In one call, so that the project's own ranges and the pins have to agree; old wheels of av need no compiler.
        command = [
            *install,
            "--only-binary",
            ":all:",
            *requirements(end),
            f"{ROOT}[{','.join(EXTRAS)}]",
            "pytest>=8,<10",
            "pytest-timeout",
            "hypothesis",
        ]
        status = subprocess.run(command, check=False).returncode
        if status:
            return status
        names = {requirement.split("==")[0].split(">=")[0] for requirement in requirements(end)}
        shown = subprocess.run([python, "-m", "pip", "freeze"], capture_output=True, text=True, check=True).stdout
        print(f"{end}: " + ", ".join(line for line in shown.splitlines() if line.split("==")[0] in names), flush=True)
        options = ["-q", "-p", "no:cacheprovider", "-W", "default"]  # old versions warn about what newer ones mended
        return subprocess.run([python, "-m", "pytest", *options, *TESTS], cwd=ROOT, check=False).returncode


def main() -> int:
    """Test the ends that are named; the first status that is not 0."""
    ends = sys.argv[1:] or ["oldest", "newest"]
    return max(run(end) for end in ends)


if __name__ == "__main__":
    sys.exit(main())
