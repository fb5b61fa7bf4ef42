"""`tinysplat batch`: many scenes to files or measured, on this machine's cores or on a Ray cluster."""

from __future__ import annotations

import json
import sys
from argparse import ArgumentParser, Namespace
from functools import partial
from typing import Any

from tinysplat.batch.bounds import bounded
from tinysplat.batch.engines import run_processes, run_ray
from tinysplat.batch.evaluation import evaluate
from tinysplat.batch.jobs import Options, encode, read_manifest, refinement
from tinysplat.batch.run import RESULTS, Engine, failed_before, run_batch
from tinysplat.batch.storage import join, read
from tinysplat_runtime.api import DEFAULT_MODEL
from tinysplat_runtime.cli.arguments import AutoViews, byte_count, count, positive, size, views
from tinysplat_runtime.cli.parser import PROFILES
from tinysplat_runtime.codec.modes import CHOICES, DEFAULT_MODE
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.threads import available_cores

HELP = "many scenes to files, or measured, here or on a Ray cluster"


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = (
        "Codes every scene of a manifest (a path or URL per line, or JSON objects with scene, name and options) to"
        f" DIR/NAME.tsplat and keeps DIR/{RESULTS}. Run again, it skips what is done and valid."
    )
    parser.add_argument("manifest", metavar="MANIFEST", help="text file, a scene per line")
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="folder or URL (s3://, gs://, memory://)")
    parser.add_argument("--evaluate", action="store_true",
                        help="measure scenes with an eval_index.json, or Gaussian files, to DIR/NAME.json")  # fmt: skip
    parser.add_argument("--engine", choices=("processes", "ray"), default="processes", help="default: processes")
    parser.add_argument("--address", metavar="ADDRESS", help="a Ray cluster's; default: one started on this machine")
    parser.add_argument("--workers", type=count, metavar="N", help="scenes at a time; default: all cores")
    parser.add_argument("--attempts", type=count, default=3, metavar="N", help="per scene, if a worker dies; default 3")
    parser.add_argument("--timeout", type=positive, metavar="S", help="seconds that a scene may take; default: any")
    parser.add_argument("--max-memory", type=byte_count, metavar="SIZE", help="of a worker, such as 4GB; default: any")
    parser.add_argument("--retry-failed", action="store_true", help="only the scenes that failed in the run before")
    parser.add_argument("--json-lines", action="store_true", help="a JSON object per scene on standard output")
    parser.add_argument(
        "--mode", choices=CHOICES, default=DEFAULT_MODE, help=f"what files carry; default {DEFAULT_MODE}"
    )
    parser.add_argument("--target-size", type=byte_count, metavar="SIZE", help="of each file, in place of --qp")
    parser.add_argument("--target-psnr", type=float, metavar="DB", help="decoded against raw, in place of --qp")
    parser.add_argument("--lossless", action="store_true", help="float16 planes bit for bit")
    parser.add_argument("--views", type=views, metavar="I,J|auto[:N]", help="views of every scene; default: all")
    parser.add_argument("--size", type=size, metavar="HxW", help="scale photos to cover this and crop their centre")
    parser.add_argument("--near", type=float, metavar="Z", help="nearest depth, over the scenes' own")
    parser.add_argument("--far", type=float, metavar="Z", help="farthest depth, over the scenes' own")
    parser.add_argument("--model", default=DEFAULT_MODEL, metavar="NAME|FILE.onnx", help="network")
    parser.add_argument("--profile", choices=PROFILES, default="balanced", help="default: balanced")
    parser.add_argument(
        "--qp", type=float, default=0.0, metavar="Q", help="coarser by 2^(Q/6) in every step; default 0"
    )
    parser.add_argument("--refine", default="", metavar="STEPS|10s", help="refine every scene first; see encode")


def run(args: Namespace) -> int:
    """Run the batch; exit status 2 where scenes failed, with their number on standard error."""
    if args.address and args.engine != "ray":
        raise InputError("an address is for --engine ray", where="--address")
    if args.evaluate and args.views is not None:
        raise InputError("--evaluate takes the views of each scene's eval_index.json", where="--views")
    if args.refine:
        if args.evaluate:
            raise InputError("refines what is coded, and --evaluate measures networks as they are", where="--refine")
        refinement(args.refine)
    data = read(args.manifest)
    if data is None:
        raise InputError("no such file", where=args.manifest)
    chosen = args.views
    options = Options(
        views=None if chosen is None or isinstance(chosen, AutoViews) else tuple(chosen),
        auto=chosen.count if isinstance(chosen, AutoViews) else 0,
        size=args.size, near=args.near, far=args.far, model=args.model, profile=args.profile, qp=args.qp,
        refine=args.refine, mode=args.mode, target_size=args.target_size, target_psnr=args.target_psnr,
        lossless=args.lossless,
    )  # fmt: skip
    base = args.manifest.rpartition("/")[0] or "."
    try:
        task = "evaluate" if args.evaluate else "encode"
        jobs = read_manifest(data.decode("utf-8", "replace"), args.output, options, base, task)
    except InputError as error:
        raise error.within(args.manifest) from None
    if args.retry_failed:
        failed = failed_before(args.output)
        jobs = [job for job in jobs if job.name in failed]
        if not jobs:
            raise InputError("no scene of the manifest failed before", where="--retry-failed")
    document = run_batch(jobs, args.output, _engine(args), partial(_say, args))
    if not args.quiet and not args.json_lines:
        place = join(args.output, RESULTS)
        print(f"{place}: {document['done']} of {document['of']} scenes, {document['skipped']} done before,"
              f" {document['scenes_per_second']:.2f} scenes/s")  # fmt: skip
        if "means" in document:
            print(", ".join(f"{name} {value:.4g}" for name, value in document["means"].items() if value is not None))
    if document["failed"]:
        failures = [f"{name}: {r['error']}" for name, r in document["scenes"].items() if r["status"] == "failed"]
        print(f"tinysplat: {len(failures)} scenes failed, the first: {failures[0]}", *failures[1:], sep="\n  ",
              file=sys.stderr)  # fmt: skip
        return 2
    return 0


def _say(args: Namespace, record: dict[str, Any]) -> None:
    """A scene that ended: a JSON object, a line of a log, or the same line again and again on a terminal."""
    if args.json_lines:
        print(json.dumps(record), flush=True)
    elif not args.quiet:
        what = record.get("error") or f"{record.get('bytes', 0)} bytes, {record.get('seconds', 0):.1f} s"
        line = f"{record['number']}/{record['of']} {record['name']}: {what}"
        terminal = sys.stderr.isatty()
        print(f"\r\033[K{line}" if terminal else line, end="" if terminal else "\n", file=sys.stderr, flush=True)


def _engine(args: Namespace) -> Engine:
    workers = args.workers or available_cores()
    work = partial(evaluate if args.evaluate else encode, threads=args.threads or 1)
    if args.timeout or args.max_memory:
        work = partial(bounded, work=work, timeout=args.timeout, memory=args.max_memory)
    if args.engine == "ray":
        return partial(run_ray, work=work, workers=workers, attempts=args.attempts, address=args.address)
    return partial(run_processes, work=work, workers=workers, attempts=args.attempts)
