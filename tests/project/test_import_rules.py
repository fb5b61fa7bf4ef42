"""Which way imports point: export → tinysplat → tinysplat_runtime, and the runtime needs numpy, onnxruntime and av."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from project import imports as imports_of_project

ROOT = Path(__file__).parents[2]
RUNTIME = ROOT / "runtime" / "tinysplat_runtime"

ALLOWED_IN_RUNTIME = {*sys.stdlib_module_names, "numpy", "onnxruntime", "av", "tinysplat_runtime"}

EXTRAS_INSIDE_FUNCTIONS = {
    "formats/arrays.py": {"safetensors"},  # tinysplat[io]
    "formats/compressed_ply.py": {"plyfile"},
    "formats/sog.py": {"PIL"},
    "formats/usd.py": {"pxr"},  # tinysplat[usd]
    "formats/usd_worker.py": {"pxr"},
    "formats/file_notes.py": {"safetensors"},
    "formats/spz_streams.py": {"zstandard"},
    "scene/intake/colmap_worker.py": {"pycolmap"},  # tinysplat[poses]
    "scene/lenses.py": {"pycolmap"},  # tinysplat[poses]
    "scene/intake/nerfstudio.py": {"plyfile"},  # tinysplat[io]
    "formats/ply.py": {"plyfile"},  # tinysplat[io]
    "codec/ranges.py": {"fsspec"},  # tinysplat[cluster]
    "system/progress.py": {"tqdm"},  # a nicer bar, where it happens to be installed
}
"""Packages that an extra brings, by the one module whose functions may import them."""

EXTRA_MODULES = {"render/kernels_project.py": {"numba"}}  # tinysplat[fast]
"""Modules that are only imported where an extra is installed, and may import it as they please."""


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
        name = path.relative_to(RUNTIME).as_posix()
        extras, own = EXTRAS_INSIDE_FUNCTIONS.get(name, set()), EXTRA_MODULES.get(name, set())
        for package, line, is_inside in imports(path):
            if package not in ALLOWED_IN_RUNTIME | own and not (is_inside and package in extras):
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
        "codec/modes/registry.py",
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
    "torch", "onnx", "tinysplat", "export", "onnxscript", "safetensors", "plyfile", "zstandard", "pycolmap", "tqdm",
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


@cache
def project_graph() -> imports_of_project.Graph:
    return imports_of_project.import_graph(imports_of_project.modules())


def test_the_only_import_circle_that_may_be_is_gaussians_that_show_themselves() -> None:
    """Imports inside functions and for types alone count; ARCHITECTURE.md says why this one may stay."""
    graph = project_graph()
    runtime = {name: found for name, found in graph.items() if name.startswith("tinysplat_runtime")}
    shown, notebook = "tinysplat_runtime.gaussian.gaussians", "tinysplat_runtime.render.notebook"
    assert imports_of_project.circles({**runtime, shown: runtime[shown] - {notebook}}) == []


@pytest.mark.parametrize(
    ("room", "leans_on"),
    [
        ("system", set()),
        ("scene", {"system"}),
        ("container", {"gaussian", "scene", "system"}),
        ("formats", {"gaussian", "render", "scene", "system"}),
        ("graphs", {"gaussian", "scene", "system"}),
        ("render", {"gaussian", "scene", "system"}),
        ("codec", {"container", "gaussian", "graphs", "render", "scene", "system"}),
        ("prune", {"codec", "gaussian", "refine", "render", "scene", "system"}),
        ("refine", {"codec", "container", "gaussian", "graphs", "render", "scene", "system"}),
        (
            "recipe",
            {"codec", "container", "formats", "gaussian", "graphs", "prune", "refine", "render", "scene", "system"},
        ),
        ("page", {"scene", "system", "web"}),
    ],
)
def test_rooms_of_the_runtime_lean_on_those_below_them(room: str, leans_on: set[str]) -> None:
    """The container is the trust boundary: neither codec nor av stands behind it."""
    graph = project_graph()
    inside = f"tinysplat_runtime.{room}"
    targets = {t for name, found in graph.items() if (name + ".").startswith(inside + ".") for t in found}
    rooms = {imports_of_project.room(t) for t in targets} - {inside, "tinysplat_runtime"}
    assert {name.removeprefix("tinysplat_runtime.") for name in rooms} <= leans_on
    if room == "container":
        paths = sources(RUNTIME / room)
        assert paths and "av" not in {package for path in paths for package, _, _ in imports(path)}


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


# ---- the house of measuring --------------------------------------------------------------------------------------

GROUND = ("rows", "metrics", "lpips", "clock", "subjects", "curves")
ON_GROUND = ("pictures", "show")
ABOVE = ("runner", "quality", "study")
STUDIES, PAGES = "studies", "tinysplat.measure.show.pages"
"""The top layer; and the module that asks the list of studies for their tables, for reports."""

MEASURED = ("tinysplat_runtime", "export", "tinysplat.networks", "tinysplat.rasteriser", "tinysplat.reference")


def rooms_of_measuring() -> dict[str, set[str]]:
    """By module of measuring, the modules and rooms of it that it imports; of studies with their own module's name."""

    def room(module: str) -> str:
        parts = module.split(".")[2:]
        return ".".join(parts[:2] if parts[0] == STUDIES else parts[:1])

    inside = "tinysplat.measure."
    modules = {name: found for name, found in project_graph().items() if name.startswith(inside)}
    return {name: {room(t) for t in found if t.startswith(inside)} - {room(name)} for name, found in modules.items()}


def test_what_is_measured_never_imports_what_measures() -> None:
    measured = {name: found for name, found in project_graph().items() if name.startswith(MEASURED)}
    assert {name.split(".")[0] for name in measured} == {name.split(".")[0] for name in MEASURED}
    assert [name for name, found in measured.items() if any(t.startswith("tinysplat.measure") for t in found)] == []


def test_the_house_of_measuring_stands_in_layers_and_no_study_imports_another() -> None:
    breaks = []
    for name, found in rooms_of_measuring().items():
        own = name.split(".")[2]
        above = {GROUND: {*ON_GROUND, *ABOVE}, ON_GROUND: {*ABOVE}, ABOVE: set[str](), (STUDIES,): set[str]()}
        banned = next(rooms for layer, rooms in above.items() if own in layer)
        studies = {one for one in found if one.startswith(STUDIES) and name != PAGES}
        breaks += [f"{name} imports {one}" for one in sorted(found & banned | studies)]
    assert breaks == []


IDLE = ("codec.encoder", "codec.rate", "codec.depth_step", "graphs.enlarge", "scene.intake", "recipe.encode", "numba")
"""What commands that read a file have no use for."""


@pytest.mark.parametrize(
    ("command", "output", "idle"),
    [
        ("render", "p.png", (*IDLE, "formats.")),
        ("decode", "g.npz", (*IDLE, "render", "recipe.stages", "formats.ply", "formats.usd", "scene.images")),
        ("info", "", (*IDLE, "av", "onnxruntime", "formats.", "codec.layers", "render", "recipe")),
    ],
)
def test_commands_that_read_a_file_load_neither_encoder_nor_layouts(tmp_path: Path, command, output, idle) -> None:
    file = ROOT / "tests" / "golden" / "data" / "tiny_paper.tsplat"
    words = [command, str(file), *(["-o", str(tmp_path / output), "-q"] if output else [])]
    code = f"import sys; from tinysplat_runtime.cli import main; main({words!r}); print(*sys.modules)"
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "runtime")}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    loaded = {name.removeprefix("tinysplat_runtime.") for name in done.stdout.splitlines()[-1].split()}
    assert {"container.reader"} <= loaded and (not output or (tmp_path / output).is_file())
    assert not [name for name in loaded if name.startswith(idle)]
