"""Nonlinear equations in exported steps and in C: solved, or said not to be, however far they jump."""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    atan,
    der,
    exp,
    fixed,
    integer,
    parameter,
    pre,
    reset,
    signal_input,
    tanh,
    variable,
    when,
)
from acausal.export.casadi.c_source import with_c_rootfinders


class Block(Component):
    """A monotone equation for z, with x' = z; `counted` adds an event beside it."""

    u: Real = signal_input()
    k: Real = parameter(default=1.0)
    kind: str = acausal.structural(default="cubic")
    counted: bool = acausal.structural(default=False)
    x: Real = variable(default=fixed(0.0))
    z: Real = variable()
    n: Real = integer()

    def equations(self) -> Equations:
        terms = {"cubic": self.z**3, "exp": exp(self.z), "atan": 5.0 * atan(self.z), "tanh": 9.0 * tanh(3.0 * self.z)}
        yield self.z + self.k * terms[self.kind] == self.u
        yield der(self.x) == self.z
        if self.counted:
            yield when(self.x > 0.123, reset(self.n, pre(self.n) + 1))


LAWS: dict[str, Callable[[float], float]] = {
    "cubic": lambda z: z**3,
    "exp": np.exp,
    "atan": lambda z: 5.0 * np.arctan(z),
    "tanh": lambda z: 9.0 * np.tanh(3.0 * z),
}


def solution(kind: str, k: float, u: float) -> float:
    """z with z + k law(z) == u."""
    reach = abs(u) + 2000.0 * (1.0 + k)
    low, high = -reach, 50.0 if kind == "exp" else reach
    return float(brentq(lambda z: z + k * LAWS[kind](z) - u, low, high, xtol=1e-13, rtol=1e-14))


@pytest.mark.parametrize("kind", LAWS)
@pytest.mark.parametrize("method", ["rk2", "rk4", "rosenbrock", "sdirk"])
def test_a_step_solves_its_equations_or_says_so(kind: str, method: str) -> None:
    # with a constant input z is constant, and x moves by h z; a step to 100 moved x ten times too far, unsaid
    draw, said = random.Random(kind + method), 0
    step = acausal.step_function(acausal.compile(Block(kind=kind, counted=method == "sdirk")), 0.01, method)
    place, flag = [step.x.position(name) for name in "xz"], step.y.position("step.unconverged")
    x, p = np.array(step.x.start), np.array(step.p.start)
    for _ in range(60):
        k, u = 10 ** draw.uniform(-2, 2), draw.choice([1, -1]) * 10 ** draw.uniform(-2, 4)
        p[step.p.position("k")] = k
        for _ in range(3):
            before = x
            x, y = (np.asarray(v).ravel() for v in step.function(x, [u], p))
            said += y[flag]
            if not y[flag]:
                z = solution(kind, k, u)
                assert x[place[1]] == pytest.approx(z, rel=1e-7, abs=1e-7)
                assert x[place[0]] - before[place[0]] == pytest.approx(0.01 * z, rel=1e-7, abs=1e-9)
        if not np.isfinite(x).all():
            x = np.array(step.x.start)
    assert 1 <= said < 150
    if method == "sdirk":
        assert step.y.names[-2] == "step.unconverged"


@pytest.mark.parametrize("kind", LAWS)
def test_c_solves_its_equations_or_gives_nan(kind: str) -> None:
    # the function of which C is generated, which begins at the start of the model whatever the arguments are
    ode = with_c_rootfinders(acausal.compile(Block(kind=kind)).casadi().ode)
    draw, solved = random.Random(kind), 0
    for _ in range(300):
        k, u = 10 ** draw.uniform(-2, 2), draw.choice([1, -1]) * 10 ** draw.uniform(-2, 4)
        try:
            z = float(ode([0.0, 0.0], u, [k])[0][0])
        except RuntimeError:  # where the C returns 1
            continue
        if not np.isnan(z):
            solved += 1
            assert z == pytest.approx(solution(kind, k, u), rel=1e-6, abs=1e-6)
    assert solved > 100
