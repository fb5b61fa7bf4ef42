"""The examples for operators: what they run is there. Neither a container nor a service is started here."""

from __future__ import annotations

import configparser
import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from tinysplat_runtime.cli.parser import build_parser, join_commands

FOLDER = Path(__file__).parents[2] / "examples" / "service"
PROJECT = FOLDER.parents[1] / "pyproject.toml"


def instructions() -> list[list[str]]:
    lines = (FOLDER / "Containerfile").read_text().splitlines()
    return [line.split(maxsplit=1) for line in lines if line and not line.startswith("#")]


def arguments_of(text: str) -> list[str]:
    """What follows the program's name, if our parser takes it."""
    program, *arguments = shlex.split(text)
    assert Path(program).name == "tinysplat"
    parser, commands = build_parser()
    join_commands(commands, arguments)
    parser.parse_args(arguments)
    return arguments


def test_the_container_installs_the_runtime_and_extras_that_there_are() -> None:
    steps = instructions()
    kinds = [kind for kind, _ in steps]
    assert set(kinds) <= {"FROM", "COPY", "RUN", "USER", "WORKDIR", "ENTRYPOINT"}
    last = kinds[len(kinds) - kinds[::-1].index("FROM") :]
    assert last == ["COPY", "RUN", "USER", "WORKDIR", "ENTRYPOINT"]
    assert steps[-len(last)][1] == "--from=build /install /usr/local"  # nothing of the clone and of pip's stays
    project = PROJECT.read_text()
    (extras,) = re.findall(r'"/src\[([\w,]+)\]"', " ".join(text for _, text in steps))
    for extra in extras.split(","):
        (packages,) = re.findall(rf"^{extra} = (\[.*?\])", project, re.M)
        assert "torch" not in packages
    assert f"{json.loads(steps[-1][1])[0]} = " in project
    least = re.search(r'requires-python = ">=3\.(\d+)"', project)
    (minor,) = {int(found) for found in re.findall(r"python:3\.(\d+)-slim", " ".join(text for _, text in steps))}
    assert least is not None and minor >= int(least[1])


def test_the_container_s_example_is_a_command_line_of_ours() -> None:
    text = (FOLDER / "Containerfile").read_text()
    (example,) = re.findall(r"^#.*podman run .* (tinysplat .*)$", text, re.M)
    assert arguments_of(example)[0] == "encode"
    assert '--user "$(id -u):$(id -g)"' in text  # the image's own user may not write to a folder of the caller's


def test_the_unit_s_command_and_writable_folder_are_those_of_a_batch(tmp_path: Path) -> None:
    unit = configparser.ConfigParser(interpolation=None)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    file = FOLDER / "tinysplat-batch.service"
    unit.read(file)
    command = unit["Service"]["ExecStart"]
    words = arguments_of(command)
    assert words[0] == "batch" and words[words.index("-o") + 1] == unit["Service"]["ReadWritePaths"]
    if shutil.which("systemd-analyze"):
        copy = tmp_path / file.name
        here = Path(sys.executable).with_name("tinysplat")
        copy.write_text(file.read_text().replace(command.split()[0], str(here)))
        done = subprocess.run(["systemd-analyze", "verify", copy], capture_output=True, text=True, check=False)
        assert done.returncode == 0 and done.stderr == "", done.stderr
