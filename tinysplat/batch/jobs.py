"""One scene of a batch: what is to be done, how a worker does it, and what came of it."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import tempfile
import time
from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

from tinysplat_runtime.api import DEFAULT_MODEL, Runtime
from tinysplat_runtime.cli.arguments import AutoViews, Budget, budget, byte_count, size_or_full, views
from tinysplat_runtime.cli.encode import check_encoding, encoded, report
from tinysplat_runtime.cli.files import providers
from tinysplat_runtime.cli.selfcheck import doubts
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.errors import InputError, TinySplatError

from .storage import join, local_folder, read, write

SUFFIXES = {"encode": ".tsplat", "evaluate": ".json"}
"""What can be done with a scene, and how the name of its output ends."""


@dataclass(frozen=True)
class Options:
    """How every scene of a batch is coded; a manifest's entry may set any of them for its scene.

    Attributes:
        views: indices, or None to choose `auto` of them.
        auto: how many views to choose where `views` is None; 0 takes all of up to six, or else two.
        size: (height, width) to resize photos to, `full`, or None for what `encode` takes.
        near, far: depth range over the scene's own, or None.
        model: network.
        profile: of the codec.
        qp: Q_g.
        mode: what files carry.
        target_size, target_psnr: bytes, or dB, in place of `qp`; None for neither.
        lossless: float16 planes bit for bit.
        refine: steps (`20`) or seconds (`10s`) of refinement before coding; empty for none.
        like: a file to code like, path or URL; empty for none.
        drop_invalid: make Gaussians at or behind their camera transparent.
        unit, attribution, licence: notes that the file carries; None for the scene's own.
        provider: onnxruntime's, or None.
        poses: of a video's frames, path or URL; empty where the scene is no video.
        first_number: what `poses` count from.
        report, save_gaussians: also write NAME.json, NAME.npz.
    """

    views: tuple[int, ...] | None = None
    auto: int = 0
    size: tuple[int, int] | str | None = None
    near: float | None = None
    far: float | None = None
    model: str = DEFAULT_MODEL
    profile: str = "balanced"
    qp: float = 0.0
    mode: str = "gaussians"
    target_size: int | None = None
    target_psnr: float | None = None
    lossless: bool = False
    refine: str = ""
    like: str = ""
    drop_invalid: bool = False
    unit: str | None = None
    attribution: str | None = None
    licence: str | None = None
    provider: str | None = None
    poses: str = ""
    first_number: int = 0
    report: bool = False
    save_gaussians: bool = False


BEFORE = {"views", "auto", "size", "near", "far", "model", "profile", "qp"}
"""Options whose values have always been part of a fingerprint."""


@dataclass(frozen=True)
class Job:
    """A scene to code or evaluate.

    Attributes:
        name: of the output, unique in its batch.
        scene: path or URL.
        output: path or URL of the file.
        options: how.
        task: one of SUFFIXES.
    """

    name: str
    scene: str
    output: str
    options: Options = field(default_factory=Options)
    task: str = "encode"

    @property
    def fingerprint(self) -> str:
        """Changes with the task, the scene's place and every option."""
        options = dataclasses.asdict(self.options)
        for later in set(options) - BEFORE:
            if options[later] == getattr(Options(), later):
                del options[later]  # as it was before there was such an option: what was done then is not done again
        text = json.dumps([self.task, self.scene, options], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def encode(job: Job, threads: int = 1) -> dict[str, Any]:
    """Code a scene in this process, which keeps its graphs from job to job.

    Returns:
        The job's record: `bytes` and `sha256` of the file, `seconds`, `worker`, and a `warning` where photos and
        cameras do not seem to belong together.

    Raises:
        TinySplatError: the scene is at fault; another attempt would end the same way.
        OSError: storage failed; another attempt may not.
    """
    start = time.perf_counter()
    options = job.options
    with contextlib.ExitStack() as stack:
        args = encode_arguments(job, threads, lambda place: stack.enter_context(local_folder(place)))
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="tinysplat-"))
        args.save_gaussians = str(Path(folder) / "g.npz") if options.save_gaussians else None
        check_encoding(args)
        coded = encoded(args, worker_runtime(threads, args.provider))
        found = doubts(coded.photos)
        place = job.output.removesuffix(SUFFIXES["encode"])
        if args.save_gaussians:
            write(f"{place}.npz", Path(args.save_gaussians).read_bytes())
        if options.report:
            write(f"{place}.json", json.dumps(report(args, coded), indent=2).encode())
    write(job.output, coded.data)
    return {
        "bytes": len(coded.data),
        "sha256": hashlib.sha256(coded.data).hexdigest(),
        **({"warning": "; ".join(found)} if found else {}),
        "seconds": round(time.perf_counter() - start, 3),
        "worker": os.getpid(),
    }


def encode_arguments(job: Job, threads: int, local: Callable[[str], str]) -> Namespace:
    """A job as the arguments of `tinysplat encode`, so that both do the same.

    Args:
        job: which.
        threads: of each stage.
        local: gives a place's path on this machine.
    """
    options = job.options
    chosen = list(options.views) if options.views is not None else AutoViews(options.auto) if options.auto else None
    targets = (options.target_size, options.target_psnr, options.lossless or None, options.like or None)
    given = {
        **dataclasses.asdict(options),
        "scene": [local(job.scene)],
        "views": chosen,
        "qp": None if any(targets) else options.qp,
        "profile": None if options.lossless or options.like else options.profile,
        "refine": refinement(options.refine) if options.refine else None,
        "like": local(options.like) if options.like else None,
        "poses": local(options.poses) if options.poses else None,
    }
    return Namespace(**given, focal=None, baseline=None, threads=threads, quiet=True, output=job.output)


def refinement(text: str) -> Budget:
    """What an option `refine` asks for; InputError where it is neither steps nor seconds."""
    try:
        return budget(str(text))
    except ArgumentTypeError as error:
        raise InputError(str(error), where="refine") from None


def is_done(job: Job, record: dict[str, Any] | None) -> bool:
    """Whether a record of an earlier run stands for this job and its file is whole."""
    if not record or record.get("status") != "done" or record.get("fingerprint") != job.fingerprint:
        return False
    data = read(job.output)
    if data is None or hashlib.sha256(data).hexdigest() != record.get("sha256"):
        return False
    if job.task != "encode":
        return True
    try:
        inspect_bytes(data)
    except TinySplatError:
        return False
    return True


def read_manifest(text: str, folder: str, defaults: Options, base: str = "", task: str = "encode") -> list[Job]:
    """Jobs of a manifest: a scene per line, or per line a JSON object.

    An object has `scene`, optionally `name`, and any of the options. Empty lines and lines that start with # are
    ignored. Relative paths count from `base`.

    Raises:
        InputError: names the line at fault.
    """
    jobs: list[Job] = []
    names: dict[str, int] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            job = _job(line.strip(), folder, defaults, base, task)
        except InputError as error:
            raise error.within(f"line {number}") from None
        if job.name in names:
            raise InputError(f"the name '{job.name}' again, first in line {names[job.name]}; give one with \"name\"",
                             where=f"line {number}")  # fmt: skip
        names[job.name] = number
        jobs.append(job)
    if not jobs:
        raise InputError("no scenes, expected one per line")
    return jobs


def _job(line: str, folder: str, defaults: Options, base: str, task: str) -> Job:
    entry: Any = {"scene": line}
    if line.startswith("{"):
        try:
            entry = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise InputError(f"not JSON ({str(error)[:60]})") from None
    if not isinstance(entry, dict) or not isinstance(entry.get("scene"), str):
        raise InputError('expected a scene\'s path or an object with "scene"')
    scene = entry.pop("scene")
    name = entry.pop("name", PurePosixPath(scene.rstrip("/")).name)
    if not isinstance(name, str) or not name or PurePosixPath(name).name != name or name.startswith("."):
        raise InputError(f"'{str(name)[:60]}', expected a plain file name", where="name")
    unknown = sorted(set(entry) - {f.name for f in dataclasses.fields(Options)})
    if unknown:
        raise InputError(f"unknown {', '.join(unknown)[:80]}, expected options of `tinysplat batch`")
    values: dict[str, Any] = {}
    for key, value in entry.items():
        values |= _option(key, value)
    for key in ("like", "poses"):
        if values.get(key):
            values[key] = _placed(values[key], base)
    output = join(folder, name + SUFFIXES[task])
    return Job(name, _placed(scene, base), output, dataclasses.replace(defaults, **values), task)


def _placed(place: str, base: str) -> str:
    """A path of a manifest, which counts from `base`."""
    return place if "://" in place or place.startswith("/") or not base else join(base, place)


WORDS: dict[str, Callable[[str], Any]] = {
    "views": views,
    "size": size_or_full,
    "target_size": byte_count,
    "refine": budget,
}
"""Options that may be written as on a command line."""


def _option(key: str, value: Any) -> dict[str, Any]:
    """An entry's option as fields of `Options`: as JSON has it, or in the command line's words."""
    if isinstance(value, str) and key in WORDS:
        try:
            read = WORDS[key](value)
        except ArgumentTypeError as error:
            raise InputError(str(error), where=key) from None
        if isinstance(read, AutoViews):
            return {"views": None, "auto": read.count}
        return {key: value if key == "refine" else tuple(read) if isinstance(read, list) else read}
    if key == "refine" and value:
        refinement(value)
    if key in ("views", "size") and value is not None:
        if not isinstance(value, list) or not all(type(item) is int for item in value):
            raise InputError(f"{str(value)[:40]}, expected a list of whole numbers", where=key)
        return {key: tuple(value)}
    return {key: value}


@lru_cache(maxsize=1)
def worker_runtime(threads: int, provider: str | None = None) -> Runtime:
    """This process's runtime, which keeps graphs from job to job."""
    return Runtime(threads=threads, providers=providers(provider))
