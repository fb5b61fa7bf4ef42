"""One scene of a batch: what is to be done, how a worker does it, and what came of it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import time
from argparse import ArgumentTypeError
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import PurePosixPath
from typing import Any

from tinysplat_runtime.api import DEFAULT_MODEL, Runtime
from tinysplat_runtime.cli.arguments import Budget, budget
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.viewchoice import choose_views

from .storage import join, local_folder, read, write

SUFFIXES = {"encode": ".tsplat", "evaluate": ".json"}
"""What can be done with a scene, and how the name of its output ends."""


@dataclass(frozen=True)
class Options:
    """How every scene of a batch is coded; a manifest's entry may set any of them for its scene.

    Attributes:
        views: indices, or None to take all, or `auto` of them.
        auto: how many views to choose where `views` is None and there are more; 0 takes all.
        size: (height, width) to resize photos to, or None.
        near, far: depth range over the scene's own, or None.
        model: network.
        profile: of the codec.
        qp: Q_g.
        mode: what files carry.
        target_size, target_psnr: bytes, or dB, in place of `qp`; None for neither.
        lossless: float16 planes bit for bit.
        refine: steps (`20`) or seconds (`10s`) of refinement before coding; empty for none.
    """

    views: tuple[int, ...] | None = None
    auto: int = 0
    size: tuple[int, int] | None = None
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
        for later in ("mode", "target_size", "target_psnr", "lossless", "refine"):
            if options[later] == getattr(Options(), later):
                del options[later]  # as it was before there was such an option: what was done then is not done again
        text = json.dumps([self.task, self.scene, options], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def encode(job: Job, threads: int = 1) -> dict[str, Any]:
    """Code a scene in this process, which keeps its graphs from job to job.

    Returns:
        The job's record: `bytes` and `sha256` of the file, `seconds`, `worker`.

    Raises:
        TinySplatError: the scene is at fault; another attempt would end the same way.
        OSError: storage failed; another attempt may not.
    """
    start = time.perf_counter()
    options, runtime = job.options, worker_runtime(threads)
    with local_folder(job.scene) as folder:
        scene = load_scene(folder, near=options.near, far=options.far)
        if options.views is not None:
            scene = scene.views(options.views)
        elif options.auto and len(scene.frames) > options.auto:
            scene = scene.views(choose_views(scene.cameras, *scene.depth_range(), options.auto))
        if options.size is not None:
            scene = scene.resized(*options.size)
        gaussians = runtime.predict(scene, options.model)
        if options.refine:
            asked = refinement(options.refine)
            gaussians = runtime.refine(
                gaussians, scene, asked.steps, seconds=asked.seconds, profile=options.profile, qp=options.qp
            )
        wanted = {name: getattr(options, name) for name in ("target_size", "target_psnr", "lossless")}
        qp = None if any(wanted.values()) else options.qp
        data = runtime.encode(
            scene, options.model, options.profile, qp, mode=options.mode, gaussians=gaussians, **wanted
        )
    write(job.output, data)
    return {
        "bytes": len(data),
        "sha256": hashlib.sha256(data).hexdigest(),
        "seconds": round(time.perf_counter() - start, 3),
        "worker": os.getpid(),
    }


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
    values: dict[str, Any] = {
        key: _tuple(key, value) if key in ("views", "size") else value for key, value in entry.items()
    }
    if values.get("refine"):
        refinement(values["refine"])
    place = scene if "://" in scene or scene.startswith("/") or not base else join(base, scene)
    return Job(name, place, join(folder, name + SUFFIXES[task]), dataclasses.replace(defaults, **values), task)


def _tuple(key: str, value: Sequence[int] | None) -> tuple[int, ...] | None:
    if value is None:
        return None
    if not isinstance(value, list) or not all(type(item) is int for item in value):
        raise InputError(f"{str(value)[:40]}, expected a list of whole numbers", where=key)
    return tuple(value)


@lru_cache(maxsize=1)
def worker_runtime(threads: int) -> Runtime:
    """This process's runtime, which keeps graphs from job to job."""
    return Runtime(threads=threads)
