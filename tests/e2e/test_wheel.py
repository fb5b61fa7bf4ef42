"""The wheel: what it declares and holds, and that it runs with numpy, onnxruntime and av alone."""

import email
import email.policy
import importlib.metadata
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import tomllib
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"  # a copy: building leaves a folder behind, whose stale files the next wheel would hold
    for name in ("runtime", "tinysplat", "models"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(folder), str(source)]
    subprocess.run(command, check=True, capture_output=True, timeout=240)
    return next(folder.glob("tinysplat-*.whl"))


def _base_requirements() -> set[str]:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    return {requirement.split(">")[0] for requirement in declared}


def test_the_base_install_needs_three_packages():
    assert _base_requirements() == {"numpy", "onnxruntime", "av"}


def test_every_package_on_disk_is_in_the_wheel_with_models_and_marker(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    for root in (ROOT / "runtime" / "tinysplat_runtime", ROOT / "tinysplat"):
        for source in root.rglob("*.py"):
            assert str(source.relative_to(root.parent)) in names
    assert "tinysplat_runtime/py.typed" in names and "tinysplat_models/manifest.json" in names
    parts = [
        part
        for room in ("page", "web")
        for part in (ROOT / "runtime" / "tinysplat_runtime" / room).rglob("*")
        if part.suffix in {".html", ".css", ".js", ".mjs", ".ts", ".gz"}
    ]
    assert parts
    for part in parts:
        assert str(part.relative_to(ROOT / "runtime")) in names
    for artifact in (ROOT / "models").glob("*.onnx"):
        assert f"tinysplat_models/{artifact.name}" in names


def test_the_description_has_links_that_lead_somewhere_from_an_index(wheel):
    archive = zipfile.ZipFile(wheel)
    name = next(name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
    declared = email.message_from_bytes(archive.read(name), policy=email.policy.default)
    links = re.findall(r"\]\(([^)#\s]+)", declared.get_content())
    source = dict(entry.split(", ") for entry in declared.get_all("Project-URL"))["Source"]
    inside = [link.removeprefix(source) for link in links if link.startswith(source)]
    assert inside and all("://" in link for link in links)
    assert all((ROOT / link.split("/", 3)[3]).exists() for link in inside)


def _site_of_base_packages(folder: Path) -> None:
    """Link the base requirements, and what they require, out of this environment into an empty folder."""
    queue, seen = sorted(_base_requirements()), set()
    while queue:
        name = queue.pop()
        if name in seen:
            continue
        seen.add(name)
        distribution = importlib.metadata.distribution(name)
        tops = {Path(str(f)).parts[0] for f in distribution.files or () if not str(f).startswith("..")}
        for top in tops - {"__pycache__"}:
            source = Path(str(distribution.locate_file(top)))
            if source.exists() and not (folder / top).exists():
                (folder / top).symlink_to(source)
        for requirement in distribution.requires or ():
            needed = (
                requirement.split(";")[0].split("[")[0].strip("() ").split(">")[0].split("=")[0].split("<")[0].strip()
            )
            if "extra ==" not in requirement and importlib.util.find_spec(needed.replace("-", "_")) is not None:
                queue.append(needed)


def test_the_wheel_encodes_and_decodes_where_torch_and_onnx_do_not_exist(wheel, tmp_path):
    site = tmp_path / "site"
    site.mkdir()
    _site_of_base_packages(site)
    zipfile.ZipFile(wheel).extractall(site)
    ts.save_gaussians(tmp_path / "g.npz", make_smooth_gaussians(2, 20, 24, degree=1))
    script = f"""
import sys
sys.path.insert(0, {str(site)!r})
import importlib.util
for name in ("torch", "onnx", "scipy", "skimage"):
    assert importlib.util.find_spec(name) is None, name
from tinysplat_runtime.cli import main
assert main(["compress", {str(tmp_path / "g.npz")!r}, "-o", {str(tmp_path / "g.tsplat")!r}]) == 0
assert main(["decode", {str(tmp_path / "g.tsplat")!r}, "-o", {str(tmp_path / "d.npz")!r}]) == 0
assert main(["render", {str(tmp_path / "g.tsplat")!r}, "-o", {str(tmp_path / "d.png")!r}]) == 0
from tinysplat_runtime.graphs.artifacts import models_dir
assert str(models_dir()).startswith({str(site)!r}), models_dir()
"""
    # -I and -S: neither PYTHONPATH nor this environment's site-packages.
    env = {name: value for name, value in os.environ.items() if name != "TINYSPLAT_MODELS"}
    command = [sys.executable, "-I", "-S", "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, env=env)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "d.png").read_bytes().startswith(b"\x89PNG")
