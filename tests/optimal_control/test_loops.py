"""Programs on a closed loop of joints, and on states whose starts follow from each other."""

from __future__ import annotations

import numpy as np
import pytest

from acausal import (
    Component,
    Equations,
    Real,
    compile,
    connect,
    der,
    fixed,
    guess,
    quantity,
    signal_input,
    simulate,
    variable,
)
from acausal.errors import UsageError
from acausal.library.multibody import (
    Body,
    Fixed,
    FixedTranslation,
    Prismatic,
    Revolute,
    RevolutePlanarLoopConstraint,
    World,
)
from acausal.library.rotational import Torque
from acausal.optimal_control import Problem
from tests.expected import fails_with


class Slider(Component):
    """Crank and rod of 0.5 m, so s = cos(phi); the mass at the pin has an inertia of 0.3 kg.m2 about the crank."""

    u: Real = signal_input(unit="N.m", default=0.0)
    world: World = World(g=0.0)
    base: Fixed = Fixed()
    crank: Revolute = Revolute(phi=fixed(0.3), w=fixed(0.0))
    arm: FixedTranslation = FixedTranslation(r=(0.5, 0.0, 0.0))
    pin: Revolute = Revolute(phi=guess(-0.6))
    rod: FixedTranslation = FixedTranslation(r=(0.5, 0.0, 0.0))
    load: Body = Body(m=1.0, r_CM=(0.0, 0.0, 0.0), I_33=0.05)
    guide: Prismatic = Prismatic(s=guess(1.0))
    close: RevolutePlanarLoopConstraint = RevolutePlanarLoopConstraint()
    torque: Torque = Torque()

    def equations(self) -> Equations:
        yield connect(self.u, self.torque.u)
        yield connect(self.torque.flange, self.crank.axis)
        yield connect(self.base.frame_b, self.crank.frame_a, self.guide.frame_a)
        yield connect(self.crank.frame_b, self.arm.frame_a)
        yield connect(self.arm.frame_b, self.pin.frame_a)
        yield connect(self.pin.frame_b, self.rod.frame_a, self.load.frame_a)
        yield connect(self.rod.frame_b, self.close.frame_a)
        yield connect(self.guide.frame_b, self.close.frame_b)


def effort(angle: float) -> float:
    """Of an inertia of 0.3 kg.m2, from rest to rest in a second: 12 (I angle)**2 / T**3 (calculus of variations)."""
    return 12.0 * (0.3 * angle) ** 2


def turned(problem: Problem) -> Problem:
    problem.phase(duration=1.0, intervals=8)
    problem.subject_to(problem.end("crank.phi") == 1.3)
    problem.subject_to(problem.end("crank.w") == 0.0)
    problem.minimize(problem.integral(problem["u"] ** 2))
    return problem


def test_least_effort_on_a_closed_loop() -> None:
    best = turned(Problem(Slider())).solve()
    assert best.objective == pytest.approx(effort(1.0), rel=1e-4)
    assert best.final("guide.s") == pytest.approx(np.cos(1.3), abs=1e-4)


def test_free_starts_keep_a_loop_closed() -> None:
    with fails_with(UsageError, "AC053", match="pin.phi, guide.s at the start follow from crank.phi"):
        Problem(compile(Slider()), free_start=["crank.phi"])
    problem = turned(Problem(compile(Slider()), free_start=["crank.phi", "pin.phi", "guide.s"]))
    problem.subject_to(problem.start("crank.phi") == 0.5)
    best = problem.solve()
    assert best.objective == pytest.approx(effort(0.8), rel=1e-4)
    assert best.start["guide.s"] == pytest.approx(np.cos(0.5), abs=1e-6)
    assert best.stats["notes"] == ()


def test_estimates_keep_a_loop_closed() -> None:
    """One angle is measured; the speed at rest is known, and all other states follow from the loop."""
    compiled = compile(Slider())
    run = simulate(compiled, inputs={"u": 0.3}, start={"crank.phi": 0.5}, stop_time=0.5, tolerance=1e-8)
    problem = Problem(compiled)
    problem.phase(duration=0.5, intervals=5)
    estimator = problem.estimator({"crank.phi": 1e-3}, deviations={"crank.phi": 1.0, "crank.w": 1e-3})
    found = [estimator({"u": 0.3}, {"crank.phi": float(run.at(0.1 * k, "crank.phi"))}) for k in (1, 2, 3, 4, 5)][-1]
    for name, value in found.states.items():
        assert value == pytest.approx(float(run.final(name)), abs=2e-3), name
    assert found.states["guide.s"] == pytest.approx(np.cos(found.states["crank.phi"]), abs=1e-4)


class Pair(Component):
    """One state starts at twice the other."""

    u: Real = signal_input(default=0.0)
    a: Real = variable(default=fixed(1.0))
    b: Real = variable()

    def equations(self) -> Equations:
        yield der(self.a) == quantity(1.0, "1/s") * self.u
        yield der(self.b) == -quantity(1.0, "1/s") * self.b

    def initial_equations(self) -> Equations:
        yield self.b == 2 * self.a


def test_what_follows_from_a_free_start_is_free_too() -> None:
    """b(0) = 4 costs nothing once it is free with a, at a(0) = 2; keeping b(0) = 2 a would not be the model's."""
    with fails_with(UsageError, "AC053", match="b at the start follow from a"):
        Problem(Pair(), free_start=["a"])
    problem = Problem(Pair(), free_start=["a", "b"])
    problem.phase(duration=1.0, intervals=3)
    problem.subject_to(problem.start("b") == 2 * problem.start("a"))
    problem.minimize((problem.start("b") - 4.0) ** 2 + problem.integral(problem["u"] ** 2))
    best = problem.solve()
    assert best.start == {"a": pytest.approx(2.0), "b": pytest.approx(4.0)}
    assert best.replay().at(0.0, "b") == pytest.approx(4.0)
    assert best.stats["notes"] == ()


def test_an_optimum_off_the_loop_is_noted() -> None:
    """A demand that the loop makes redundant: the effort is that without it, or a note says that no run follows."""
    problem = turned(Problem(compile(Slider())))
    problem.subject_to(problem.end("guide.s") == np.cos(1.3))
    best = problem.solve()
    notes = " ".join(best.stats["notes"])  # type: ignore[arg-type]
    assert best.objective == pytest.approx(effort(1.0), rel=1e-3) or "fails (AC407" in notes
