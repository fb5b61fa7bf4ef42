"""What this installation is made of, and what is wrong with it: `tinysplat doctor`."""

import importlib.metadata
import os
import platform
import re
import sys
from collections.abc import Sequence

from .. import __version__
from ..errors import TinySplatError
from ..graphs.artifacts import load_manifest, models_dir
from ..graphs.inference import onnxruntime
from ..graphs.providers import Provider, known_providers
from ..system.jsonfields import JsonObject
from ..system.threads import available_cores
from .warm import ran_by

_NOT_FOR_USERS = ("docs", "dev", "release")
_MARKERS = (("extra", "=="), ("python_version", "<"))
_PACKAGE = re.compile(r"([\w.-]+)(?:\[([\w,-]+)\])?")

_BASE = ("numpy", "onnxruntime", "av")
_CODECS = (("libx265", "w"), ("hevc", "r"), ("png", "r"), ("mjpeg", "r"), ("libx264", "w"))


def examine(asked: Sequence[Provider] | None = None) -> JsonObject:
    """JSON-ready: versions, machine, providers, codecs, models, extras, and in `wrong` a line per fault.

    Where providers are asked for, `graphs` says how many nodes of each graph each of them ran on a made scene.
    """
    wrong: list[str] = []
    report: JsonObject = {
        "tinysplat": __version__,
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}, {available_cores()} cores",
        "packages": {name: _version(name, wrong) for name in _BASE},
        "providers": _providers(wrong),
        "codecs": _codecs(wrong),
        "models": _models(wrong),
        "extras": {extra: _state(extra, names) for extra, names in extras().items()},
    }
    if asked is not None:
        report["graphs"] = ran_by(asked, wrong)
    return {**report, "wrong": wrong}


def text(report: JsonObject) -> str:
    """`examine`'s account for reading."""
    lines = [f"tinysplat {report['tinysplat']}, Python {report['python']}, {report['machine']}"]
    for section in ("packages", "codecs", "models", "extras"):
        lines += ["", section, *(f"  {name:22} {state}" for name, state in report[section].items())]
    if "graphs" in report:
        lines += ["", "nodes run, by provider"]
        for name, ran in report["graphs"].items():
            lines.append(f"  {name:22} {', '.join(f'{nodes} {by}' for by, nodes in ran.items()) or 'none'}")
    verdict = [f"WRONG: {line}" for line in report["wrong"]] or ["nothing is wrong"]
    return "\n".join([*lines, "", "providers", *(f"  {name}" for name in report["providers"]), "", *verdict])


def _version(name: str, wrong: list[str]) -> str:
    """Of the package of a module's name, or of another that brings it: onnxruntime's builds are called otherwise."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        for package in importlib.metadata.packages_distributions().get(name, ()):
            return f"{importlib.metadata.version(package)}, of {package}"
        wrong.append(f"{name} is not installed; pip install tinysplat brings it")
        return "not installed"


def _providers(wrong: list[str]) -> list[str]:
    try:
        library = onnxruntime()
    except ImportError as error:
        wrong.append(f"onnxruntime does not load ({str(error)[:120]})")
        return []
    return known_providers(library)


def _codecs(wrong: list[str]) -> dict[str, str]:
    try:
        import av
    except ImportError as error:
        wrong.append(f"av does not load ({str(error)[:120]})")
        return {}
    states = {}
    for name, mode in _CODECS:
        try:
            av.Codec(name, mode)  # type: ignore[arg-type]
            states[name] = "encoder" if mode == "w" else "decoder"
        except ValueError:
            states[name] = "missing"
            wrong.append(f"this av has no {name} {'encoder' if mode == 'w' else 'decoder'}; pip's wheels have it")
    return states


def _models(wrong: list[str]) -> dict[str, str]:
    states = {}
    try:
        states["folder"] = str(models_dir()) + (" (TINYSPLAT_MODELS)" if os.environ.get("TINYSPLAT_MODELS") else "")
        for name, artifact in load_manifest().items():
            try:
                size = len(artifact.read())
                artifact.for_cpu().read()
                states[name] = f"{artifact.role}, {size / 1000:.0f} KB, as the manifest says"
            except TinySplatError as error:
                states[name] = "WRONG"
                wrong.append(str(error))
    except TinySplatError as error:
        wrong.append(str(error))
    return states


def extras(package: str = "tinysplat") -> dict[str, list[str]]:
    """The packages that each extra brings, as the metadata of the installed package have it; none where there are none.

    Args:
        package: whose extras.
    """
    try:
        metadata, lines = importlib.metadata.metadata(package), importlib.metadata.requires(package) or []
    except importlib.metadata.PackageNotFoundError:  # a folder of modules, as of small devices
        return {}
    brought: dict[str, list[str]] = {extra: [] for extra in metadata.get_all("Provides-Extra") or []}
    for line in lines:
        name, _, marker = line.partition(";")
        extra, below = (re.search(f"{key} {sign} ['\"]([^'\"]+)", marker) for key, sign in _MARKERS)
        if extra and not (below and sys.version_info[:2] >= tuple(map(int, below[1].split(".")))):
            brought[extra[1]].append(name)

    def packages(extra: str) -> list[str]:
        names: list[str] = []
        for match in map(_PACKAGE.match, brought[extra]):
            assert match is not None
            others = (match[2] or "").split(",") if match[1] == package else ()
            names += [name for other in others for name in packages(other)] if others else [match[1]]
        return list(dict.fromkeys(names))

    return {extra: packages(extra) for extra in brought if extra not in _NOT_FOR_USERS}


def _state(extra: str, names: list[str]) -> str:
    missing = [name for name in names if not _is_installed(name)]
    return "installed" if not missing else f'lacks {", ".join(missing)}: pip install "tinysplat[{extra}]"'


def _is_installed(name: str) -> bool:
    try:
        importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True
