"""Kinks whose order is free, rounded: answers come near those of the kinks, by as much as is reported."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, Real, der, fabs, fixed, parameter, signal_input, variable, where
from acausal.errors import AcausalError
from acausal.optimal_control import Problem
from acausal.optimal_control.optimum.optimum import Optimum
from tests.expected import fails_with
from tests.optimal_control.kinked import Kinked


def bias(best: Optimum) -> float:
    found = best.stats["bias"]
    assert isinstance(found, float)
    return found


def notes(best: Optimum) -> tuple[str, ...]:
    found = best.stats["notes"]
    assert isinstance(found, tuple)
    return found


class Rubbing(Component):
    """A kilogram on a rough floor, which moves at a metre per second."""

    u: Real = signal_input(unit="m/s2", min=-2.0, max=2.0, default=-1.0, doc="Push by mass")
    friction: Real = parameter(default=0.5, unit="m/s2", doc="Coulomb friction by mass")
    x: Real = variable(unit="m", default=fixed(0.0), doc="Position")
    v: Real = variable(unit="m/s", default=fixed(1.0), doc="Velocity")

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == self.u - where(self.v > 0.0, self.friction, -self.friction)


def back(way: float) -> Problem:
    """To rest behind the start in the least time, in a single phase."""
    problem = Problem(Rubbing())
    problem.phase(duration=(0.1, 5.0), intervals=20, expected=1.5)
    problem.subject_to(problem.end("x") == -way)
    problem.subject_to(problem.end("v") == 0.0)
    problem.minimize(problem.duration)
    return problem


@pytest.mark.parametrize("way", [0.5, 1.2])
def test_friction_that_turns_round(way: float) -> None:
    """Braked at 2.5 m/s2 for 0.4 s and 0.2 m; then back, faster by 1.5 and slower by 2.5 m/s2."""
    top = ((way + 0.2) / (0.5 / 1.5 + 0.5 / 2.5)) ** 0.5
    exact = 0.4 + top / 1.5 + top / 2.5
    for share in (0.1, 1e-2):
        best = back(way).solve(smooth=share, accuracy=1e-3)
        assert best.objective == pytest.approx(exact, rel=1e-3)
        # what is replayed is the model with its kink: it goes elsewhere by no more than is said
        off = max(best.error(best.replay()).values())
        assert 0.2 * bias(best) < off < bias(best) < share
        assert any("rounded" in note for note in notes(best))


def waiting() -> Problem:
    """To half a metre, and after a second more at 0.8 m: it pays to wait before it gets on."""
    problem = Problem(Kinked())
    problem.phase("near", until=problem["x"] >= 0.5, duration=(0.1, 5.0), intervals=4)
    problem.phase("far", duration=1.0, intervals=10)
    problem.subject_to(problem.end("x") == 0.8)
    problem.minimize(problem.duration + problem.end("y"))
    return problem


def test_what_another_branch_refuses_is_rounded() -> None:
    """Half a second there, and 0.3**2/2 of what is beyond on the way at full speed; waiting goes on either side."""
    with fails_with(AcausalError, "AC706", match="smooth=1e-3"):
        waiting().solve()
    found = [waiting().solve(smooth=share) for share in (1e-2, 1e-3)]
    for best, share in zip(found, (1e-2, 1e-3), strict=True):
        assert best.objective == pytest.approx(1.545, abs=0.02 * share)
        assert max(best.error(best.replay()).values()) < 10 * share
        assert 0.0 < bias(best) < share


def test_what_the_guess_and_the_answer_never_pass_stays_as_it_is() -> None:
    problem = Problem(Kinked())
    problem.phase(duration=(0.1, 5.0), intervals=4, expected=0.5)
    problem.subject_to(problem.end("x") == 0.4)
    problem.minimize(problem.duration)
    best = problem.solve(smooth=0.1)
    assert best.objective == pytest.approx(0.4, rel=1e-7)
    assert bias(best) == 0.0
    assert not notes(best)


@pytest.mark.parametrize("smooth", [-1e-3, 1.0])
def test_a_share_lies_between_nothing_and_all(smooth: float) -> None:
    with fails_with(AcausalError, "AC053"):
        waiting().solve(smooth=smooth)


class Distant(Component):
    """A point that moves, and its distance from zero, which no state depends on."""

    u: Real = signal_input(default=0.9, min=-1.0, max=1.0)
    x: Real = variable(default=fixed(-0.5), unit="s")
    y: Real = variable(unit="s")

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield self.y == fabs(self.x)


@pytest.mark.parametrize("smooth", [0.01, 0.3])
def test_what_rounding_adds_to_an_objective_is_a_bias(smooth: float) -> None:
    """At full rate, with a rest at zero, the integral is (0.5**2 + 0.4**2) / 2; the rest is the bias."""
    problem = Problem(Distant())
    problem.phase(duration=1.0, intervals=10)
    problem.subject_to(problem.end("x") == 0.4)
    problem.minimize(problem.integral("y"))
    best = problem.solve(smooth=smooth)
    added = best.objective - (0.5**2 + 0.4**2) / 2
    assert bias(best) * 0.5 == pytest.approx(added, rel=0.05)
    assert "other variables of the problem" in notes(best)[-1]
