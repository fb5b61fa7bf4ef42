"""What a command line gives, as the values that commands work with: the last that knows of argparse."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

from ..container.layout import SUFFIX
from ..container.limits import Limits
from ..system.told import Told
from ..system.voice import Voice
from .files import Reading, named
from .outputs import is_standard

if TYPE_CHECKING:  # who reads a file writes none
    from ..recipe.options import Options
    from .written import Writing

Asked = TypeVar("Asked", bound="Options")


def reading_of(args: Namespace, told: Told) -> Reading:
    """How files are read."""
    default = Limits()
    limits = Limits(args.max_pixels or default.max_pixels, args.max_memory or default.max_memory_bytes)
    return Reading(args.threads, args.provider, limits, args.max_bytes, args.partial, args.model, told=told)


def voice_of(args: Namespace) -> Voice:
    """Who says what a command has to say: results to standard output, unless that is the file itself."""
    return Voice(args.quiet, not is_standard(args.output))


def asked(args: Namespace, kind: type[Asked], *what: Any, without: Collection[str] = ()) -> Asked:
    """A request of what a command line gives but for some names and groups; InputError names the option at fault."""
    known = kind.options(without=without)
    unsaid = {name: (None,) if option.off is False else (None, False) for name, option in known.items()}
    values = {name: getattr(args, name, None) for name in known}
    with named(known):
        return kind(
            *what, **{name: value for name, value in values.items() if not any(value is one for one in unsaid[name])}
        )


def writing_of(args: Namespace) -> Writing:
    """What goes out and how; InputError names the option at fault. A .tsplat file is of the quality of the one that it
    comes from, if it comes from one.
    """
    from ..recipe.request import ExportRequest
    from .written import Writing

    request, files = asked(args, ExportRequest), getattr(args, "files", None) or [args.file]
    voice = voice_of(args)
    reading = replace(reading_of(args, voice), views=request.views)
    has_quality = len(files) == 1 and files[0].lower().endswith(SUFFIX) and not reading.is_in_part
    return Writing(request, reading, files[0] if has_quality else None, args.output, voice)
