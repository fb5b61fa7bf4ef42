"""Results of an evaluation: one record per window, model, profile, Q_g and size, and the folder that keeps them.

A record is written the moment it is complete, under a name made of everything it depends on: photos and cameras, the
model's and the transforms' files, the code, and the options. A run that was killed finds what it had finished; a run
with anything changed measures anew; records of other runs may lie in the same folder.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
from dataclasses import asdict, dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import tinysplat_runtime
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.graphs.artifacts import find_artifact, load_manifest
from tinysplat_runtime.system.files import StrPath, read_limited, write_atomically

RECORDS = "records"
PICTURES = "pictures"
RESULTS = "results.json"
_MAX_RECORD_BYTES = 4 * 1000 * 1000
_HASH_LENGTH = 16

Scores = dict[str, float]


@dataclass(frozen=True)
class Record:
    """What one coding of one window measured. None stands for what could not be measured.

    PSNR in dB, SSIM and LPIPS are means over the target images; `_raw` is the render of the network's Gaussians against
    the photo, no suffix that of the decoded ones, `_decoded_raw` decoded against raw, `_photo` the context photo taken
    from nearest, as if it were the answer. Covered pixels are those that
    some context view has in its frame, by `coverage.covered_pixels`.

    Attributes:
        scene, kind, model, profile, qp, height, width, views, context, targets: what was measured.
        bytes: of the file; bytes_by_class: of its planes; metadata_bytes: the rest; raw_bytes: of the raw arrays.
        seconds: per stage; `render` is the median of one picture.
        coverage: share of covered pixels.
        depth: {"raw" or "decoded": {"abs_rel", "rmse", "right", "covered"}} where the truth is known.
        attribute_errors: {"world" or "planes": {attribute: {"rmse", "max"}}} that coding made.
        per_image: the lists behind the means.
        pictures: folder under `pictures/` with the target pictures, if they were asked for.
    """

    scene: str
    kind: str
    model: str
    profile: str
    qp: float
    height: int
    width: int
    views: int
    context: tuple[int, ...]
    targets: tuple[int, ...]
    psnr_raw: float | None
    psnr: float | None
    psnr_decoded_raw: float
    ssim: float | None
    ssim_raw: float | None
    lpips: float | None
    bytes: int
    seconds: dict[str, float]
    lpips_raw: float | None = None
    ssim_decoded_raw: float | None = None
    lpips_decoded_raw: float | None = None
    psnr_photo: float | None = None
    ssim_photo: float | None = None
    lpips_photo: float | None = None
    coverage: float | None = None
    psnr_covered: float | None = None
    psnr_raw_covered: float | None = None
    psnr_photo_covered: float | None = None
    depth: dict[str, Scores] = field(default_factory=dict)
    bytes_by_class: dict[str, int] = field(default_factory=dict)
    metadata_bytes: int = 0
    raw_bytes: int = 0
    gaussians: int = 0
    attribute_errors: dict[str, dict[str, Scores]] = field(default_factory=dict)
    per_image: dict[str, list[float]] = field(default_factory=dict)
    pictures: str | None = None

    def as_json(self) -> dict[str, Any]:
        """A JSON-ready object."""
        return asdict(self)

    @classmethod
    def from_json(cls, document: Any) -> Record:
        """The record of `as_json`'s object; TypeError or ValueError if it is none."""
        names = {f.name for f in fields(cls)}
        if not isinstance(document, dict) or not set(document) <= names:
            raise ValueError("not a record")
        lists = {name: tuple(document[name]) for name in ("context", "targets")}
        return cls(**{**document, **lists})


@dataclass(frozen=True)
class Key:
    """All that a record depends on; its hash names the record's file."""

    scene: str
    kind: str
    context: tuple[int, ...]
    targets: tuple[int, ...]
    model: str
    profile: str
    qp: float
    size: tuple[int, int]
    lpips: str
    source: str
    code: str

    @property
    def stem(self) -> str:
        """Name of the record's file and of its folder of pictures, without suffix."""
        digest = hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()[:_HASH_LENGTH]
        words = f"{self.scene[:40]}-{self.kind}-{'_'.join(map(str, self.context))}-{self.profile}-{self.qp:g}-{digest}"
        return "".join(c if c.isalnum() or c in "-_." else "_" for c in words)


class ResultStore:
    """A folder of records."""

    def __init__(self, folder: StrPath) -> None:
        """Make the folder where there is none.

        Raises:
            InputError: the path is a file.
            OSError: the folder cannot be made.
        """
        self.folder = Path(folder)
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError("is a file, expected a folder for results", where=str(folder))
        (self.folder / RECORDS).mkdir(parents=True, exist_ok=True)

    def load(self, key: Key, *, with_pictures: bool = False) -> Record | None:
        """The finished record, or None: not there, not whole, or lacking pictures that are asked for."""
        path = self._path(key)
        if not path.is_file():
            return None
        try:
            record = Record.from_json(json.loads(read_limited(path, _MAX_RECORD_BYTES)))
        except (ValueError, TypeError, KeyError, InputError):
            return None
        if with_pictures and not (record.pictures and (self.folder / PICTURES / record.pictures).is_dir()):
            return None
        return record

    def save(self, key: Key, record: Record) -> None:
        """Keep a record; it appears whole or not at all."""
        write_atomically(self._path(key), (json.dumps(record.as_json(), indent=1) + "\n").encode())

    def picture_folder(self, key: Key) -> Path:
        """Where the pictures of a record go; made where there is none."""
        folder = self.folder / PICTURES / key.stem
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def _path(self, key: Key) -> Path:
        return self.folder / RECORDS / f"{key.stem}.json"


@lru_cache(maxsize=64)
def model_fingerprint(model: str) -> str:
    """Hash of a network's file, with the size and time of change of weights kept beside it.

    Raises:
        ModelError: there is no such network.
    """
    artifact = find_artifact(model, "network")
    if artifact.sha256 is not None:
        return artifact.sha256[:_HASH_LENGTH]
    digest = hashlib.sha256(artifact.read())
    for sibling in sorted(artifact.path.parent.glob(f"{artifact.path.name}*data")):
        stat = sibling.stat()
        digest.update(f"{sibling.name} {stat.st_size} {stat.st_mtime_ns}".encode())
    return digest.hexdigest()[:_HASH_LENGTH]


@lru_cache(maxsize=1)
def code_fingerprint() -> str:
    """Hash of the code, graphs and libraries that figures depend on."""
    runtime, here = Path(str(tinysplat_runtime.__file__)).parent, Path(__file__).parent
    measuring = [here / f"{name}.py" for name in ("coverage", "lpips", "measure", "scene_index", "sources")]
    sources = [*runtime.rglob("*.py"), *here.parent.glob("datasets/*.py"), here.parent / "metrics.py", *measuring]
    digest = hashlib.sha256()
    for path in sorted(sources):
        digest.update(path.name.encode() + path.read_bytes())
    for name, artifact in sorted(load_manifest().items()):
        if artifact.role != "network":
            digest.update(f"{name} {artifact.sha256}".encode())
    for package in ("numpy", "onnxruntime", "av"):
        digest.update(f"{package} {importlib.metadata.version(package)}".encode())
    return digest.hexdigest()[:_HASH_LENGTH]
