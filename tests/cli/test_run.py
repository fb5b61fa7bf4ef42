"""How commands end: by signals wherever they were started, and on outputs of any encoding."""

from __future__ import annotations

import io
import signal
import subprocess
import sys
import weakref
from collections.abc import Iterator

import pytest

from tinysplat_runtime.cli import commands, main
from tinysplat_runtime.cli.run import _IMPORT_LOCKS
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.lenses import load_pycolmap


@pytest.fixture
def handlers() -> Iterator[None]:
    """Handlers as they were, after the test."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize(("interrupt", "ends"), [(signal.SIG_IGN, True), (signal.default_int_handler, False)])
def test_sigterm_ends_a_command_where_a_shell_has_interrupts_ignored(monkeypatch, handlers, interrupt, ends) -> None:
    found = []
    monkeypatch.setattr(commands, "models", lambda _: found.append(signal.getsignal(signal.SIGTERM)))
    signal.signal(signal.SIGINT, interrupt)
    assert main(["models", "-q"]) == 0
    assert (found == [signal.SIG_DFL]) is ends and found != [signal.SIG_IGN]


def test_an_interrupt_that_a_callback_would_lose_comes_again(monkeypatch, capsys, handlers) -> None:
    """Python releases import locks in a callback, whose exceptions it prints and drops."""
    source = "def released(_):\n    signal.raise_signal(signal.SIGINT)\n    return 0\n"
    names = {"signal": signal}
    exec(compile(source, _IMPORT_LOCKS, "exec"), names)

    class Lock:
        pass

    def interrupted(_: object) -> None:
        lock = Lock()
        reference = weakref.ref(lock, names["released"])
        del lock
        assert reference() is None
        while True:  # until the interrupt comes
            pass

    monkeypatch.setattr(commands, "models", interrupted)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    assert main(["models", "-q"]) == 130
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
def test_what_an_output_cannot_encode_is_escaped(monkeypatch, encoding) -> None:
    def fails(_: object) -> None:
        print("σ² → 0.3")
        raise InputError("'Łódź', expected another name", where="city")

    out, err = io.BytesIO(), io.BytesIO()
    monkeypatch.setattr(commands, "models", fails)
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(out, encoding, write_through=True))
    monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(err, encoding, write_through=True))
    assert main(["models", "-q"]) == 2
    assert b"0.3" in out.getvalue() and b"city: '\\u0141" in err.getvalue()


def test_pycolmap_takes_no_signals() -> None:
    """What it takes for its dump of stacks is as before once it has loaded; in a process of its own, which ends."""
    code = f"""
import signal
from {load_pycolmap.__module__} import load_pycolmap
signal.signal(signal.SIGTERM, lambda *_: print("ended", flush=True))
load_pycolmap()
signal.raise_signal(signal.SIGTERM)
signal.raise_signal(signal.SIGABRT)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr, done.returncode) == ("ended\n", "", -signal.SIGABRT)
