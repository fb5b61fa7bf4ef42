"""What long work says: never silent for long, one voice at a time, nothing where quiet is asked for."""

import io
import re
import sys
import threading
import time
from collections.abc import Callable

import pytest
from scenes import tells

from tinysplat_runtime.system.progress import compiling, running, still_there, working
from tinysplat_runtime.system.voice import Voice


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> Callable[[bool], io.StringIO]:
    """What goes to standard error from now on, a terminal or a log; no wait is longer than 0.1 s."""
    wait = threading.Event.wait

    def begin(terminal: bool) -> io.StringIO:
        stream = Terminal() if terminal else io.StringIO()
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setattr(
            threading.Event, "wait", lambda event, seconds=None: wait(event, seconds and min(seconds, 0.1))
        )
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
    """A terminal's line is begun anew each time, and nothing of it remains."""
    stream = said(terminal)
    with still_there("encode", quiet=False):
        assert re.search(r"\d", until(stream, "\r" if terminal else "encode", 2))
        with working("network", quiet=False):
            before = until(stream, "network", 1)
            within = until(stream, "network", 4).removeprefix(before)
    assert within.count("network") >= 3 and "encode" not in within
    assert ("\n" in within) is not terminal and ("\r" in within) is terminal
    assert (stream.getvalue().rpartition("\r")[2].replace("\033[K", "").strip() == "") is terminal


def test_progress_says_how_far_it_is_while_an_item_takes_long(said: Callable[[bool], io.StringIO]) -> None:
    stream, done = said(terminal=False), []
    for item in Voice().progress("render", range(3), lambda: f"{len(done)} drawn"):
        if item == 2:
            assert tells(until(stream, "2 drawn", 1), "render: 2 of 3")
        done.append(item)
    assert done == [0, 1, 2]


def test_quiet_work_is_silent(said: Callable[[bool], io.StringIO]) -> None:
    stream = said(terminal=True)
    with still_there("encode", quiet=True), working("network", quiet=True):
        assert list(Voice(quiet=True).progress("render", range(3))) == [0, 1, 2]
        time.sleep(0.25)
    assert stream.getvalue() == ""


def test_compiling_is_said_and_not_taken_for_work(said: Callable[[bool], io.StringIO]) -> None:
    stream = said(terminal=False)
    with working("network", quiet=False):
        begun = running()
        compiling.begin()
        assert tells(until(stream, "compiling", 1), "compiling once: 0 s")
        time.sleep(0.05)
        assert running() - begun < 0.04
        compiling.end()


def test_a_block_within_another_is_said_beside_it(said: Callable[[bool], io.StringIO]) -> None:
    stream = said(terminal=False)
    with still_there("compress", quiet=False):
        voice = Voice()
        for _ in voice.progress("blocks", range(2)):
            for _ in voice.progress("pruning", range(3)):
                assert "blocks: 0 of 2; pruning: 0 of 3" in until(stream, "pruning", 1)
                break
            break
