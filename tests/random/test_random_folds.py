"""Random equations that fold back: no solver goes on with another branch than the one it is on.

An algebraic variable follows one of five curves as x grows. Where the curve turns there is no solution nearby, and
Newton's method may end on another branch; before that, the branch is the one that scipy's integrator of the
differentiated equation follows, which knows of one branch only.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal
from acausal import Component, Equations, Real, cos, der, exp, fixed, guess, parameter, sin, structural, variable

# value of x, and its slope, on the curve x(z)
CURVES: dict[str, tuple[Callable[[Any], Any], Callable[[float], float]]] = {
    "cubic": (lambda z: z**3 - 3 * z, lambda z: 3 * z**2 - 3),
    "exponential": (lambda z: exp(z) - 2.7 * z, lambda z: math.exp(z) - 2.7),
    "sine": (lambda z: z + 1.6 * sin(z), lambda z: 1 + 1.6 * math.cos(z)),
    "steep sine": (lambda z: z + 2.2 * sin(z), lambda z: 1 + 2.2 * math.cos(z)),
    "quartic": (lambda z: z**4 - 2 * z**2, lambda z: 4 * z**3 - 4 * z),
    "cosine": (lambda z: 2 * cos(z), lambda z: -2 * math.sin(z)),
}


class Folding(Component):
    """scale x(z) = scale x, with x driven at a speed v that varies and y an integral of z."""

    curve: str = structural(default="cubic")
    scale: Real = parameter(default=1.0)
    v: Real = parameter(default=1.0)
    begin: Real = parameter(default=0.0)
    x: Real = variable()
    y: Real = variable(default=fixed(0.0))
    z: Real = variable()

    def initial_equations(self) -> Equations:
        yield self.x == self.begin

    def equations(self) -> Equations:
        yield self.scale * CURVES[self.curve][0](self.z) == self.scale * self.x
        yield der(self.x) == self.v * (1 + 0.3 * sin(self.y))
        yield der(self.y) == self.z


@dataclass(frozen=True)
class Case:
    """One branch: where it begins, how x moves, how long the run is, and the exact end or instant of the fold."""

    curve: str
    z: float
    v: float
    scale: float
    stop: float
    fold: float | None
    end: tuple[float, float]


def case(seed: int) -> Case:
    rnd = random.Random(seed)
    while True:
        curve, z, v = rnd.choice(list(CURVES)), rnd.uniform(-2, 2), rnd.choice([-1, 1]) * rnd.uniform(0.3, 3)
        stop, slope = rnd.uniform(1, 6), CURVES[curve][1]
        first = slope(z)
        if abs(first) < 0.1:
            continue

        def rates(t: float, y: Any, slope: Any = slope, v: float = v) -> list[float]:
            return [v * (1 + 0.3 * math.sin(y[1])) / slope(y[0]), y[0]]

        def flat(t: float, y: Any, slope: Any = slope, first: float = first) -> float:
            return float(slope(y[0]) / first - 1e-3)

        flat.terminal = True  # type: ignore[attr-defined]
        found = solve_ivp(rates, (0, stop), [z, 0.0], rtol=1e-10, atol=1e-12, events=flat)
        near = float(slope(found.y[0, -1]) / first)
        fold = float(found.t[-1]) if found.status == 1 else None
        if fold is None and near < 0.05:
            continue  # neither behind a fold nor clear of it
        return Case(curve, z, v, 10 ** rnd.uniform(-4, 4), stop, fold, (found.y[0, -1], found.y[1, -1]))


SOLVERS = ["idas", "cvodes", "rosenbrock", "erk", "rosenbrock with steps", "collocation", "rk", "rk2"]


def check(seed: int, solver: str) -> None:
    """Refused at the fold, or at the exact end."""
    c = case(seed)
    rnd = random.Random(f"{seed} {solver}")
    is_fixed = solver in ("rosenbrock with steps", "collocation", "rk", "rk2")
    options: dict[str, Any] = {"step": c.stop / rnd.choice([20, 50, 200, 1000])} if is_fixed else {}
    if not is_fixed:
        options = {"tolerance": rnd.choice([1e-3, 1e-5, 1e-8])}
    options |= {"solver": solver.split()[0], "output_interval": c.stop / rnd.choice([1, 40, 500])}
    model = Folding(curve=c.curve, z=guess(c.z))
    parameters = {"v": c.v, "scale": c.scale, "begin": float(np.array(_value(c.curve, c.z)))}
    label = f"seed {seed}, {solver}, {options}: {c}"
    if c.fold is not None:
        try:
            found = acausal.simulate(model, parameters=parameters, stop_time=c.stop, **options)
        except acausal.AcausalError as error:
            result = getattr(error, "result", None)
        else:
            pytest.fail(f"{label}: passed the fold, z = {found.final('z')}")
        late = options.get("step", 0.0) + 0.02 * c.stop
        assert result is None or result.time[-1] <= c.fold + late, label
        return
    found = acausal.simulate(model, parameters=parameters, stop_time=c.stop, **options)
    close = max(100 * options.get("tolerance", 0.0), 1e-6) if not is_fixed else 0.05 if solver == "rk2" else 0.01
    ended = np.array([found.final("z"), found.final("y")])
    np.testing.assert_allclose(ended, np.array(c.end), atol=close, rtol=close, err_msg=label)


def _value(curve: str, z: float) -> float:
    numbers = {
        "cubic": z**3 - 3 * z,
        "exponential": math.exp(z) - 2.7 * z,
        "sine": z + 1.6 * math.sin(z),
        "steep sine": z + 2.2 * math.sin(z),
        "quartic": z**4 - 2 * z**2,
        "cosine": 2 * math.cos(z),
    }
    return numbers[curve]


# cvodes takes up to half a minute to say that a solution ends (docs/known-gaps.md): tests/simulate/test_failures.py has
# one fold, and a branch that is followed, for it.
CASES = [(seed, solver) for seed in range(8) for solver in SOLVERS if solver != "cvodes"]


@pytest.mark.parametrize(
    ("seed", "solver"),
    [
        pytest.param(*c, marks=() if c[0] == 1 and c[1] in ("rosenbrock", "collocation") else pytest.mark.slow)
        for c in CASES
    ],
)
def test_no_solver_passes_a_fold(seed: int, solver: str) -> None:
    check(seed, solver)
