"""A batch from manifest to results: skip what is done, run the rest, keep `results.json` true all along."""

import json
import time
from collections.abc import Callable, Iterator, Sequence

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.jsonfields import JsonObject

from ..workers import Outcome
from .jobs import BatchJob, is_done
from .storage import join, read, write

RESULTS = "results.json"

WRITE_EVERY_S = 2.0
"""The results are rewritten at most this often, and at the end; what is lost with them is coded again on resume."""

Engine = Callable[[Sequence[BatchJob]], Iterator[Outcome[BatchJob, JsonObject]]]


def run_batch(
    jobs: Sequence[BatchJob],
    folder: str,
    engine: Engine,
    progress: Callable[[JsonObject], None],
    *,
    only_failed: bool = False,
) -> JsonObject:
    """Run what is not done yet.

    Args:
        jobs: all of the batch.
        folder: where outputs and results go, path or URL.
        engine: runs jobs and yields outcomes as they come.
        progress: takes each scene's record as it ends, with its name and number.
        only_failed: run only those that an earlier run says failed; what it says of others stays.

    Returns:
        What `results.json` holds: `scenes` by name with `status` (done, failed), `output`, `bytes`, `sha256`,
        `seconds`, `attempts`, `error`; and `done`, `failed`, `skipped`, `scenes_per_second` of this run.

    Raises:
        InputError: `only_failed`, and none did; results that are none.
    """
    place = join(folder, RESULTS)
    earlier = _earlier(place)
    records = {job.name: earlier[job.name] for job in jobs if is_done(job, earlier.get(job.name))}
    skipped, left = len(records), [job for job in jobs if job.name not in records]
    if only_failed:
        left = [job for job in left if earlier.get(job.name, {}).get("status") == "failed"]
        if not left:
            raise InputError("no scene of the manifest failed before", where="--retry-failed")
    start = written = time.perf_counter()
    finished = 0
    try:
        for outcome in engine(left) if left else ():
            record = records[outcome.job.name] = _record(outcome)
            finished += 1
            now = time.perf_counter()
            if now - written >= WRITE_EVERY_S:
                write(place, _document(jobs, records, skipped, finished / (now - start)))
                written = now
            number, of = (finished, len(left)) if only_failed else (skipped + finished, len(jobs))
            progress({"name": outcome.job.name, "number": number, "of": of, **record})
    finally:  # what is done is known after an interrupt, too
        data = _document(jobs, records, skipped, finished / max(time.perf_counter() - start, 1e-9))
        write(place, data)
    return dict(json.loads(data))


def _earlier(place: str) -> JsonObject:
    data = read(place)
    if data is None:
        return {}
    try:
        scenes = json.loads(data)["scenes"]
    except (ValueError, KeyError, TypeError):
        raise InputError("not a batch's results; move it away to begin anew", where=place) from None
    return scenes if isinstance(scenes, dict) else {}


def _record(outcome: Outcome[BatchJob, JsonObject]) -> JsonObject:
    job = outcome.job
    record = {"status": "failed" if outcome.error else "done", "scene": job.scene, "output": job.output}
    extra = {"error": outcome.error} if outcome.error else (outcome.record or {})
    return {**record, **extra, "attempts": outcome.attempts, "fingerprint": job.fingerprint}


def _document(jobs: Sequence[BatchJob], records: JsonObject, skipped: int, rate: float) -> bytes:
    ordered = {job.name: records[job.name] for job in jobs if job.name in records}
    states = [record["status"] for record in ordered.values()]
    totals: JsonObject = {"done": states.count("done"), "failed": states.count("failed"), "skipped": skipped}
    document = {**totals, "of": len(jobs), "scenes_per_second": round(rate, 3), "scenes": ordered}
    return (json.dumps(document, indent=1) + "\n").encode()
