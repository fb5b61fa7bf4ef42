"""What the commands of `cli/parser.py` do: files in, files out, results on standard output."""

from __future__ import annotations

import json
from argparse import Namespace

from ..container.inspection import inspect_bytes
from ..container.layout import SUFFIX
from ..container.limits import Limits
from ..errors import InputError, within
from ..system.stopwatch import Stopwatch
from .files import read_file, write_json
from .given import writing_of
from .outputs import STANDARD


def decode(args: Namespace) -> None:
    """A .tsplat file back to Gaussians."""
    if args.output == STANDARD:
        raise InputError("- alone would be the file itself; -.ply, -.npz and so on say the format", where="-o")
    writing, watch = writing_of(args), Stopwatch()
    data = read_file(args.file)
    writing.write([("", writing.reading.decompress(args.file, data, watch))], watch)
    if args.report:
        from ..recipe.report import file_report

        described = inspect_bytes(data, is_prefix=writing.reading.is_in_part)
        write_json(args.report, file_report(described, watch))


def convert(args: Namespace) -> None:
    """Gaussian files to another format; several become one."""
    from ..formats.check import file_loss  # draws

    if args.check and args.points:
        raise InputError("given with --points, which writes no Gaussians to compare", where="--check")
    writing, watch = writing_of(args), Stopwatch()
    gaussians = writing.write([(file, writing.reading.load(file, watch)) for file in args.files], watch)
    if args.check:
        print(f"{args.output}: {file_loss(args.output, gaussians)}")


def info(args: Namespace) -> None:
    """What a file holds."""
    from .describe import describe_gaussians, gaussians_text, info_text

    if args.file != STANDARD and not args.file.lower().endswith(SUFFIX):
        about = describe_gaussians(args.file)
        print(json.dumps(about, indent=2) if args.json else gaussians_text(about))
        return
    data = read_file(args.file)
    with within(args.file):
        described = inspect_bytes(data, Limits.for_describing(args.max_pixels, args.max_memory))
    print(json.dumps(described, indent=2) if args.json else info_text(args.file, described))


def doctor(args: Namespace) -> None:
    """What is installed, and what is wrong with it; InputError where something is."""
    from .doctor import examine, text  # the standard library's packaging and mail

    if args.warm:
        from ..system.voice import Voice
        from .warm import warm

        print(f"compiled, in {warm(Voice(args.quiet))}")
        return
    from ..graphs.providers import providers_of

    report = examine(providers_of(args.provider) if args.provider else None)
    print(json.dumps(report, indent=2) if args.json else text(report))
    if report["wrong"]:
        raise InputError(f"{len(report['wrong'])} wrong, the first: {report['wrong'][0]}", where="doctor")


def models(args: Namespace) -> None:
    """The networks and graphs at hand."""
    from ..graphs.artifacts import load_manifest

    artifacts = load_manifest()
    if args.json:
        print(json.dumps({name: artifact.entry for name, artifact in artifacts.items()}, indent=2, ensure_ascii=False))
        return
    for name, artifact in artifacts.items():
        size = artifact.path.stat().st_size if artifact.path.is_file() else 0
        purpose = (artifact.entry or {}).get("purpose", "")
        print(f"{name:18} {artifact.role:10} {size / 1000:9.1f} KB  {purpose}")
