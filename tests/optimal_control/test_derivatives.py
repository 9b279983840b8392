"""Derivatives put together point by point equal those that CasADi takes of the whole program."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from acausal import Component, Equations, Real, cos, der, fixed, parameter, signal_input, signal_output, sin, variable
from acausal.models.optimal_control.plate_drilling import least_time
from acausal.optimal_control import Problem
from acausal.optimal_control.guess import initial_guess
from acausal.optimal_control.phases import dynamics_of
from acausal.optimal_control.program.derivatives import derivatives
from acausal.optimal_control.program.polynomials import Basis
from acausal.optimal_control.program.radau import transcribe
from acausal.optimal_control.program.shooting import Steps


class Boat(Component):
    """A boat that is steered across a current, with an output that is no state."""

    u: Real = signal_input(unit="rad/s", default=0.3, doc="Rate of the heading")
    rate: Real = parameter(default=0.5, unit="1/s", doc="Growth of the current with y")
    speed: Real = parameter(default=1.0, unit="m/s", doc="Through the water")
    phi: Real = variable(unit="rad", default=fixed(0.2), doc="Heading")
    x: Real = variable(unit="m", default=fixed(0.0), doc="Along the current")
    y: Real = variable(unit="m", default=fixed(0.0), doc="Across")
    drift: Real = signal_output(unit="m2/s2", doc="What it is carried along, squared")

    def equations(self) -> Equations:
        yield der(self.phi) == self.u
        yield der(self.x) == self.speed * cos(self.phi) + self.rate * self.y
        yield der(self.y) == self.speed * sin(self.phi)
        yield self.drift == (self.rate * self.y) ** 2


def crossing() -> Problem:
    """Two free durations, a decided parameter, numbers in path constraints, and a square of an integral."""
    problem = Problem(Boat())
    rate = problem.decide("rate", min=0.1, max=2.0)
    away = problem.phase("away", until=problem["y"] >= 0.5, duration=(0.1, 9.0), intervals=2)
    back = problem.phase("back", duration=(0.1, 9.0), intervals=3, expected=0.7)
    effort = problem.integral(problem["u"] ** 2 * problem["drift"])
    problem.subject_to("drift", max=3.0)
    problem.subject_to(problem["drift"] * rate <= 2.0 + away.duration)
    problem.subject_to(problem["drift"] <= 4.0 + away.end("drift") ** 2)
    problem.subject_to(back.end("drift") * rate + problem.end("x") ** 2, equals=1.0, name="there")
    problem.minimize(problem.duration * effort**2 + rate)
    return problem


def shot() -> Problem:
    problem = Problem(Boat())
    problem.phase(duration=(0.1, 9.0), intervals=3, expected=1.0)
    problem.subject_to("drift", max=3.0)
    problem.minimize(problem.duration + problem.integral(problem["u"] ** 2 * problem["drift"]))
    return problem


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stated", "steps", "far"),
    # a drill's contact has no value far from where its states follow from each other
    [(crossing, None, 1e-2), (shot, Steps("rk4", 2), 1e-2), (lambda: least_time(2), None, 1e-7)],
)
def test_derivatives_are_those_of_the_whole_program(
    stated: Callable[[], Problem], steps: Steps | None, far: float
) -> None:
    problem = stated()
    guesses = initial_guess(problem)
    laws = dynamics_of(problem, guesses)
    basis = Basis(1, 0) if steps else Basis(3, 2)
    meshes = [spec.mesh for spec in problem.specs]
    nlp = transcribe(problem, laws, guesses, meshes, basis, problem.quantities.p, steps=steps).nlp
    own = derivatives(nlp.x, nlp.objective, nlp.g, nlp.points)
    whole = nlp.casadi_program()
    x, f, g = whole["x"], whole["f"], whole["g"]
    weight, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    hessian = ca.triu(ca.hessian(weight * f + ca.dot(multipliers, g), x)[0])
    theirs = ca.Function("theirs", [x, weight, multipliers], [f, ca.gradient(f, x), g, ca.jacobian(g, x), hessian])
    random = np.random.default_rng(5)
    begin = np.concatenate(nlp.begin)
    for _ in range(3):
        at = begin + far * np.maximum(np.abs(begin), 0.1) * random.standard_normal(len(begin))
        factors = random.standard_normal(g.numel())
        expected = [np.array(v) for v in theirs(at, 0.7, factors)]
        given = own.gradient(at, []) + own.jacobian(at, []) + (own.hessian(at, [], 0.7, factors),)
        for mine, other in zip(given, expected, strict=True):
            small = 1e-10 * max(1.0, float(np.max(np.abs(other))))
            assert np.array(mine) == pytest.approx(other, rel=1e-9, abs=small)
