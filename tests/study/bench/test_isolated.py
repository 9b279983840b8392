"""Work in processes of its own: what it hands over, and how it may end."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator

import pytest

import acausal
from acausal.errors import IntegrationError
from acausal.models.oscillator import Oscillator
from acausal.study.bench.case import Case
from acausal.study.bench.isolated import isolated
from acausal.study.bench.measure import Task, measured

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")


def test_the_last_value_counts() -> None:
    outcome = isolated(lambda: iter([1, 2, list(range(100_000))]), 10.0)
    assert outcome.value == list(range(100_000))
    assert outcome.failure == ""


def test_work_without_end_is_ended() -> None:
    def work() -> Iterator[int]:
        while True:
            time.sleep(1.0)
        yield 1

    began = time.perf_counter()
    outcome = isolated(work, 0.2)
    assert time.perf_counter() - began < 5.0
    assert outcome.value is None
    assert outcome.failure == "no end after 0.2 s"


@pytest.mark.slow
def test_a_value_before_the_end_of_time_is_kept() -> None:
    def work() -> Iterator[int]:
        yield 1
        time.sleep(60.0)

    assert isolated(work, 0.2).value == 1


def test_a_failure_says_why() -> None:
    def work() -> Iterator[int]:
        raise IntegrationError("AC403", "idas stopped at t = 1 s: the error test fails")
        yield 1

    outcome = isolated(work, 10.0)
    assert outcome.value is None
    assert outcome.failure == "AC403: idas stopped at t = 1 s: the error test fails"


def test_a_crash_is_a_failure_of_the_child_only() -> None:
    def work() -> Iterator[int]:
        os.kill(os.getpid(), signal.SIGKILL)
        yield 1

    assert isolated(work, 10.0).failure == "the process died (SIGKILL)"


def test_a_run_that_waits_takes_no_processor_time() -> None:
    """Others on the machine make a run wait, and so does sleep: neither is time of the solver."""
    asleep = 0.1

    def wait(done: float, t: float) -> None:
        time.sleep(asleep)

    task = Task(acausal.compile(Oscillator()), ("mass.s",), 1.0, {"stop_time": 1.0, "progress": wait})
    found = measured(task, Case("erk", "torn", tolerance=1e-6), 1, 60.0)
    assert found.value is not None, found.failure
    assert found.value.solve_time < asleep
