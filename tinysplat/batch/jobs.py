"""One scene of a batch: what is to be done, how a worker does it, and what came of it."""

import contextlib
import hashlib
import json
import os
import tempfile
import time
import warnings
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path, PureWindowsPath

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.container.layout import SUFFIX
from tinysplat_runtime.errors import InputError, InputWarning, TinySplatError
from tinysplat_runtime.graphs.providers import providers_of
from tinysplat_runtime.recipe.encode import encode as encode_photos
from tinysplat_runtime.recipe.report import encode_report
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.system import kinds
from tinysplat_runtime.system.files import is_plain_name
from tinysplat_runtime.system.jsonfields import JsonObject
from tinysplat_runtime.system.options import Options, flag, option
from tinysplat_runtime.system.told import Told

from .storage import join, local_folder, read, write

CODE = ("model", "provider")
"""Options that name what runs: a network's graph, a provider's library. A manifest's entry needs leave for them."""

PLACES = ("like", "poses")
"""Options that are paths or URLs."""


@dataclass(frozen=True, kw_only=True)
class Keep(Options):
    """What a batch has besides the request of a scene."""

    provider: str | None = option(
        kinds.text, metavar="NAME[:K=V,…]", help="of onnxruntime; `tinysplat doctor` lists them"
    )
    report: bool = flag(help="also write DIR/NAME.json, as encode does")
    save_gaussians: bool = flag(help="also write DIR/NAME.npz of the network")


OPTIONS = {*EncodeRequest.options(), *Keep.options(), "auto"} - {"focal", "baseline"}
"""What a manifest's entry may say of its scene; `auto` is how many views to choose."""


@dataclass(frozen=True)
class BatchJob:
    """A scene to code.

    Attributes:
        name: of the output, unique in its batch.
        request: what `encode` is asked for; its scene, poses and like are paths or URLs.
        output: path or URL of the file.
        keep: what else.
    """

    name: str
    request: EncodeRequest
    output: str
    keep: Keep = Keep()

    @property
    def scene(self) -> str:
        """Path or URL."""
        return str(self.request.scene)

    @property
    def fingerprint(self) -> str:
        """Changes with the scene's place and every option that is not left at its default."""
        said = {**self.request.given(), **self.keep.given()}
        usual = {"profile": DEFAULT_PROFILE, "qp": 0}
        text = json.dumps(
            [self.scene, {name: str(value) for name, value in said.items() if value != usual.get(name)}], sort_keys=True
        )
        return hashlib.sha256(text.encode()).hexdigest()[:16]


class _Recorder(Told):
    """Doubts are looked for, and go into the record."""

    listens = True


def encode(job: BatchJob, threads: int = 1) -> JsonObject:
    """Code a scene in this process, which keeps its graphs from job to job.

    Returns:
        The job's record: `bytes` and `sha256` of the file, `seconds`, `worker`, and a `warning` where photos and
        cameras do not seem to belong together, or some are left out.

    Raises:
        TinySplatError: the scene is at fault; another attempt would end the same way.
        OSError: storage failed; another attempt may not.
    """
    start = time.perf_counter()
    place, keep = job.output.removesuffix(SUFFIX), job.keep

    with contextlib.ExitStack() as stack:
        warned = stack.enter_context(warnings.catch_warnings(record=True))
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", InputWarning)
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="tinysplat-"))
        request = _local(job.request, lambda one: stack.enter_context(local_folder(one)))
        if keep.save_gaussians:
            request = replace(request, save_gaussians=Path(folder, "g.npz"))
        runtime = _worker_runtime(threads, keep.provider)
        coded = encode_photos(request, runtime, _Recorder(), keep=keep.report)
        if request.save_gaussians:
            write(f"{place}.npz", Path(request.save_gaussians).read_bytes())
        if keep.report:
            report = encode_report(coded, runtime, model=request.model)
            write(f"{place}.json", json.dumps(report, indent=2).encode())
    write(job.output, coded.data)
    said = dict.fromkeys([*(str(warning.message) for warning in warned), *coded.doubts])
    return {
        "bytes": len(coded.data),
        "sha256": hashlib.sha256(coded.data).hexdigest(),
        **({"warning": "; ".join(said)} if said else {}),
        "seconds": round(time.perf_counter() - start, 3),
        "worker": os.getpid(),
    }


def _local(request: EncodeRequest, local: Callable[[str], str]) -> EncodeRequest:
    """A request of paths and URLs as one of this machine's paths."""
    places: JsonObject = {name: local(str(place)) for name in PLACES if (place := getattr(request, name)) is not None}
    return replace(request, scene=local(str(request.scene)), **places)


def is_done(job: BatchJob, record: JsonObject | None) -> bool:
    """Whether a record of an earlier run stands for this job and its file is whole."""
    if not record or record.get("status") != "done" or record.get("fingerprint") != job.fingerprint:
        return False
    data = read(job.output)
    if data is None or hashlib.sha256(data).hexdigest() != record.get("sha256"):
        return False
    try:
        inspect_bytes(data)
    except TinySplatError:
        return False
    return True


def read_manifest(
    text: str, folder: str, defaults: JsonObject, base: str = "", allowed: Collection[str] = ()
) -> list[BatchJob]:
    """Jobs of a manifest: a scene per line, or per line a JSON object.

    An object has `scene`, optionally `name`, and any of the options: those of `encode` but for a stereo pair's, and
    those of `Keep`, which replace `defaults`; of those in `CODE` only what is `allowed`. Empty lines and lines that
    start with # are ignored. Relative paths count from `base`.

    Raises:
        InputError: names the line at fault.
    """
    jobs: list[BatchJob] = []
    names: dict[str, int] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            job = _job(line.strip(), folder, defaults, base, allowed)
        except InputError as error:
            raise error.within(f"line {number}") from None
        first = names.setdefault(job.name.casefold(), number)  # some file systems do not tell a from A
        if first != number:
            raise InputError(
                f"the name '{job.name}' again, first in line {first}; give one with \"name\"", where=f"line {number}"
            )
        jobs.append(job)
    if not jobs:
        raise InputError("no scenes, expected one per line")
    return jobs


def _job(line: str, folder: str, defaults: JsonObject, base: str, allowed: Collection[str]) -> BatchJob:
    entry: object = {"scene": line}
    if line.startswith("{"):
        try:
            entry = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise InputError(f"not JSON ({str(error)[:60]})") from None
    if not isinstance(entry, dict) or not isinstance(entry.get("scene"), str):
        raise InputError('expected a scene\'s path or an object with "scene"')
    scene = entry.pop("scene")
    name = entry.pop("name", PureWindowsPath(scene).name)  # which knows both separators
    if not isinstance(name, str) or not is_plain_name(name):
        raise InputError(f"'{str(name)[:60]}', expected a plain file name", where="name")
    unknown = sorted(set(entry) - OPTIONS)
    if unknown:
        raise InputError(f"unknown {', '.join(unknown)[:80]}, expected options of `tinysplat batch`")
    for word in (name for name in CODE if name in entry and name not in allowed):
        raise InputError(f"loads code, so a manifest may only give it with --allow {word}", where=word)
    return _asked(name, _placed(scene, base), {**entry, **_places(entry, base)}, defaults, folder)


def _asked(name: str, scene: str, entry: JsonObject, defaults: JsonObject, folder: str) -> BatchJob:
    """A job of an entry's options, each of which replaces the batch's, and those that it contradicts."""
    if entry.get("auto"):
        entry["views"] = f"auto:{entry['auto']}"
    entry = {name: None if value == "" else value for name, value in entry.items() if name != "auto"}
    said = [one for one in entry if one in EncodeRequest.options() and entry[one] not in (None, False)]
    contradicted = {one for one in EncodeRequest.options() for other in said if EncodeRequest.contradict(one, other)}
    values = {**{name: value for name, value in defaults.items() if name not in contradicted}, **entry}
    keep = Keep(**{one: values.pop(one) for one in Keep.options() if one in values})
    return BatchJob(name, EncodeRequest(scene, **values), join(folder, name + SUFFIX), keep)


def _places(entry: JsonObject, base: str) -> dict[str, str]:
    """The paths of an entry, counted from `base`."""
    return {name: _placed(entry[name], base) for name in PLACES if isinstance(entry.get(name), str) and entry[name]}


def _placed(place: str, base: str) -> str:
    """A path of a manifest, which counts from `base`."""
    return place if "://" in place or place.startswith("/") or not base else join(base, place)


@lru_cache(maxsize=1)
def _worker_runtime(threads: int, provider: str | None = None) -> Runtime:
    """This process's runtime, which keeps graphs from job to job."""
    return Runtime(threads=threads, providers=providers_of(provider))
