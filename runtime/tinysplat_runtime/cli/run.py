"""Running a command line: its words to a command, and errors to one line with an exit status.

Exit status: 0 done, 2 the input is at fault (one line on standard error), 130 interrupted, 1 a fault of ours.
"""

import argparse
import contextlib
import gc
import importlib
import io
import os
import re
import signal
import sys
import threading
import warnings
from _thread import interrupt_main
from collections.abc import Callable, Iterator, Sequence
from types import FrameType
from typing import TextIO

from ..errors import InputWarning, TinySplatError
from ..system.printable import printable
from ..system.progress import still_there, wipe
from .parser import build_parser, join_commands, missing_extra

_MODULES = {"encode": "encode", "compress": "encode", "render": "render", "view": "view"}
"""Where the function of a command stands that is not in `commands`."""

_NEGATIVES = re.compile(r"-[0-9.][-+0-9.eEx]*(,[-+0-9.eE]+)*")

IMPORT_LOCKS = "<frozen importlib._bootstrap>"
"""Code that Python runs as a callback now and then: an exception there is printed and lost."""

_AGAIN_S = 0.01

_UNMAPPED = "failed to map segment"  # of a library, what the system says where memory does not suffice


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # no terminal's encoding ends a command
    with _interrupts() as noticed:
        try:
            with _warnings():
                return _run(_with_negatives(list(sys.argv[1:] if argv is None else argv)))
        except KeyboardInterrupt:
            return 130
        except Exception as error:
            if noticed:  # code on the way may have made another error of it, as C extensions do while they load
                return 130
            return _explained(error)


@contextlib.contextmanager
def _interrupts() -> Iterator[list[int]]:
    """Interrupts that came while the block ran; each raises KeyboardInterrupt as soon as that is not lost."""
    noticed: list[int] = []

    def notice(number: int, frame: FrameType | None) -> None:
        noticed.append(number)
        if frame is None or frame.f_code.co_filename != IMPORT_LOCKS:
            signal.default_int_handler(number, frame)
        again = threading.Timer(_AGAIN_S, interrupt_main)
        again.daemon = True
        again.start()

    is_ours = threading.current_thread() is threading.main_thread()
    if not is_ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield noticed
        return
    terminate = signal.getsignal(signal.SIGTERM)
    signal.signal(signal.SIGINT, notice)
    try:
        yield noticed
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, terminate)


def _explained(error: Exception) -> int:
    """An error as one line and a status; raised again where it is a fault of ours."""
    if isinstance(error, TinySplatError):
        return _fail(str(error))
    if isinstance(error, BrokenPipeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # so that the flush at exit finds no broken pipe
        return 0
    if isinstance(error, OSError):
        name = f"{error.filename}: " if error.filename else ""
        return _fail(f"{name}{error.strerror or error}")
    if isinstance(error, MemoryError) or (isinstance(error, ImportError) and _UNMAPPED in str(error)):
        return _fail("not enough memory; fewer or smaller photos or views, or fewer Gaussians, take less")
    raise error


def _with_negatives(words: list[str]) -> list[str]:
    """Values that begin with a minus sign joined to their option: argparse would take them for another.

    They are lists of numbers, and standard output with a format (`-o -.ply`).
    """
    joined: list[str] = []
    for word in words:
        option = joined[-1] if joined else ""
        if _NEGATIVES.fullmatch(word) and option.startswith("--") and "=" not in option:
            joined[-1] += f"={word}"
        elif word.startswith("-.") and option in ("-o", "--output"):
            joined[-1] = f"--output={word}"
        else:
            joined.append(word)
    return joined


def _fail(message: str) -> int:
    print(f"tinysplat: {printable(message)}", file=sys.stderr)
    return 2


def _end_like_interrupts() -> None:
    """SIGTERM, which service managers send, ends as Ctrl-C does, and ends where a shell's `&` has Ctrl-C ignored.

    Again once libraries that take it have loaded.
    """
    if threading.current_thread() is threading.main_thread():
        interrupt = signal.getsignal(signal.SIGINT)
        signal.signal(signal.SIGTERM, signal.SIG_DFL if interrupt is signal.SIG_IGN else interrupt)


@contextlib.contextmanager
def _warnings() -> Iterator[None]:
    """Ours are a line each; libraries', which are for programmers, none unless asked for."""
    with warnings.catch_warnings():
        if not sys.warnoptions:
            warnings.simplefilter("ignore")
        warnings.simplefilter("always", InputWarning)
        others, said = warnings.showwarning, set[str]()

        def show(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            if issubclass(category, InputWarning):
                if str(message) not in said:  # of a photo that is read twice
                    wipe()
                    print(message, file=sys.stderr)
                said.add(str(message))
            else:
                others(message, category, filename, lineno, file, line)

        warnings.showwarning = show
        yield


def _run(arguments: list[str]) -> int:
    word = next((word for word in arguments if not word.startswith("-")), "tinysplat")
    waits = word == "view" and not any(option.startswith("--html") for option in arguments)  # and says for what
    with still_there(word, quiet=waits or bool({"-q", "--quiet"} & set(arguments))):
        parser, commands = build_parser(word if arguments[:1] == [word] else None)
        joined = join_commands(commands, arguments)
        args = parser.parse_args(arguments)
        _end_like_interrupts()
        if args.command in joined:
            return _joined(joined[args.command], args)
        # Here, so that --version and --help start without numpy, and no command waits for what another needs.
        from .outputs import check_inputs, check_outputs

        check_inputs(args)
        check_outputs(args)
        own = importlib.import_module(f".{_MODULES.get(args.command, 'commands')}", __package__)
        run: Callable[[argparse.Namespace], None] = getattr(own, args.command)
        _collect_garbage()
        run(args)
    return 0


def _collect_garbage() -> None:
    """From here on, where it is off while modules load; what they made stays, and is not looked at again."""
    if not gc.isenabled():
        gc.freeze()
        gc.enable()


def _joined(run: Callable[[argparse.Namespace], int | None], args: argparse.Namespace) -> int:
    """Run a command of another package; what its extra brings is imported where it is needed."""
    _collect_garbage()
    try:
        return run(args) or 0
    except ImportError as error:
        if error.name is None or error.name.startswith("tinysplat"):
            raise
        raise missing_extra(args.command, error.name) from None
