"""Many windows: what is already measured, the rest spread over processes, what fails left out with its reason."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.system.progress import progress

from ..children import settle_worker, starting_workers
from ..measure.lpips import LpipsFiles
from .measure import PictureMetric, measure_coding, prepare
from .records import Key, Record, ResultStore, code_fingerprint, model_fingerprint
from .scene_index import Window
from .sources import LeftOut, Source


@dataclass(frozen=True)
class Coding:
    """A profile at a Q_g."""

    profile: str
    qp: float


@dataclass(frozen=True)
class Plan:
    """What to measure.

    Attributes:
        sources: scenes.
        models: networks; ignored for Gaussian files.
        codings: each is done for every window.
        size: (height, width) of evaluation; Gaussian files keep their own.
        kinds: kinds of window wanted; empty for all.
        views: numbers of context views wanted; empty for all.
        limit: windows per scene, or None for all.
    """

    sources: Sequence[Source]
    models: Sequence[str]
    codings: Sequence[Coding]
    size: tuple[int, int] = (256, 256)
    kinds: Sequence[str] = ()
    views: Sequence[int] = ()
    limit: int | None = None


@dataclass(frozen=True)
class Settings:
    """How to measure.

    Attributes:
        folder: where results are kept.
        lpips: weights, or None.
        pictures: keep PNG files of the target pictures.
        threads: of each process.
        processes: how many windows are measured at a time.
    """

    folder: Path
    lpips: LpipsFiles | None = None
    pictures: bool = False
    threads: int = 1
    processes: int = 1


@dataclass(frozen=True)
class Job:
    """A window and a model, and the codings of it that are not measured yet."""

    source: Source
    window: Window
    model: str
    size: tuple[int, int]
    codings: tuple[Coding, ...]

    def __str__(self) -> str:
        return f"{self.source.name} {self.window}, {self.model}"


@dataclass(frozen=True)
class Outcome:
    """Results in the plan's order.

    Attributes:
        records: one per window, model and coding.
        left_out: windows and scenes that could not be measured.
        notes: what is no fault but worth a line, such as scenes without windows of the wanted kind.
        resumed: how many of the records were there before.
    """

    records: list[Record]
    left_out: list[LeftOut]
    notes: list[str]
    resumed: int


def evaluate(plan: Plan, settings: Settings, *, quiet: bool = True, runtime: Runtime | None = None) -> Outcome:
    """Measure what a plan asks for, keeping what is already there.

    Args:
        plan: what.
        settings: how.
        quiet: show no progress bar.
        runtime: whose opened graphs to use where one process measures; None for an own one.

    Raises:
        InputError: the folder is none.
        ModelError: there is no such network, or it breaks its contract.
    """
    jobs, left_out, notes = list_jobs(plan)
    if any(job.source.needs_network for job in jobs):
        for model in plan.models:
            (runtime or Runtime(threads=1)).store.network(model)  # a wrong model is one error, not one per window
    worker = _Worker(settings, runtime)
    found = {(job, coding): record for job in jobs for coding, record in worker.known(job).items()}
    resumed = len(found)
    pending = [(job, tuple(c for c in job.codings if (job, c) not in found)) for job in jobs]
    pending = [(job, codings) for job, codings in pending if codings]
    failed: dict[Job, LeftOut] = {}
    for job, result in progress(_results(worker, settings, pending), len(pending), "windows", quiet=quiet):
        if isinstance(result, LeftOut):
            failed[job] = result
        else:
            found.update({(job, coding): record for coding, record in result.items()})
    left_out += [failed[job] for job in jobs if job in failed]
    return Outcome([found[pair] for pair in _pairs(jobs) if pair in found], left_out, notes, resumed)


def _pairs(jobs: Iterable[Job]) -> Iterator[tuple[Job, Coding]]:
    return ((job, coding) for job in jobs for coding in job.codings)


def list_jobs(plan: Plan) -> tuple[list[Job], list[LeftOut], list[str]]:
    """Jobs of a plan, windows and scenes whose index is at fault, and notes."""
    jobs: list[Job] = []
    left_out: list[LeftOut] = []
    notes: list[str] = []
    for source in plan.sources:
        try:
            windows, lost = source.windows()
        except TinySplatError as error:
            left_out.append(LeftOut(source.name, str(error)))
            continue
        left_out += lost
        chosen = [window for window in windows if _is_wanted(window, plan)][: plan.limit]
        if windows and not chosen:
            have = ", ".join(sorted({f"{w.kind} with {len(w.context)} views" for w in windows}))
            notes.append(f"{source.name}: no window of the wanted kind and number of views; it has {have}")
        models = plan.models if source.needs_network else (source.name,)
        jobs += [Job(source, w, model, plan.size, tuple(plan.codings)) for model in models for w in chosen]
    return jobs, left_out, notes


def _is_wanted(window: Window, plan: Plan) -> bool:
    kind_fits = not plan.kinds or window.kind in plan.kinds or window.kind == "file"
    return kind_fits and (not plan.views or len(window.context) in plan.views)


Pending = tuple[Job, tuple[Coding, ...]]
Result = dict[Coding, Record] | LeftOut


def _results(worker: _Worker, settings: Settings, pending: Sequence[Pending]) -> Iterator[tuple[Job, Result]]:
    """Results as they come; in this process if there is but one."""
    if settings.processes == 1 or len(pending) < 2:
        for job, codings in pending:
            yield job, worker.run(job, codings)
        return
    context = multiprocessing.get_context("spawn")
    count = min(settings.processes, len(pending))
    with ProcessPoolExecutor(count, context, initializer=_start_worker, initargs=(settings,)) as pool:
        with starting_workers():
            futures = {pool.submit(_run_in_worker, job, codings): job for job, codings in pending}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BrokenProcessPool:
            raise TinySplatError(
                "a process was killed, perhaps for want of memory; the same command goes on where it stopped,"
                " with fewer --jobs in less memory",
                where="eval",
            ) from None
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


class _Worker:
    """Measures jobs in one process; graphs and weights stay loaded."""

    def __init__(self, settings: Settings, runtime: Runtime | None = None) -> None:
        self._settings = settings
        self._store = ResultStore(settings.folder)
        self._runtime = runtime or Runtime(threads=settings.threads)
        self._lpips: PictureMetric | None = None

    def known(self, job: Job) -> dict[Coding, Record]:
        """Records of earlier runs."""
        keys = self._keys(job)
        loaded = {c: self._store.load(key, with_pictures=self._settings.pictures) for c, key in keys.items()}
        return {coding: record for coding, record in loaded.items() if record is not None}

    def _keys(self, job: Job) -> dict[Coding, Key]:
        model = model_fingerprint(job.model) if job.source.needs_network else ""
        try:
            source = job.source.fingerprint(job.window)
        except (TinySplatError, OSError):
            source = ""  # the fault of the job, which will say so when it runs
        lpips = str(self._settings.lpips) if self._settings.lpips else ""
        window = job.window
        return {
            coding: Key(
                job.source.name, window.kind, window.context, window.targets, f"{job.model} {model}",
                coding.profile, coding.qp, job.size, lpips, source, code_fingerprint(),
            )
            for coding in job.codings
        }  # fmt: skip

    def run(self, job: Job, codings: Iterable[Coding]) -> Result:
        """Measure and keep one window's codings."""
        try:
            return dict(self._measured(job, codings))
        except (TinySplatError, OSError) as error:
            return LeftOut(str(job), str(error))
        except MemoryError:
            return LeftOut(str(job), "not enough memory; a smaller --size or fewer --jobs need less")

    def _measured(self, job: Job, codings: Iterable[Coding]) -> Iterator[tuple[Coding, Record]]:
        lpips = self._load_lpips()
        prepared = prepare(job.source.load(job.window, job.model, job.size, self._runtime), self._runtime, lpips)
        camera, keys = prepared.case.cameras[0], self._keys(job)
        for coding in codings:
            key = keys[coding]
            pictures = self._store.picture_folder(key) if self._settings.pictures else None
            fields = measure_coding(prepared, coding.profile, coding.qp, self._runtime, lpips=lpips, pictures=pictures)
            missing = dict.fromkeys(("psnr_raw", "psnr", "ssim_raw", "ssim", "lpips"))
            record = Record(
                scene=job.source.name, kind=job.window.kind, model=job.model, profile=coding.profile, qp=coding.qp,
                height=camera.height, width=camera.width, views=len(job.window.context), context=job.window.context,
                targets=job.window.targets, pictures=pictures.name if pictures else None, **{**missing, **fields},
            )  # fmt: skip
            self._store.save(key, record)
            yield coding, record

    def _load_lpips(self) -> PictureMetric | None:
        if self._settings.lpips is not None and self._lpips is None:
            import torch

            from ..measure.lpips import Lpips

            torch.set_num_threads(self._settings.threads)
            self._lpips = Lpips(self._settings.lpips)
        return self._lpips


_worker: _Worker | None = None


def _start_worker(settings: Settings) -> None:
    """Set up a process of the pool: it dies with its parent, and at once when interrupted; records are never torn."""
    global _worker
    settle_worker()
    _worker = _Worker(settings)


def _run_in_worker(job: Job, codings: tuple[Coding, ...]) -> Result:
    assert _worker is not None
    return _worker.run(job, codings)
