"""Find ONNX artifacts and verify them before they are opened.

`models/manifest.json` lists the shipped ones with their sha256; a user's own network is named by its path. The folder
is the argument, or what the environment variable TINYSPLAT_MODELS names; where neither is given, it is looked for in
the installed package data (`tinysplat_models`) and the `models/` folder of a source checkout.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
from dataclasses import dataclass, replace
from pathlib import Path

from ..errors import ModelError
from ..system.jsonfields import JsonObject

MANIFEST = "manifest.json"


@dataclass(frozen=True)
class Artifact:
    """One ONNX file.

    Attributes:
        name: name in the manifest, or the file's stem for a user's own.
        path: where the file lies.
        role: "network", "analysis" or "synthesis"; None when only the file itself can tell.
        sha256: expected hash in hex; None for a user's own file, which nothing vouches for.
        entry: the manifest's whole entry, empty for a user's own file.
        optimised: file and hash of what onnxruntime made of the graph for its CPU provider, where the manifest has it.
    """

    name: str
    path: Path
    role: str | None = None
    sha256: str | None = None
    entry: JsonObject | None = None
    optimised: tuple[Path, str] | None = None

    def for_cpu(self) -> Artifact:
        """What to open for the CPU: the same graph as `export/optimised.py` stored it, where it did; itself otherwise.

        Opening `edge` takes longer than running it, most of that to look for operators to join. The stored graph opens
        in 0.57 of the time and computes the same bits. It is a copy to save time: name and hash of the network are
        those of its own file, which is opened where the copy cannot be.
        """
        return self if self.optimised is None else replace(self, path=self.optimised[0], sha256=self.optimised[1])

    def file_sha256(self) -> str:
        """Hash of the ONNX file, hexadecimal; of a user's own file as it is now. Weights beside it are not in it."""
        return self.sha256 or hashlib.sha256(self.read()).hexdigest()

    def read(self) -> bytes:
        """The file's bytes; ModelError where it is missing, unreadable, or not of the manifest's hash."""
        try:
            data = self.path.read_bytes()
        except OSError as error:
            raise ModelError(f"cannot be read ({error.strerror})", where=str(self.path)) from None
        if self.sha256 is not None:
            actual = hashlib.sha256(data).hexdigest()
            if actual != self.sha256:
                raise ModelError(f"sha256 {actual[:12]}…, manifest says {self.sha256[:12]}…", where=str(self.path))
        return data


def models_dir(folder: str | os.PathLike[str] | None = None) -> Path:
    """The folder that holds manifest.json; see the module's text for where it is looked for."""
    named = os.environ.get("TINYSPLAT_MODELS") if folder is None else folder
    candidates = [Path(named)] if named else []
    if not candidates:
        spec = importlib.util.find_spec("tinysplat_models")
        candidates += [Path(place) for place in (spec and spec.submodule_search_locations) or ()]
        candidates.append(Path(__file__).resolve().parents[2] / "models")
    for candidate in candidates:
        if (candidate / MANIFEST).is_file():
            return candidate
    fault = f"no {MANIFEST} in {', '.join(map(str, candidates))}"
    if folder is None and named:
        raise ModelError(f"{fault}; unset it for the models that came with this", where="TINYSPLAT_MODELS")
    raise ModelError(f"{fault}; set TINYSPLAT_MODELS to the folder that has it", where="models")


def load_manifest(folder: str | os.PathLike[str] | None = None) -> dict[str, Artifact]:
    """All shipped artifacts by name; ModelError where there is no manifest, or it is not one."""
    root = models_dir(folder)
    path = root / MANIFEST
    try:
        entries = json.loads(path.read_text("utf-8"))["artifacts"]
        found = {}
        for name, entry in entries.items():
            stored = entry.get("optimised")
            optimised = (root / stored["file"], stored["sha256"]) if stored else None
            found[name] = Artifact(name, root / entry["file"], entry["role"], entry["sha256"], entry, optimised)
        return found
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ModelError(f"not a manifest of artifacts ({type(error).__name__}: {error})", where=str(path)) from None


CHECKPOINTS = (".ckpt", ".pt", ".pth", ".safetensors", ".bin")
"""Endings of files of weights, which somebody may take for networks."""


def find_artifact(name: str, role: str, folder: str | os.PathLike[str] | None = None) -> Artifact:
    """The artifact that `name` means: a name in the manifest, or the path of an .onnx or .ort file.

    Raises:
        ModelError: there is no such artifact, or it has another role.
    """
    if name.endswith(CHECKPOINTS):
        fault = "a checkpoint, expected an .onnx file: `python -m export.network` makes one of it (docs/MODELS.md)"
        raise ModelError(fault, where=name)
    if name.endswith((".onnx", ".ort")) or os.sep in name:
        path = Path(name)
        if not path.is_file():
            raise ModelError(
                "no such file; expected an ONNX network or a name listed by `tinysplat models`", where=name
            )
        return Artifact(path.stem, path)
    manifest = load_manifest(folder)
    artifact = manifest.get(name)
    if artifact is None or artifact.role != role:
        known = ", ".join(sorted(a.name for a in manifest.values() if a.role == role))
        raise ModelError(
            f"unknown {role} '{name}'; there are {known}, or give the path of an .onnx file", where="model"
        )
    return artifact


def network_by_hash(
    name: str, sha256: str, given: str | None = None, folder: str | os.PathLike[str] | None = None
) -> Artifact:
    """The network whose file has exactly this hash.

    Args:
        name: what it was called where it was used; for messages.
        sha256: of its ONNX file, hexadecimal.
        given: the path of a file, or a name in the manifest, to take in place of looking through the manifest.
        folder: of the artifacts; None for the usual places.

    Raises:
        ModelError: there is none, or the one given or the one of that name is another.
    """
    if given is not None:
        found = find_artifact(given, "network", folder)
        if found.file_sha256() != sha256:
            message = f"sha256 {found.file_sha256()[:12]}…, the file needs network '{name}' of sha256 {sha256}"
            raise ModelError(message, where=str(found.path))
        return found
    manifest = load_manifest(folder)
    for artifact in manifest.values():
        if artifact.role == "network" and artifact.sha256 == sha256:
            return artifact
    here = manifest.get(name)
    other = f"; the '{name}' at hand is another (sha256 {here.sha256[:12]}…)" if here and here.sha256 else ""
    message = f"network '{name}' of sha256 {sha256} is not at hand{other}; give its file with --model FILE.onnx"
    raise ModelError(message, where="model")
