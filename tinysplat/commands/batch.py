"""`tinysplat batch`: many scenes to files, on this machine's cores or on a Ray cluster."""

import json
import sys
from argparse import ArgumentParser, Namespace
from collections import deque
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tinysplat.batch.bounds import bounded
from tinysplat.batch.cluster import run_ray
from tinysplat.batch.jobs import CODE, BatchJob, Keep, encode, read_manifest
from tinysplat.batch.run import RESULTS, Engine, run_batch
from tinysplat.batch.storage import join, read
from tinysplat.workers import Work, run_processes
from tinysplat_runtime.cli.asks import Quiet
from tinysplat_runtime.cli.options import add_options, asked
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.recipe.request import VIDEO, EncodeRequest
from tinysplat_runtime.system import kinds
from tinysplat_runtime.system.jsonfields import JsonObject
from tinysplat_runtime.system.options import REQUIRED, Options, flag, option
from tinysplat_runtime.system.printable import printable
from tinysplat_runtime.system.progress import working
from tinysplat_runtime.system.threads import available_cores

HELP = "many scenes to files, here or on a Ray cluster"


@dataclass(frozen=True, kw_only=True)
class Machines(Options, group="machines and failures"):
    """What scenes are encoded on, and what is done where that fails."""

    engine: str = option(kinds.text, "processes", choices=("processes", "ray"), help="default: processes")
    address: str | None = option(kinds.text, metavar="ADDRESS", help="a Ray cluster's; default: one of this machine")
    workers: int | None = option(kinds.count, metavar="N", help="scenes at a time; default: all cores")
    threads: int = option(kinds.count, 1, metavar="N", help="of each; default 1; changes no result")
    attempts: int = option(kinds.count, 3, metavar="N", help="per scene, if a worker dies; default 3")
    timeout: float | None = option(kinds.positive, metavar="S", help="seconds that a scene may take; default: any")
    max_memory: int | None = option(kinds.byte_count, metavar="SIZE", help="of a worker, such as 4GB; default: any")
    retry_failed: bool = flag(help="only the scenes that failed in the run before")
    json_lines: bool = flag(help="a JSON object per scene on standard output")


@dataclass(frozen=True, kw_only=True)
class Batch(Quiet, Machines):
    """What the command asks for beside what it does with each scene."""

    manifest: str = option(kinds.text, REQUIRED, is_bare=True, metavar="MANIFEST", help="")  # its description tells
    output: str = option(
        kinds.text, REQUIRED, short="o", metavar="DIR", help=f"folder or URL; {RESULTS} goes there, too"
    )
    allow: tuple[str, ...] = option(
        kinds.text, (), is_many=True, choices=CODE, help="let MANIFEST say what is loaded; repeat for both"
    )


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    parser.usage = "tinysplat batch MANIFEST -o DIR [options]"
    parser.description = (
        "Codes the scenes of MANIFEST, a path, URL or JSON object per line, to DIR/NAME.tsplat. Run again, it skips"
        " what is done and valid."
    )
    add_options(parser, Batch, EncodeRequest, Keep, without=(VIDEO,))


def run(args: Namespace) -> int:
    """Run the batch; exit status 2 where scenes failed, with their number on standard error."""
    own = asked(args, Batch)
    if own.address and own.engine != "ray":
        raise InputError("an address is for --engine ray", where="--address")
    base = own.manifest.rpartition("/")[0] or "."
    options = {**asked(args, EncodeRequest, "", without=(VIDEO,)).given(), **asked(args, Keep).given()}
    try:
        jobs = read_manifest(_manifest(own.manifest), own.output, options, base, own.allow)
    except InputError as error:
        raise error.within(own.manifest) from None
    work: Work[BatchJob, JsonObject] = partial(encode, threads=own.threads)
    if own.timeout or own.max_memory:
        work = partial(bounded, work=work, timeout=own.timeout, memory=own.max_memory)
    scheduled: JsonObject = {"work": work, "workers": own.workers or available_cores(), "attempts": own.attempts}
    engine: Engine = partial(run_processes, **scheduled)
    if own.engine == "ray":
        engine = partial(run_ray, **scheduled, address=own.address)
    said: deque[str] = deque(maxlen=1)
    with working("batch", quiet=own.quiet, note=lambda: "".join(said)):
        document = run_batch(
            jobs,
            own.output,
            engine,
            partial(_say, said, as_json=own.json_lines, quiet=own.quiet),
            only_failed=own.retry_failed,
        )
    if not own.quiet and not own.json_lines:
        place = join(own.output, RESULTS)
        print(
            f"{place}: {document['done']} of {document['of']} scenes, {document['skipped']} done before,"
            f" {document['scenes_per_second']:.2f} scenes/s"
        )
    if document["failed"]:
        failed = {name: r["error"] for name, r in document["scenes"].items() if r["status"] == "failed"}
        is_said = not (own.quiet or own.json_lines or sys.stderr.isatty())  # in a line of its own
        lines = [] if is_said else [printable(f"{name}: {error}") for name, error in failed.items()]
        count = f"tinysplat: {len(failed)} scene{'s' if len(failed) > 1 else ''} failed"
        print(count, *lines, sep=": " if len(lines) == 1 else "\n  ", file=sys.stderr)
        return 2
    return 0


def _manifest(place: str) -> str:
    """A manifest's text; InputError where it is none."""
    if Path(place).is_dir():
        fault = "a folder, expected a manifest, a file with a scene per line"
        raise InputError(f"{fault}; `tinysplat encode {place} -o F.tsplat` encodes one scene")
    data = read(place)
    if data is None:
        raise InputError("no such file")
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise InputError(f"byte {error.start} is not UTF-8, expected text with a scene per line") from None
    if "\0" in text:
        raise InputError(f"byte {data.index(0)} is 0, expected text with a scene per line")
    return text


def _say(said: deque[str], record: JsonObject, *, as_json: bool, quiet: bool) -> None:
    """A scene that ended: a JSON object, a line of a log, or on a terminal the line that says what goes on."""
    what = record.get("error") or f"{record.get('bytes', 0)} bytes, {record.get('seconds', 0):.1f} s"
    warning = f"; warning: {record['warning']}" if "warning" in record else ""
    said.append(printable(f"{record['number']}/{record['of']} {record['name']}: {what}{warning}"))
    if as_json:
        print(json.dumps(record), flush=True)
    elif not quiet and (warning or not sys.stderr.isatty()):
        print(said[-1], file=sys.stderr, flush=True)
