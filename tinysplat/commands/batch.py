"""`tinysplat batch`: many scenes to files, on this machine's cores or on a Ray cluster."""

from __future__ import annotations

import json
import sys
from argparse import SUPPRESS, ArgumentParser, Namespace
from collections import deque
from functools import partial
from pathlib import Path

from tinysplat.batch.bounds import bounded
from tinysplat.batch.cluster import run_ray
from tinysplat.batch.jobs import CODE, Keep, encode, read_manifest
from tinysplat.batch.run import RESULTS, Engine, run_batch
from tinysplat.batch.storage import join, read
from tinysplat.workers import Work, run_processes
from tinysplat_runtime.cli.arguments import byte_count, count, positive
from tinysplat_runtime.cli.given import asked
from tinysplat_runtime.cli.options import add_options, add_threads
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.recipe.request import VIDEO, EncodeRequest
from tinysplat_runtime.system.jsonfields import JsonObject
from tinysplat_runtime.system.printable import printable
from tinysplat_runtime.system.progress import working
from tinysplat_runtime.system.threads import available_cores

HELP = "many scenes to files, here or on a Ray cluster"


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    parser.usage = "tinysplat batch MANIFEST -o DIR [options]"
    parser.description = (
        "Codes the scenes of MANIFEST, a path, URL or JSON object per line, to DIR/NAME.tsplat. Run again, it skips"
        " what is done and valid."
    )
    parser.add_argument("manifest", metavar="MANIFEST", help=SUPPRESS)  # the lines above tell what it is
    parser.add_argument(
        "-o", "--output", required=True, metavar="DIR", help=f"folder or URL; {RESULTS} goes there, too"
    )
    machines = parser.add_argument_group("machines and failures")
    machines.add_argument("--engine", choices=("processes", "ray"), default="processes", help="default: processes")
    machines.add_argument("--address", metavar="ADDRESS", help="a Ray cluster's; default: one of this machine")
    machines.add_argument("--workers", type=count, metavar="N", help="scenes at a time; default: all cores")
    machines.add_argument(
        "--attempts", type=count, default=3, metavar="N", help="per scene, if a worker dies; default 3"
    )
    machines.add_argument("--timeout", type=positive, metavar="S", help="seconds that a scene may take; default: any")
    machines.add_argument(
        "--max-memory", type=byte_count, metavar="SIZE", help="of a worker, such as 4GB; default: any"
    )
    machines.add_argument("--retry-failed", action="store_true", help="only the scenes that failed in the run before")
    machines.add_argument("--json-lines", action="store_true", help="a JSON object per scene on standard output")
    add_threads(machines)
    add_options(parser, EncodeRequest, without=(VIDEO,))
    add_options(parser, Keep)
    parser.add_argument(
        "--allow", action="append", choices=CODE, default=[], help="let MANIFEST say what is loaded; repeat for both"
    )


def run(args: Namespace) -> int:
    """Run the batch; exit status 2 where scenes failed, with their number on standard error."""
    if args.address and args.engine != "ray":
        raise InputError("an address is for --engine ray", where="--address")
    base = args.manifest.rpartition("/")[0] or "."
    try:
        options = {**asked(args, EncodeRequest, "", without=(VIDEO,)).given(), **asked(args, Keep).given()}
        jobs = read_manifest(_manifest(args.manifest), args.output, options, base, args.allow)
    except InputError as error:
        raise error.within(args.manifest) from None
    work: Work = partial(encode, threads=args.threads or 1)
    if args.timeout or args.max_memory:
        work = partial(bounded, work=work, timeout=args.timeout, memory=args.max_memory)
    scheduled = {"work": work, "workers": args.workers or available_cores(), "attempts": args.attempts}
    engine: Engine = partial(run_processes, **scheduled)
    if args.engine == "ray":
        engine = partial(run_ray, **scheduled, address=args.address)
    said: deque[str] = deque(maxlen=1)
    with working("batch", quiet=args.quiet, note=lambda: "".join(said)):
        document = run_batch(
            jobs,
            args.output,
            engine,
            partial(_say, said, as_json=args.json_lines, quiet=args.quiet),
            only_failed=args.retry_failed,
        )
    if not args.quiet and not args.json_lines:
        place = join(args.output, RESULTS)
        print(
            f"{place}: {document['done']} of {document['of']} scenes, {document['skipped']} done before,"
            f" {document['scenes_per_second']:.2f} scenes/s"
        )
    if document["failed"]:
        failed = {name: r["error"] for name, r in document["scenes"].items() if r["status"] == "failed"}
        is_said = not (args.quiet or args.json_lines or sys.stderr.isatty())  # in a line of its own
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
