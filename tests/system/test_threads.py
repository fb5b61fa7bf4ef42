"""A crew of threads shares out work: every item once, results in order, errors to the caller."""

import os

import pytest

from tinysplat_runtime.system.threads import Crew, available_cores


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 2, 100])
def test_results_come_in_the_order_of_the_items(threads, count):
    done = []
    results = Crew(threads).map(lambda n: done.append(n) or n * n, range(count))
    assert results == [n * n for n in range(count)]
    assert sorted(done) == list(range(count))


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("bad", [0, 7, 49])
def test_an_error_reaches_the_caller_and_ends_the_work(threads, bad):
    begun = []

    def job(n):
        begun.append(n)
        if n == bad:
            raise ValueError(str(n))

    crew = Crew(threads)
    with pytest.raises(ValueError, match=str(bad)):
        crew.map(job, range(50))
    if threads == 1:
        assert begun == list(range(bad + 1))
    assert crew.map(str, range(3)) == ["0", "1", "2"]  # and it can work again


def test_a_job_may_share_out_work_of_its_own():
    crew = Crew(2)
    assert crew.map(lambda n: sum(crew.map(lambda m: n * m, range(4))), range(4)) == [0, 6, 12, 18]


def test_cores_are_those_that_this_process_may_use(monkeypatch):
    monkeypatch.setattr(
        os, "sched_getaffinity", lambda process: {1, 4, 6} if process == 0 else {process}, raising=False
    )
    assert available_cores() == 3
    monkeypatch.delattr(os, "sched_getaffinity")
    for count, expected in ((5, 5), (None, 1)):
        monkeypatch.setattr(os, "cpu_count", lambda count=count: count)
        assert available_cores() == expected
