"""What long work says: never silent for long, one voice at a time, nothing where quiet is asked for."""

from __future__ import annotations

import io
import re
import sys
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import ClassVar

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


def until(stream: io.StringIO, word: str, times: int) -> str:
    """What was said once a word has come so many times: machines may be slow, so nothing is timed."""
    deadline = time.monotonic() + 30
    while stream.getvalue().count(word) < times and time.monotonic() < deadline:
        time.sleep(0.01)
    return stream.getvalue()


@pytest.mark.parametrize("terminal", [False, True])
def test_a_command_speaks_where_nothing_within_it_does(said: Callable[[bool], io.StringIO], terminal: bool) -> None:
    stream, word, line = said(terminal), *((" s\r", r"(\r\d+ s\r)+") if terminal else ("encode", r"(encode: \d+ s\n)+"))
    with still_there("encode", quiet=False):
        assert re.fullmatch(line, until(stream, word, 1))
        with working("network", quiet=False):
            before = until(stream, "network", 1)
            within = until(stream, "network", 4).removeprefix(before)
    assert within.count("network") >= 3
    assert word not in within
    assert stream.getvalue().endswith("\r\033[K") is terminal


def test_progress_says_how_far_it_is_while_an_item_takes_long(said: Callable[[bool], io.StringIO]) -> None:
    stream, done = said(terminal=False), []
    for item in progress(range(3), 3, "render", quiet=False, note=lambda: f"{len(done)} drawn"):
        if item == 2:
            assert re.search(r"render: \d+ s 2/3 2 drawn\n", until(stream, " 2/3 ", 1))
        done.append(item)
    assert done == [0, 1, 2]


def test_quiet_work_is_silent(said: Callable[[bool], io.StringIO]) -> None:
    stream = said(terminal=True)
    with still_there("encode", quiet=True), working("network", quiet=True):
        assert list(progress(range(3), 3, "render", quiet=True)) == [0, 1, 2]
        time.sleep(0.25)
    assert stream.getvalue() == ""


class Bar:
    """Stands for tqdm's, and notes what it is told."""

    made: ClassVar[list[Bar]] = []

    def __init__(self, **options: object) -> None:
        self.options, self.told = options, list[object]()
        self.made.append(self)

    def __enter__(self) -> Bar:
        return self

    def __exit__(self, *_: object) -> None:
        self.told.append("closed")

    def update(self) -> None:
        self.told.append("one")

    def set_postfix_str(self, text: str, *, refresh: bool) -> None:
        self.told.append((text, refresh))

    def refresh(self) -> None:
        self.told.append("refresh")


def test_a_terminal_has_a_bar_where_tqdm_is_installed(said: Callable[[bool], io.StringIO], monkeypatch) -> None:
    stream = said(terminal=True)
    monkeypatch.setitem(sys.modules, "tqdm", SimpleNamespace(tqdm=Bar))
    monkeypatch.setattr(Bar, "made", [])
    monkeypatch.setattr(module, "TERMINAL_EVERY_S", 30)
    done: list[str] = []
    for item in progress("ab", 2, "render", quiet=False, note=lambda: f"{len(done)} drawn"):
        done.append(item)
    (bar,) = Bar.made
    assert done == ["a", "b"] and stream.getvalue() == ""
    assert bar.options == {"total": 2, "desc": "render", "delay": 1, "file": stream}
    assert bar.told == ["one", ("1 drawn", False), "one", ("2 drawn", False), "closed"]


def test_a_bar_is_drawn_anew_while_an_item_takes_long(said: Callable[[bool], io.StringIO], monkeypatch) -> None:
    said(terminal=True)
    monkeypatch.setitem(sys.modules, "tqdm", SimpleNamespace(tqdm=Bar))
    monkeypatch.setattr(Bar, "made", [])
    deadline = time.monotonic() + 30
    for _ in progress(range(1), None, "fuse", quiet=False):
        while "refresh" not in Bar.made[0].told and time.monotonic() < deadline:
            time.sleep(0.01)
    assert "refresh" in Bar.made[0].told and Bar.made[0].options["total"] is None


def test_where_nobody_knows_how_many_there_are_only_those_done_are_said(said: Callable[[bool], io.StringIO]) -> None:
    stream = said(terminal=True)
    for item in progress(range(2), None, "fuse", quiet=False, note=lambda: "busy"):
        if item == 1:
            assert re.search(r"\rfuse \d s 1 busy\033\[K", until(stream, " s 1 busy", 1))


def test_seconds_are_counted_from_the_start(said: Callable[[bool], io.StringIO], monkeypatch) -> None:
    stream, clock = said(terminal=False), [100.0]
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    with still_there("encode", quiet=False):
        clock[0] = 107.0
        assert "encode: 7 s\n" in until(stream, "7 s", 1)
        with working("network", quiet=False, note=lambda: "  of  many "):
            clock[0] = 112.0
            assert "network: 5 s of many\n" in until(stream, "5 s", 1)


def test_words_come_each_second_on_a_terminal_and_each_minute_or_so_in_a_log() -> None:
    assert module.TERMINAL_EVERY_S == 1 and 30 <= module.LOG_EVERY_S <= 60
    assert list(module.plain("abc", 3, str)) == ["a", "b", "c"]
