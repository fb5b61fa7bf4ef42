"""What long work says: never silent for long, one voice at a time, nothing where quiet is asked for."""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Callable

import pytest

from tinysplat_runtime.system import progress as module
from tinysplat_runtime.system.progress import progress, still_there, working


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> Callable[[bool], io.StringIO]:
    """What goes to standard error from now on, a terminal or a log, with a tenth of a second between words."""

    def begin(terminal: bool) -> io.StringIO:
        stream = Terminal() if terminal else io.StringIO()
        monkeypatch.setattr(sys, "stderr", stream)
        for name in ("LOG_EVERY_S", "TERMINAL_EVERY_S"):
            monkeypatch.setattr(module, name, 0.1)
        monkeypatch.setitem(sys.modules, "tqdm", None)
        return stream

    return begin


@pytest.mark.parametrize("terminal", [False, True])
def test_a_command_speaks_where_nothing_within_it_does(said: Callable[[bool], io.StringIO], terminal: bool) -> None:
    stream = said(terminal)
    with still_there("encode", quiet=False):
        time.sleep(0.25)
        outer = stream.getvalue()
        with working("network", quiet=False):
            time.sleep(0.25)
        inner = stream.getvalue().removeprefix(outer)
    assert inner.count("network") in (1, 2, 3)
    if terminal:
        assert outer.startswith("\r0 s\r") and "\r0 s\r" not in inner and inner.endswith("\r\033[K")
    else:
        assert outer.startswith("encode: 0 s\n") and "encode" not in inner


def test_progress_says_how_far_it_is_while_an_item_takes_long(said: Callable[[bool], io.StringIO]) -> None:
    stream, done = said(terminal=False), []
    for item in progress(range(3), 3, "render", quiet=False, note=lambda: f"{len(done)} drawn"):
        time.sleep(0.25 if item == 2 else 0)
        done.append(item)
    assert "render: 0 s 2/3 2 drawn\n" in stream.getvalue() and done == [0, 1, 2]


def test_quiet_work_is_silent(said: Callable[[bool], io.StringIO]) -> None:
    stream = said(terminal=True)
    with still_there("encode", quiet=True), working("network", quiet=True):
        assert list(progress(range(3), 3, "render", quiet=True)) == [0, 1, 2]
        time.sleep(0.25)
    assert stream.getvalue() == ""
