"""A run that is interrupted hands over what it has computed, whoever integrates it."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Iterator
from typing import Any

import pytest

import acausal
from acausal import Component, Equations, Real, der, reset, variable, when
from acausal.simulate.interrupt import terminate, was_terminated
from acausal.simulate.native.cache import compiler

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


class Oscillator(Component):
    """Van der Pol's: its limit cycle has an amplitude of 2.009 and a period of 6.663 (mu = 1)."""

    x: Real = variable(default=2.0)
    v: Real = variable(default=0.0)

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == (1.0 - self.x * self.x) * self.v - self.x


class Counted(Oscillator):
    """With an event in each period."""

    n: Real = variable(default=0.0)

    def equations(self) -> Equations:
        yield der(self.n) == 0.0
        yield when(self.x > 1.0, reset(self.n, self.n + 1.0))


@pytest.fixture(autouse=True)
def usual_handlers() -> Iterator[None]:
    """Those of a program in the foreground: a background shell starts its children with SIGINT ignored."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, terminate)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def interrupted(compiled: Any, number: int = signal.SIGINT, **options: Any) -> Any:
    """What a run of hours keeps when it is asked to end after a moment."""
    acausal.simulate(compiled, stop_time=1.0, output_interval=0.5, **options)  # compiles what is to be compiled
    long = {"idas": 1e5}.get(options["solver"], 1e7 if options["native"] else 1e5)
    threading.Timer(0.4, lambda: os.kill(os.getpid(), number)).start()
    with pytest.raises(KeyboardInterrupt) as caught:
        acausal.simulate(compiled, stop_time=long, output_interval=10.0 if long > 1e6 else 1.0, **options)
    return caught.value.result  # type: ignore[attr-defined]


CASES = [
    pytest.param("idas", None, id="idas"),
    pytest.param("rosenbrock", False, id="rosenbrock"),
    pytest.param("rosenbrock", True, id="rosenbrock compiled", marks=needs_compiler),
    pytest.param("erk", False, id="erk"),
]


@pytest.mark.parametrize(("solver", "native"), CASES)
def test_a_smooth_run_keeps_its_rows(solver: str, native: bool | None) -> None:
    """One call of a solver over the whole time: its rows up to the interrupt are there, and on the limit cycle."""
    result = interrupted(acausal.compile(Oscillator()), solver=solver, native=native)
    assert 0.0 < result.time[-1] < 1e7
    assert abs(result["x"]).max() == pytest.approx(2.009, abs=0.02)


@pytest.mark.parametrize(("solver", "native"), CASES)
def test_a_run_with_events_keeps_its_rows(solver: str, native: bool | None) -> None:
    """The events of the rows that are there: one in each period of 6.663 s."""
    result = interrupted(acausal.compile(Counted()), solver=solver, native=native)
    assert 0.0 < result.time[-1] < 1e7
    assert result["n"][-1] == pytest.approx(result.time[-1] / 6.663, abs=1.5)


def test_a_request_to_end_is_heeded_as_ctrl_c_is() -> None:
    result = interrupted(acausal.compile(Oscillator()), signal.SIGTERM, solver="rosenbrock", native=False)
    assert 0.0 < result.time[-1] < 1e7


def test_a_signal_that_casadi_swallows_is_not_lost() -> None:
    """CasADi takes what Python raises in its callbacks, as while a model is started, for a failure of the model."""
    called: list[int] = []

    class Asked(Oscillator):
        w: Real = variable()

        def equations(self) -> Equations:
            called.append(1)
            with contextlib.suppress(KeyboardInterrupt):
                os.kill(os.getpid(), signal.SIGTERM)
            yield self.w == 1.0

    with pytest.raises(KeyboardInterrupt) as caught:
        acausal.simulate(Asked(), stop_time=1.0)
    assert called
    assert was_terminated(caught.value)
