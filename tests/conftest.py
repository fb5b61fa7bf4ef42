"""Shared settings: the artifacts of this checkout, property tests that say the same thing on every run, what is said
of tests whose extra is not installed, and the world as a test wants it: memory, cores, clock, processes, network and
missing packages."""

from __future__ import annotations

import importlib.metadata
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

os.environ.setdefault("TINYSPLAT_MODELS", str(Path(__file__).resolve().parents[1] / "models"))

if "PYTEST_XDIST_WORKER" in os.environ:  # one worker per core: torch's threads would wait for each other, spinning
    os.environ.setdefault("OMP_NUM_THREADS", "1")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a shell's background job: commands under test would inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=40)
settings.load_profile("repeatable")

IMPORTED_AS = {"usd-core": "pxr", "pillow": "PIL", "scikit-image": "skimage", "mkdocs-material": "material"}
NEEDED = "TINYSPLAT_ALL_EXTRAS"
"""Set by `make test`: there, an extra that is missing is a failure."""


def missing_extra(error: BaseException) -> str | None:
    """What to install, where a test fails because a package of an extra is not there; None for other failures."""
    link: BaseException | None = error
    while link is not None:
        if isinstance(link, ModuleNotFoundError) and link.name:
            module = link.name.partition(".")[0]
            extras = [extra for extra, modules in extras_modules().items() if module in modules]
            if extras:
                return f'needs {module}: pip install "tinysplat[{extras[0]}]"'
        link = link.__cause__ or link.__context__
    return None


def extras_modules() -> dict[str, set[str]]:
    """The modules that each extra brings."""
    found: dict[str, set[str]] = {}
    for line in importlib.metadata.requires("tinysplat") or ():
        match = re.match(r"([\w-]+).*extra == ['\"](\w+)['\"]", line)
        if match and match[1] != "tinysplat":
            found.setdefault(match[2], set()).add(IMPORTED_AS.get(match[1], match[1].replace("-", "_")))
    return found


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """A file of tests that needs an extra which is not there is skipped, and says which."""
    report = yield
    call = getattr(report, "call", None)
    error = call.excinfo.value if call is not None and call.excinfo is not None else None
    why = missing_extra(error) if error is not None and NEEDED not in os.environ else None
    if report.failed and why:
        report.outcome, report.longrepr = "skipped", (str(collector.path), 0, f"Skipped: {why}")
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, object, object]:
    """The same of what a test is given."""
    return (yield from pytest_runtest_call(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """The same of a single test."""
    try:
        return (yield)
    except Exception as error:
        why = missing_extra(error) if NEEDED not in os.environ else None
        if why is None:
            raise
        pytest.skip(why)


@pytest.fixture
def free_memory(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Say what a machine has free, and what its container may take and has taken: `free_memory(300_000_000)`. Each is
    the text that Linux gives, a number of bytes, or None where the machine does not say."""
    from tinysplat_runtime.system import memory

    folder = tmp_path_factory.mktemp("memory")
    monkeypatch.setattr(memory, "MEMINFO", folder / "meminfo")
    monkeypatch.setattr(memory, "CGROUP", folder)

    def says(machine: int | str | None, limit: int | str | None = None, taken: int | str | None = None) -> None:
        if isinstance(machine, int):
            machine = f"MemTotal: 99000000 kB\nMemAvailable: {machine // 1024} kB\n"
        for name, text in (("meminfo", machine), ("memory.max", limit), ("memory.current", taken)):
            (folder / name).unlink(missing_ok=True)
            if text is not None:
                (folder / name).write_text(str(text), encoding="utf-8")

    return says


@pytest.fixture
def cores(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Say how many cores this process may use."""
    return lambda count: monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(count)), raising=False)


@pytest.fixture
def missing(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Say which packages cannot be imported: `missing("numba", "plyfile")`."""

    def packages(*names: str) -> None:
        for name in names:
            for module in [name, *(found for found in sys.modules if found.startswith(f"{name}."))]:
                monkeypatch.setitem(sys.modules, module, None)

    return packages


class Clock:
    """A clock that stands still: it goes on as it is told and when somebody sleeps, and notes how long they slept."""

    def __init__(self) -> None:
        self.now = 100.0
        self.slept: list[float] = []

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """The clock that everything reads."""
    found = Clock()
    for name in ("perf_counter", "monotonic", "time"):
        monkeypatch.setattr(time, name, found)
    monkeypatch.setattr(time, "sleep", found.sleep)
    return found


@pytest.fixture
def processes(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[..., Any]], None]:
    """Say what comes of starting a process: `processes(lambda command, **options: CompletedProcess(command, 0))`."""
    return lambda run: monkeypatch.setattr(subprocess, "run", run)


@pytest.fixture
def no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine on which whoever reaches for the network fails the test."""

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("the network was asked for")

    for name in ("socket", "create_connection", "getaddrinfo"):
        monkeypatch.setattr(socket, name, refuse)
