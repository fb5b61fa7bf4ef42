"""The command line in this process: what a terminal would show of it, without the start of another interpreter.

    from console import fail, succeed, tinysplat

Where the process itself is the point (signals, standard input, limits, what it imports), tests start one.
"""

import contextlib
import io
import subprocess

from tinysplat_runtime.cli import main


def tinysplat(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Status, standard output and standard error of a command."""
    words = [*map(str, arguments)]
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = main(words)
        except SystemExit as leaving:  # of --help
            status = int(leaving.code or 0)
    return subprocess.CompletedProcess(words, status, *(said.buffer.getvalue().decode() for said in (out, err)))  # type: ignore[attr-defined]


def succeed(*arguments: object) -> str:
    """What a command that must succeed prints."""
    done = tinysplat(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def fail(*arguments: object) -> str:
    """The line with which a command refuses its input, at exit status 2."""
    done = tinysplat(*arguments)
    assert done.returncode == 2, (done.returncode, done.stdout, done.stderr)
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1 and "Traceback" not in done.stderr, done.stderr
    return done.stderr
