"""Every extra of pyproject.toml: where its packages are missing, one line gives the pip install that brings them."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import tomllib
from measure.evaluation_scenes import write_eval_scene
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.cli.doctor import extras

ROOT = Path(__file__).resolve().parents[2]

WITHOUT = """
import runpy, sys
sys.modules.update(dict.fromkeys(sys.argv[1].split(",")))  # None: an import fails
how, sys.argv = sys.argv[2], sys.argv[3:]
if how == "script":
    sys.path.insert(0, sys.argv[0].rpartition("/")[0])
(runpy.run_path if how == "script" else runpy.run_module)(sys.argv[0], run_name="__main__")
"""

CLI = ("module", "tinysplat_runtime")

CASES: dict[str, list[tuple[str, tuple[str, ...]]]] = {
    "io": [
        ("plyfile", (*CLI, "convert", "g.npz", "-o", "x.ply")),
        ("plyfile", (*CLI, "render", "g.ply", "-o", "x.png")),
        ("safetensors", (*CLI, "convert", "g.safetensors", "-o", "x.npz")),
        ("PIL", (*CLI, "convert", "g.npz", "-o", "x.sog")),
        ("zstandard", (*CLI, "convert", "g.spz", "-o", "x.npz")),
    ],
    "usd": [("pxr", (*CLI, "convert", "g.npz", "-o", "x.usda")), ("pxr", (*CLI, "convert", "g.usda", "-o", "x.npz"))],
    "fast": [("scipy", (*CLI, "convert", "g.npz", "-o", "x.npz", "--clean"))],
    "demo": [("skimage", ("script", "examples/demo.py", "--out", "out"))],
    "eval": [
        ("PIL", (*CLI, "compare", "g.npz", "g.npz")),
        ("matplotlib", (*CLI, "bench", "--quick")),
        ("skimage", (*CLI, "eval", "scene", "--model", "sweep", "-q")),
        ("torch", (*CLI, "eval", "scene", "--model", "sweep", "--lpips-backbone", "b.pth", "--lpips-linear", "l.pth")),
    ],
    "completion": [("shtab", (*CLI, "completion", "bash"))],
    "app": [("gradio", ("script", "examples/app/app.py"))],
    "cluster": [
        ("ray", (*CLI, "batch", "manifest.txt", "-o", "out", "--engine", "ray")),
        ("fsspec", (*CLI, "batch", "memory://m.txt", "-o", "out")),
    ],
    "poses": [
        ("pycolmap", (*CLI, "poses", ".", "-o", "scene")),
        ("pycolmap", (*CLI, "encode", "distorted", "-o", "x.tsplat")),
    ],
    "heic": [("pillow_heif", (*CLI, "poses", "heic", "-o", "scene"))],
    "torch": [("torch", ("module", "tinysplat.gsplat_tensors"))],
    "train": [("torch", ("module", "tinysplat.training", "c.toml", "--out", "out"))],
    "export": [("torch", ("module", "export.transforms"))],
}
"""Missing package, and what is run without it."""

SILENT = {"docs", "dev", "release"}
"""What only the Makefile installs."""


def test_no_extra_is_forgotten() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(CASES) | SILENT == set(declared)
    reported = extras()
    assert set(reported) == set(declared) - {"docs", "dev", "release"}
    for extra, names in reported.items():
        for requirement in (one for one in declared[extra] if ";" not in one):  # but of other Pythons alone
            name, *others = re.findall(r"[\w-]+", requirement.partition(">")[0])
            assert all(set(reported[other]) <= set(names) for other in others) if name == "tinysplat" else name in names
    assert all("tinysplat" not in names for names in reported.values()) and extras("no such package") == {}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("extras")
    write_eval_scene(folder / "scene")
    gaussians = make_smooth_gaussians(2, 8, 8, degree=0)
    for suffix in (".npz", ".ply", ".safetensors"):
        ts.save_gaussians(folder / f"g{suffix}", gaussians)
    ts.save_gaussians(folder / "g.spz", gaussians, spz_version=4)
    (folder / "g.usda").write_text("#usda 1.0")
    (folder / "manifest.txt").write_text("scene\n")
    (folder / "c.toml").write_text("")
    for name in ("b.pth", "l.pth"):
        (folder / name).write_bytes(b"")
    (folder / "heic").mkdir()
    (folder / "heic/a.heic").write_bytes(b"")
    (folder / "distorted").mkdir()
    (folder / "distorted/transforms.json").write_text(
        '{"fl_x": 9, "w": 8, "h": 8, "k1": 0.1, "frames": [{"file_path": "a.png", "transform_matrix":'
        " [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}]}"
    )
    return folder


@pytest.mark.parametrize(
    ("extra", "package", "command"),
    [(extra, package, command) for extra, cases in CASES.items() for package, command in cases],
    ids=lambda value: value if isinstance(value, str) else None,
)
def test_a_missing_package_is_one_line_with_its_pip_install(
    folder: Path, extra: str, package: str, command: tuple[str, ...]
) -> None:
    how, target, *arguments = command
    target = str(ROOT / target) if how == "script" else target
    path = os.pathsep.join([str(ROOT / "runtime"), str(ROOT)])
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, package, how, target, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env={**os.environ, "PYTHONPATH": path, "TINYSPLAT_MODELS": str(ROOT / "models")},
    )
    last = done.stderr.splitlines()[-1]
    assert f'pip install "tinysplat[{extra}]"' in last, done.stderr
    if command[1] != "tinysplat.gsplat_tensors":  # a module to import: its ImportError says it
        assert done.returncode == 2 and done.stderr.count("\n") == 1 and done.stdout == ""


@pytest.mark.parametrize("command", ["bench", "compare", "completion", "eval", "poses"])
def test_help_needs_no_extra(folder: Path, command: str) -> None:
    absent = "matplotlib,PIL,pycolmap,scipy,shtab,torch"
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, absent, *CLI, command, "--help"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT / "runtime"), str(ROOT)])},
    )
    assert done.returncode == 0 and f"tinysplat {command}" in done.stdout, done.stderr
    assert "pip install" not in done.stdout  # what it does, not what it lacks
