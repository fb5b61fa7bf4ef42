"""What the commands of `cli/parser.py` do: files in, files out, results on standard output."""

import json
from argparse import Namespace

from ..container.inspection import inspect_bytes
from ..container.layout import SUFFIX
from ..container.limits import Limits
from ..errors import InputError, within
from ..system.stopwatch import Stopwatch
from .asks import Convert, Decode, Doctor, Info, Models
from .files import Reading, read_file, write_json
from .options import asked
from .outputs import STANDARD
from .parser import OF_CONVERT


def decode(args: Namespace) -> None:
    """A .tsplat file back to Gaussians."""
    from ..recipe.request import ExportRequest
    from .written import write_gaussians

    own, reading = asked(args, Decode), asked(args, Reading)
    request = asked(args, ExportRequest, without=OF_CONVERT)
    if own.output == STANDARD:
        raise InputError("- alone would be the file itself; -.ply, -.npz and so on say the format", where="-o")
    runtime, watch, data = reading.runtime(own.voice), Stopwatch(), read_file(own.file)
    gaussians = reading.decompress(own.file, data, runtime, watch, request.views)
    write_gaussians(own, [("", gaussians)], request, runtime, watch, source=None if reading.is_in_part else own.file)
    if own.report:
        from ..recipe.report import file_report

        write_json(own.report, file_report(inspect_bytes(data, is_prefix=reading.is_in_part), watch))


def convert(args: Namespace) -> None:
    """Gaussian files to another format; several become one."""
    from ..formats.check import file_loss  # draws
    from ..recipe.request import ExportRequest
    from .written import write_gaussians

    own, request, reading = asked(args, Convert), asked(args, ExportRequest), asked(args, Reading)
    if own.check and request.points:
        raise InputError("given with --points, which writes no Gaussians to compare", where="--check")
    runtime, watch = reading.runtime(own.voice), Stopwatch()
    parts = [(file, reading.load(file, runtime, watch, views=request.views)) for file in own.files]
    source = None if reading.is_in_part or len(parts) > 1 else own.files[0]
    gaussians = write_gaussians(own, parts, request, runtime, watch, source=source)
    if own.check:
        print(f"{own.output}: {file_loss(own.output, gaussians)}")


def info(args: Namespace) -> None:
    """What a file holds."""
    from .describe import describe_gaussians, gaussians_text, info_text

    own = asked(args, Info)
    if own.file != STANDARD and not own.file.lower().endswith(SUFFIX):
        about = describe_gaussians(own.file)
        print(json.dumps(about, indent=2) if own.json else gaussians_text(about))
        return
    data = read_file(own.file)
    with within(own.file):
        described = inspect_bytes(data, Limits.for_describing(own.max_pixels, own.max_memory))
    print(json.dumps(described, indent=2) if own.json else info_text(own.file, described))


def doctor(args: Namespace) -> None:
    """What is installed, and what is wrong with it; InputError where something is."""
    from .doctor import examine, text  # the standard library's packaging and mail

    own = asked(args, Doctor)
    if own.warm:
        from .warm import warm

        print(f"compiled, in {warm(own.voice)}")
        return
    from ..graphs.providers import providers_of

    report = examine(providers_of(own.provider) if own.provider else None)
    print(json.dumps(report, indent=2) if own.json else text(report))
    if report["wrong"]:
        raise InputError(f"{len(report['wrong'])} wrong, the first: {report['wrong'][0]}", where="doctor")


def models(args: Namespace) -> None:
    """The networks and graphs at hand."""
    from ..graphs.artifacts import load_manifest

    artifacts = load_manifest()
    if asked(args, Models).json:
        print(json.dumps({name: artifact.entry for name, artifact in artifacts.items()}, indent=2, ensure_ascii=False))
        return
    for name, artifact in artifacts.items():
        size = artifact.path.stat().st_size if artifact.path.is_file() else 0
        purpose = (artifact.entry or {}).get("purpose", "")
        print(f"{name:18} {artifact.role:10} {size / 1000:9.1f} KB  {purpose}")
