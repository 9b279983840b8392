"""The digits that a reference claims are there: series, closed forms and published answers tell."""

from __future__ import annotations

import math
from collections.abc import Callable
from decimal import Decimal, localcontext
from typing import ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

import acausal
from acausal import Component, Equations, Experiment, Real, der, fixed, parameter, sign, variable
from acausal.models.ivp.answers import PROBLEMS
from acausal.study.bench.accuracy.reference import _refinement
from acausal.study.bench.accuracy.trajectory import Trajectory
from acausal.study.bench.report import Bench
from acausal.study.growth import Growth, growth
from benchmarks.accuracy_problems import Kepler

Array = NDArray[np.float64]
ROUGH = 10.0**0.3
"""By which a claimed error may be smaller than the true one."""


class Lorenz(Component):
    """Chaotic: E. N. Lorenz, J. Atmos. Sci. 20 (1963) 130, sigma = 10, r = 28, b = 8/3."""

    x: Real = variable(default=fixed(-2.0))
    y: Real = variable(default=fixed(3.0))
    z: Real = variable(default=fixed(15.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=12.0)

    def equations(self) -> Equations:
        yield der(self.x) == 10.0 * (self.y - self.x)
        yield der(self.y) == self.x * (28.0 - self.z) - self.y
        yield der(self.z) == self.x * self.y - 8.0 / 3.0 * self.z


class Orbit(Kepler):
    """For 40 s instead of whole periods."""

    experiment: ClassVar[Experiment] = Experiment(stop_time=40.0)


class Spread(Component):
    """x = exp(rate t), y = exp(-3 t)."""

    rate: Real = parameter(default=1.5, unit="1/s")
    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(1.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=6.0)

    def equations(self) -> Equations:
        yield der(self.x) == self.rate * self.x
        yield der(self.y) == -3.0 * self.y


class Falling(Component):
    """An unstable equilibrium that is approached: x = exp(-t) for ever but for errors, which grow as exp(2 t)."""

    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(-1.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=4.0)

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == self.v + 2.0 * self.x


def lorenz(stop: float, points: int) -> Array:
    """Values of (x, y, z) at `points` equal intervals: Taylor series of order 26 in arithmetic of 40 digits."""
    with localcontext() as context:
        context.prec = 40
        h, order = Decimal(stop) / points, 26
        state = [Decimal(-2), Decimal(3), Decimal(15)]
        rows = [state]
        for _ in range(points):
            x, y, z = ([v] for v in state)
            for j in range(order):
                xz, xy = (sum((x[i] * w[j - i] for i in range(j + 1)), Decimal(0)) for w in (z, y))
                x.append(10 * (y[j] - x[j]) / (j + 1))
                y.append((28 * x[j] - xz - y[j]) / (j + 1))
                z.append((xy - Decimal(8) / 3 * z[j]) / (j + 1))
            state = [sum((c * h**k for k, c in enumerate(w)), Decimal(0)) for w in (x, y, z)]
            rows.append(state)
        return np.array(rows, dtype=float)


def orbit(times: Array) -> Array:
    """Positions by Kepler's equation."""
    e, mean = np.longdouble(0.3), times.astype(np.longdouble)
    eccentric = mean.copy()
    for _ in range(40):
        eccentric -= (eccentric - e * np.sin(eccentric) - mean) / (1.0 - e * np.cos(eccentric))
    return np.stack([np.cos(eccentric) - e, np.sqrt(1.0 - e * e) * np.sin(eccentric)], axis=1).astype(float)


def bench(model: Component, stop: float | None = None) -> Bench:
    return acausal.bench(
        model,
        solvers=("rosenbrock",),
        tolerances=(1e-4,),
        steps=(),
        formulations=("torn",),
        repeat=1,
        native=False,
        stop_time=stop,
    )


def off(found: Bench, names: tuple[str, ...], exact: Callable[[Array], Array]) -> float:
    """The true error of a reference."""
    trajectory = found.reference.trajectory
    values = trajectory.values[:, [trajectory.names.index(name) for name in names]]
    truth = exact(trajectory.times)
    return float(np.max(np.abs(values - truth) / (1.0 + np.abs(truth))))


def grown(model: Component, span: float) -> Growth:
    found = growth(acausal.compile(model), {}, {}, span)
    assert found is not None
    return found


@pytest.mark.slow
@pytest.mark.parametrize("stop", [6.0, 18.0])
def test_digits_of_a_chaotic_run_are_there(stop: float) -> None:
    """`rosenbrock` and `erk` have one order and one error control: they agree to a digit more than is right."""
    found = bench(Lorenz(), stop)
    # nominal magnitudes are 1
    true = off(found, ("x", "y", "z"), lambda times: lorenz(stop, len(times) - 1))
    assert true <= ROUGH * found.reference.trusted_error
    assert found.reference.trusted_error <= 30.0 * true


@pytest.mark.slow
def test_digits_of_an_orbit_are_there() -> None:
    found = bench(Orbit(e=0.3))
    true = off(found, ("x", "y"), orbit)
    assert true <= ROUGH * found.reference.trusted_error
    assert found.reference.trusted_digits > 10.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hires", "pleiades", "transistor_amplifier", "car_axis"])
def test_digits_of_published_problems_are_there(name: str) -> None:
    problem = PROBLEMS[name]
    found = bench(problem.model())
    trajectory = found.reference.trajectory
    end = dict(zip(trajectory.names, trajectory.values[-1], strict=True))
    known = {path: value for path, value in problem.values.items() if path in end}
    assert known
    true = max(abs(end[path] - value) / (1.0 + abs(value)) for path, value in known.items())
    assert true <= max(ROUGH * found.reference.trusted_error, 10.0**-problem.digits)


class Stopped(Component):
    """x'' = -4 sign(x') - x' from v = 1.5: at rest from t = log 1.375 on, at 1.5 - 4 log 1.375."""

    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.5))

    experiment: ClassVar[Experiment] = Experiment(stop_time=50.0)

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -4.0 * sign(self.v) - self.v


@pytest.mark.slow
def test_instants_of_events_are_no_better_than_they_are_located() -> None:
    """Runs at all tolerances share the error of the instant, which the sequence of tolerances cannot show."""

    def exact(times: Array) -> Array:
        t = np.minimum(times, math.log(1.375))
        return np.asarray(5.5 * (1.0 - np.exp(-t)) - 4.0 * t)[:, None]

    found = bench(Stopped())
    assert off(found, ("x",), exact) <= ROUGH * found.reference.trusted_error
    assert found.reference.trusted_digits <= 11.0


def three(*errors: float) -> tuple[Trajectory, Trajectory, Trajectory]:
    """Runs of a constant 1 with these errors, the tightest first."""
    a, b, c = (Trajectory(np.zeros(1), ("x",), np.array([[1.0 + e]])) for e in errors)
    return a, b, c


@pytest.mark.parametrize(
    "errors",
    [
        (1e-9, 1e-8, 1e-7),  # in proportion to the tolerance
        (1e-9, 3e-9, 9e-9),  # slower
        (1e-10, 1e-9, 1e-7),  # faster
        (1e-9, -1e-9, 8e-10),  # rounding
        (1e-9, 1.1e-9, 1e-8),  # rounding where two runs agree by chance
    ],
)
def test_refinement_tells_the_error(errors: tuple[float, float, float]) -> None:
    """Mixed errors of a value of 1 are half the absolute ones."""
    told = _refinement(*three(*errors), np.ones(1))
    assert 0.5 * abs(errors[0]) <= 1.5 * told  # what the reference adds to it
    assert told <= 10.0 * max(abs(e) for e in errors[:2])


def test_growth_of_linear_systems_is_that_of_their_exponential() -> None:
    """exp(rate T) for a state that grows itself, exp(2 T) where the solution decays and errors do not."""
    assert grown(Spread(), 6.0).factor == pytest.approx(math.exp(9.0), rel=1e-3)
    assert grown(Spread(), 6.0).relative < 3.0  # the solution grows as its errors do
    falling = grown(Falling(), 4.0)
    # in the norm of the scaled states the growing direction (1, 2) is reached from (2, 1)/3: 5/3 at most
    assert math.exp(8.0) / 2.0 < falling.factor < 5.0 / 3.0 * math.exp(8.0)
    assert falling.relative > 100.0


def test_what_decays_does_not_grow() -> None:
    """Robertson's y1 falls from 1 to 2e-8 in 1e11 s: a late error is not of the size it began with."""
    found = grown(PROBLEMS["robertson"].model(), 1e11)
    assert found.factor < 10.0
    assert found.relative < 10.0


def test_errors_along_an_orbit_grow_with_time_only() -> None:
    """An error da of the semi-axis 1 leads to a phase 1.5 T da; da = 2 v dv + 2 dr/r^2 by the energy.

    From pericentre to pericentre r = 1 - e, v = (1 + e)/h with h^2 = 1 - e^2, and the phase shifts y by v and u by
    1/r^2. Largest magnitudes of x, y, u, v in an orbit are 1 + e, h, 1/h and v.
    """
    e, h = 0.3, math.sqrt(1.0 - 0.3**2)
    r, v = 1.0 - e, (1.0 + e) / h
    before = math.hypot(2.0 * v * v, 2.0 * (1.0 + e) / r**2)
    after = math.hypot(v / h, h / r**2)
    for turns in (2, 8):
        exact = 1.5 * 2.0 * math.pi * turns * before * after
        assert grown(Orbit(e=0.3), 2.0 * math.pi * turns).factor == pytest.approx(exact, rel=0.01)
