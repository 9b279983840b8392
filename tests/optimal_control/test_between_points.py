"""What acts between the points of a mesh, or inside of a phase, is told or refused: a run of the model with the answer.

x' = u + d with x(0) = 0 and x(1) = 1 at the least integral of u**2: for d of time alone, u is constant, 1 minus the
integral of d, and its square is the objective (calculus of variations).
"""

from __future__ import annotations

import logging
from typing import Any

import pytest

from acausal import (
    Component,
    Equations,
    Real,
    der,
    fabs,
    fixed,
    integer,
    maximum,
    no_event,
    parameter,
    pre,
    reset,
    sample,
    signal_input,
    structural,
    terminate,
    time,
    variable,
    when,
    where,
)
from acausal.errors import OptimizationError
from acausal.optimal_control import Problem
from tests.expected import fails_with


class Disturbed(Component):
    """A state that is moved by an input, and by something that lasts for an instant."""

    kind: str = structural(default="tent")
    at: Real = parameter(default=0.37)
    width: Real = parameter(default=1e-3)
    u: Real = signal_input(default=0.0)
    x: Real = variable(default=fixed(0.0))
    d: Real = variable()

    def equations(self) -> Equations:
        w = ((self.x if self.kind == "in x" else time) - self.at) / self.width
        if self.kind == "box":
            yield self.d == 0.5 * where(no_event(fabs(w) < 1.0), 1.0, 0.0) / self.width
        else:
            yield self.d == maximum(1.0 - fabs(w), 0.0) / self.width
        yield der(self.x) == self.u + self.d


class Counting(Component):
    """A state that is moved by an input, and what is counted meanwhile."""

    by: str = structural(default="clock")
    u: Real = signal_input(default=0.0)
    x: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        event = sample(0.05, 0.1) if self.by == "clock" else fabs(self.x - 0.37) < 1e-4
        yield when(event, reset(self.n, pre(self.n) + 1))


def least(model: Component, **options: Any) -> Any:
    problem = Problem(model)
    problem.phase(duration=1.0, intervals=8)
    problem.subject_to("u", min=-10.0, max=10.0)
    problem.subject_to(problem.end("x") == 1.0)
    problem.minimize(problem.integral(problem["u"] ** 2))
    return problem.solve(**options)


@pytest.mark.parametrize("options", [{}, {"shooting": "rk4", "steps": 8}])
@pytest.mark.parametrize("kind", ["tent", "box"])
def test_a_pulse_between_the_points_is_told(
    kind: str, options: dict[str, Any], caplog: pytest.LogCaptureFixture
) -> None:
    """Its integral is 1: nothing has to be done, but the points do not see it."""
    with caplog.at_level(logging.WARNING):
        best = least(Disturbed(kind=kind), **options)
    assert best.objective == pytest.approx(1.0, rel=1e-6)
    assert best.replay().final("x") == pytest.approx(2.0, abs=1e-5)
    assert best.stats["replay_error"] == pytest.approx(1.0, abs=1e-5)
    # it switches at instants that are known, where integrators stop
    assert "the mesh is coarse" in caplog.text
    assert "interval 3 of 8" in caplog.text


def test_an_accuracy_finds_it() -> None:
    """Intervals are halved where the run goes elsewhere, until points stand in the pulse, which then does all of it."""
    best = least(Disturbed(width=0.02), accuracy=1e-4, refinements=12)
    assert best.objective == pytest.approx(0.0, abs=1e-3)
    assert best.replay().final("x") == pytest.approx(1.0, abs=1e-3)


def test_what_a_state_passes_is_told(caplog: pytest.LogCaptureFixture) -> None:
    """x' = 1 + d(x) passes a tent of the height 1/w in the time w ln(1 + 1/w) of 2 w: about 2 w (1 - w ln(1/w))."""
    with caplog.at_level(logging.WARNING):
        best = least(Disturbed(kind="in x"))
    late = 2e-3 - 2e-6 * 6.9  # 2 w - 2 w**2 ln(1 + 1/w)
    assert best.replay().final("x") == pytest.approx(1.0 + late, abs=1e-5)
    assert best.stats["replay_error"] == pytest.approx(late, abs=1e-5)
    assert "the points of the mesh miss an effect" in caplog.text


@pytest.mark.parametrize("options", [{}, {"shooting": "rk4", "steps": 8}, {"complementarity": True}])
@pytest.mark.parametrize("by", ["clock", "pass"])
def test_what_is_counted_inside_of_a_phase_is_refused(by: str, options: dict[str, Any]) -> None:
    """n is 10 by the clock and 1 by the pass in every run, and would be 0 in the answer."""
    with fails_with(OptimizationError, "AC704") as caught:
        least(Counting(by=by), **options)
    assert "clock" in str(caught.value) if by == "clock" else "n inside a phase" in str(caught.value)


class Ending(Component):
    """A run that is over when the state has come to a place."""

    u: Real = signal_input(default=0.0)
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield when(self.x > 0.5, terminate("far enough"))


def test_an_end_of_the_run_inside_of_a_phase_is_refused() -> None:
    with fails_with(OptimizationError, "AC704", match="terminates its run") as caught:
        least(Ending())
    assert "far enough" in str(caught.value)
