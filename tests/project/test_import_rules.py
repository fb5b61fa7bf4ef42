"""Which way imports point: export → tinysplat → tinysplat_runtime, and the runtime needs numpy, onnxruntime and av."""

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest
from project import imports as imports_of_project

ROOT = Path(__file__).parents[2]
RUNTIME = ROOT / "runtime" / "tinysplat_runtime"

ALLOWED_IN_RUNTIME = {*sys.stdlib_module_names, "numpy", "onnxruntime", "av", "tinysplat_runtime"}

EXTRAS = {"safetensors", "plyfile", "zstandard", "PIL", "pillow_heif", "pxr", "pycolmap", "fsspec", "scipy"}
"""Packages that an extra brings, or which happen to be installed: functions alone may import them."""


def sources(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*.py") if "__pycache__" not in path.parts)


def imports(path: Path) -> Iterator[tuple[str, int, bool]]:
    """(top-level package, line, whether inside a function) of every absolute import of a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inside = {
        id(node)
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
        for node in ast.walk(function)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [node.module or ""]
        else:
            continue
        for name in names:
            yield name.partition(".")[0], node.lineno, id(node) in inside


def test_runtime_imports_only_what_ships_to_the_edge() -> None:
    files = sources(RUNTIME)
    assert files
    breaks = []
    for path in files:
        own = (
            {"numba", "llvmlite"} if path.name.startswith("kernels_") else set[str]()
        )  # modules that are loaded where it is
        for package, line, is_inside in imports(path):
            if package not in ALLOWED_IN_RUNTIME | own and not (is_inside and package in EXTRAS):
                breaks.append(f"{path.relative_to(ROOT)}:{line} imports {package}")
    assert breaks == []


def test_runtime_imports_nothing_by_name_at_run_time() -> None:
    """`importlib` and `__import__` pass by the list above: the public door, the command line, the codec's modes
    and formats load their own so, and `--provider` onnxruntime's plug-in packages, of which the user has what the
    machine has."""
    names = {
        path.relative_to(RUNTIME).as_posix(): {
            getattr(node, "attr", getattr(node, "id", None))
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Attribute | ast.Name)
        }
        for path in sources(RUNTIME)
    }
    assert {path for path, used in names.items() if used & {"import_module", "__import__"}} <= {
        "__init__.py",
        "cli/run.py",
        "modes/mode.py",
        "formats/table.py",
        "graphs/providers.py",
    }


@pytest.mark.parametrize(
    ("folder", "banned"), [("tinysplat", {"export"}), ("runtime", {"export", "tinysplat", "torch"})]
)
def test_imports_never_point_back(folder: str, banned: set[str]) -> None:
    files = sources(ROOT / folder)
    assert files
    assert [f"{path}:{line}" for path in files for package, line, _ in imports(path) if package in banned] == []


BLOCKED = (
    "torch", "onnx", "tinysplat", "export", "onnxscript", "safetensors", "plyfile", "zstandard", "pycolmap",
    "PIL", "skimage",
)  # fmt: skip

IMPORT_ALL = f"""
import importlib, pkgutil, sys
sys.modules.update(dict.fromkeys({BLOCKED!r}))
import tinysplat_runtime
assert not {{"av", "numpy", "onnxruntime"}} & set(sys.modules), "importing the package must load no library"
names = [m.name for m in pkgutil.walk_packages(tinysplat_runtime.__path__, "tinysplat_runtime.")]
for name in names:
    if not name.endswith("__main__"):
        importlib.import_module(name)
for name in tinysplat_runtime.__all__:
    getattr(tinysplat_runtime, name)
print(len(names))
"""


def test_every_runtime_module_loads_without_torch_onnx_and_extras() -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "runtime")}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", IMPORT_ALL], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout)


NOTEBOOK = "tinysplat_runtime.render.notebook"


@cache
def project_graph() -> imports_of_project.Graph:
    return imports_of_project.import_graph(imports_of_project.modules())


def test_the_only_import_circle_that_may_be_is_gaussians_that_show_themselves() -> None:
    """Imports inside functions and for types alone count; ARCHITECTURE.md says why this one may stay."""
    graph, shown = project_graph(), "tinysplat_runtime.gaussian.gaussians"
    assert imports_of_project.circles({**graph, shown: graph[shown] - {NOTEBOOK}}) == []


def test_rooms_of_the_runtime_import_only_those_that_architecture_md_has_further_along() -> None:
    """The container is the trust boundary: av does not stand behind it either."""
    line = re.search(r"^cli ─► .+$", (ROOT / "ARCHITECTURE.md").read_text("utf-8"), re.MULTILINE)
    assert line
    steps = [set(step.split(", ")) for step in line[0].split(" ─► ")]
    along = {room: set[str]().union(*steps[n + 1 :]) for n, step in enumerate(steps) for room in step}
    assert {path.parent.name for path in RUNTIME.glob("*/__init__.py")} <= set(along)
    breaks = []
    for name, found in project_graph().items():
        package, _, room = ".".join(name.split(".")[:2]).partition(".")
        for target in found - {NOTEBOOK} if package == "tinysplat_runtime" and room in along else ():
            theirs = target.removeprefix("tinysplat_runtime.").split(".")[0]
            if theirs in set(along) - along[room] - {room}:
                breaks.append(f"{name} imports {target}")
    assert breaks == []
    assert "av" not in {package for path in sources(RUNTIME / "container") for package, _, _ in imports(path)}


COMMANDS = ("runtime/tinysplat_runtime/cli/", "tinysplat/commands/")
INSIDE = ("runtime", "tinysplat", "export", "examples", "checks", ".ci")
"""Not pages about commands, nor tests, which name what they are about."""


def test_only_commands_know_of_the_command_line() -> None:
    """What a command does is below it, so that Python, batches and studies have it without arguments of argparse."""
    breaks = []
    paths = [path for folder in INSIDE for path in sources(ROOT / folder)]
    assert paths
    for path in paths:
        name = path.relative_to(ROOT).as_posix()
        if name.startswith(COMMANDS):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                names = [f"{node.module or ''}.{alias.name}" for alias in node.names]
                names = [f".{found}" if node.level else found for found in names]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            else:
                continue
            if any("cli" in found.split(".") for found in names):
                breaks.append(f"{name}:{node.lineno} imports the command line")
            if not name.startswith(("export/", "checks/")) and any(found.endswith("Namespace") for found in names):
                breaks.append(f"{name}:{node.lineno} takes arguments of argparse")
    assert [one for one in breaks if "__main__" not in one] == []


# ---- measuring ---------------------------------------------------------------------------------------------------

MEASURED = ("tinysplat_runtime", "export", "tinysplat.networks", "tinysplat.rasteriser")


def test_what_is_measured_never_imports_what_measures() -> None:
    measured = {name: found for name, found in project_graph().items() if name.startswith(MEASURED)}
    assert {name.split(".")[0] for name in measured} == {name.split(".")[0] for name in MEASURED}
    assert [name for name, found in measured.items() if any(t.startswith("tinysplat.measure") for t in found)] == []


def test_studies_are_imported_by_pages_of_reports_alone() -> None:
    studies = "tinysplat.measure.studies."
    breaks = [
        f"{name} imports {target}"
        for name, found in project_graph().items()
        for target in found
        if name.startswith("tinysplat.measure.") and name != "tinysplat.measure.pages"
        if target.startswith(studies) and not (name + ".").startswith(".".join(target.split(".")[:4]) + ".")
    ]
    assert breaks == []


IDLE = ("numba", "list.training", "list.pruning", "page")
"""What commands that read a file have no use for."""


@pytest.mark.parametrize(
    ("command", "output", "idle"),
    [
        ("render", "p.png", (*IDLE, "formats", "recipe")),
        ("decode", "g.npz", (*IDLE, "render")),
        ("info", "", (*IDLE, "av", "onnxruntime", "formats", "render", "recipe")),
    ],
)
def test_commands_that_read_a_file_load_only_what_they_use(tmp_path: Path, command, output, idle) -> None:
    file = ROOT / "tests" / "golden" / "data" / "tiny_paper.tsplat"
    words = [command, str(file), *(["-o", str(tmp_path / output), "-q"] if output else [])]
    code = f"import sys; from tinysplat_runtime.cli import main; main({words!r}); print(*sys.modules)"
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "runtime")}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    loaded = {name.removeprefix("tinysplat_runtime.") for name in done.stdout.splitlines()[-1].split()}
    assert {"container.reader"} <= loaded and (not output or (tmp_path / output).is_file())
    assert not [name for name in loaded for room in idle if f"{name}.".startswith(f"{room}.")]
    assert all((RUNTIME / name.replace(".", "/")).is_dir() or find_spec(name) for name in idle)
