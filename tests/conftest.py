"""Shared settings: the artifacts of this checkout, property tests that say the same thing on every run, and what is
said of tests whose extra is not installed."""

from __future__ import annotations

import importlib.metadata
import os
import re
import signal
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings

os.environ.setdefault("TINYSPLAT_MODELS", str(Path(__file__).resolve().parents[1] / "models"))

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
