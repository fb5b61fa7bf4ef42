"""Bounds of a process are those asked for beyond what it holds, and never looser than those it has."""

from __future__ import annotations

import resource
import sys
from pathlib import Path

import pytest

from tinysplat_runtime.system.bounds import bound_process

HELD = 7 * resource.getpagesize()
INFINITE = resource.RLIM_INFINITY


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[int, tuple[int, int]]:
    """Limits that are set, by kind, in a process that holds seven pages and has hard limits of 10^12 or none."""
    limits: dict[int, tuple[int, int]] = {}
    hard = {resource.RLIMIT_AS: 10**12, resource.RLIMIT_CPU: INFINITE}
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (3, hard[kind]))
    monkeypatch.setattr(resource, "setrlimit", lambda kind, pair: limits.update({kind: pair}))
    monkeypatch.setattr(Path, "exists", lambda path: str(path) == "/proc/self/statm")
    monkeypatch.setattr(Path, "read_text", lambda path: "7 5 3 2 0 9 0\n")
    return limits


def test_memory_counts_beyond_what_is_held(asked: dict[int, tuple[int, int]]) -> None:
    bound_process(10**6, 20)
    assert asked == {resource.RLIMIT_AS: (HELD + 10**6, 10**12), resource.RLIMIT_CPU: (20, INFINITE)}


def test_no_bound_is_looser_than_the_one_there_is(asked: dict[int, tuple[int, int]]) -> None:
    bound_process(10**13, 20)
    assert asked[resource.RLIMIT_AS] == (10**12, 10**12)


def test_without_proc_a_process_is_taken_to_hold_a_million_pages(
    asked: dict[int, tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Path, "exists", lambda path: False)
    bound_process(10**6, 20)
    assert asked[resource.RLIMIT_AS][0] == (1 << 20) * resource.getpagesize() + 10**6


def test_systems_without_bounds_have_none(asked: dict[int, tuple[int, int]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "resource", None)
    bound_process(10**6, 20)
    assert asked == {}
