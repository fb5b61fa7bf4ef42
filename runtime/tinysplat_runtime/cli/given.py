"""What a command line gives, as the values that commands work with: the last that knows of argparse."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from ..container.layout import SUFFIX
from ..container.records import Limits
from ..gaussian.notes import OPTIONS
from .files import Reading, Voice, named

if TYPE_CHECKING:  # who reads a file asks for no coding
    from ..recipe.request import Coding, EncodeRequest
    from .written import Writing


def reading_of(args: Namespace) -> Reading:
    """How files are read."""
    default = Limits()
    limits = Limits(args.max_pixels or default.max_pixels, args.max_memory or default.max_memory_bytes)
    return Reading(args.threads, args.provider, limits, args.max_bytes, args.partial, args.model)


def voice_of(args: Namespace) -> Voice:
    """Who says what a command has to say."""
    return Voice(args.output, args.quiet)


def notes_of(args: Namespace) -> dict[str, str]:
    """What is said of the Gaussians, by name; an empty text takes back what they said of themselves."""
    return {name: getattr(args, name) for name in OPTIONS if getattr(args, name) is not None}


def writing_of(args: Namespace) -> Writing:
    """What goes out and how; InputError names the option at fault. A .tsplat file is of the quality of the one that it
    comes from, if it comes from one.
    """
    from ..recipe.export import ExportRequest
    from .written import Writing

    notes, known = notes_of(args), (one.name for one in fields(ExportRequest))
    with named((*ExportRequest.__annotations__, *notes)):
        request = ExportRequest.of(**given(args, known), **notes)
    reading, files = reading_of(args), getattr(args, "files", None) or [args.file]
    has_quality = len(files) == 1 and files[0].lower().endswith(SUFFIX) and not reading.is_in_part
    return Writing(request, reading, files[0] if has_quality else None, voice_of(args))


def given(args: Namespace, names: Iterable[str]) -> dict[str, Any]:
    """Those of some options that a command line gives, by name."""
    values = {name: getattr(args, name, None) for name in names}
    return {name: value for name, value in values.items() if value is not None and value is not False}


def coding_of(args: Namespace) -> Coding:
    """How `compress` is to code; InputError names the option at fault."""
    from ..recipe.request import ENCODE_OPTIONS, Coding

    with named(ENCODE_OPTIONS):
        return Coding(**given(args, (one.name for one in fields(Coding))))


def request_of(args: Namespace) -> EncodeRequest:
    """What `encode` is to do; InputError names the option at fault."""
    from ..recipe.request import ENCODE_OPTIONS, EncodeRequest

    with named(ENCODE_OPTIONS):
        return EncodeRequest.of(args.scene, **given(args, ENCODE_OPTIONS))
