"""Runs that cannot be finished: they end soon, keep what was computed, and name the equation."""

from __future__ import annotations

import math
import signal
from dataclasses import replace

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    fixed,
    guess,
    parameter,
    sin,
    sqrt,
    time,
    variable,
)
from acausal.errors import AcausalError, IntegrationError
from acausal.models.drilling_one_axis import OneAxisDrilling
from acausal.models.rc_circuit import RCCircuit
from acausal.simulate.equations.problem import Problem
from acausal.simulate.solvers import solver_named
from acausal.simulate.solvers.recovery import RECOVERY_STEPS, CountedSteps, crawl, recover
from acausal.simulate.solvers.segment import Piece, Segment, Tolerances
from tests.expected import fails_with


class Explosion(Component):
    """x' = x^2 from 1: x = 1/(1 - t) has a pole at t = 1."""

    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.x * self.x


class Emptying(Component):
    """x' = -sqrt(x) - 1 from 1: with s = sqrt(x), t = 2 (1 - s) - 2 log(2/(1 + s)); empty at 2 - 2 log 2 = 0.6137."""

    x: Real = variable(default=fixed(1.0))
    volume: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == -sqrt(self.x) - 1.0
        yield der(self.volume) == self.x


class Hysteresis(Component):
    """z - z^3/3 = x, x' = 1 from 0: the branch through 0 ends at z = 1, x = 2/3; another one goes on."""

    x: Real = variable(default=fixed(0.0))
    z: Real = variable(default=guess(0.0))
    area: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.z - self.z**3 / 3.0 == self.x
        yield der(self.area) == self.z


@pytest.mark.parametrize(
    ("solver", "step"),
    [
        ("idas", None),
        ("rosenbrock", None),
        pytest.param("erk", None, marks=pytest.mark.slow),
        ("rk", 0.01),
        ("rk2", 0.01),
        ("collocation", 0.01),
    ],
)
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_no_solver_goes_on_with_another_branch(solver: str, step: float | None, tolerance: float) -> None:
    if step is not None and tolerance < 1e-3:
        pytest.skip("fixed steps have no tolerance")
    with fails_with(IntegrationError, "AC402") as error:
        acausal.simulate(
            Hysteresis(), stop_time=2.0, solver=solver, step=step, tolerance=tolerance, output_interval=0.01
        )
    result = error.value.result
    assert result is not None
    assert 0.65 <= result.time[-1] <= 2 / 3 + 1e-6
    z = result["z"]
    np.testing.assert_allclose(z - z**3 / 3, result["x"], atol=1e-9)


@pytest.mark.parametrize(("solver", "step"), [("erk", None), ("cvodes", None), ("rk", 0.01), ("rk2", 0.01)])
@pytest.mark.parametrize("rows", [1, 20])
def test_a_branch_is_followed_whatever_the_outputs(solver: str, step: float | None, rows: int) -> None:
    """The same up to x = 0.6: z = 2 sin(asin(3 x / 2) / 3); its area, by parts, is x z - z^2/2 + z^4/12."""
    result = acausal.simulate(
        Hysteresis(), stop_time=0.6, solver=solver, step=step, tolerance=1e-8, output_interval=0.6 / rows
    )
    z = 2 * math.sin(math.asin(0.9) / 3)
    assert result.final("z") == pytest.approx(z, abs=1e-7)
    assert result.final("area") == pytest.approx(0.6 * z - z**2 / 2 + z**4 / 12, abs=1e-4 if solver == "rk2" else 1e-6)


class Snaking(Component):
    """z + 1.5 sin z = x folds at cos z = -2/3, with branches beyond that lie side by side."""

    x: Real = variable(default=fixed(-0.3 - 1.5 * math.sin(0.3)))
    y: Real = variable(default=fixed(0.0))
    z: Real = variable(default=guess(-0.3))

    def equations(self) -> Equations:
        yield der(self.x) == -1.0
        yield self.z + 1.5 * sin(self.z) == self.x
        yield der(self.y) == self.z


@pytest.mark.parametrize("steps", [20, 200])
@pytest.mark.parametrize("rows", [1, 500])
@pytest.mark.parametrize("solver", ["collocation", "rosenbrock"])
def test_no_fixed_step_ends_on_another_branch(solver: str, steps: int, rows: int) -> None:
    """Newton's method within a step past the fold found z = -6.28, which is a solution, but not of this run."""
    with fails_with(IntegrationError, "AC402") as error:
        acausal.simulate(Snaking(), stop_time=5.53, solver=solver, step=5.53 / steps, output_interval=5.53 / rows)
    z = -math.acos(-2 / 3)
    fold = -0.3 - 1.5 * math.sin(0.3) - (z + 1.5 * math.sin(z))
    result = error.value.result
    assert rows == 1 or (result is not None and result.time[-1] <= fold + 1e-6)


class Ending(Component):
    """x = (1 - 3 t / 2)^(2/3) for b = 1/2, in general (1 - (b + 1) t)^(1 / (b + 1)), ends at t = 1 / (b + 1)."""

    b: Real = parameter(default=0.5)
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -1.0 / self.x**self.b


@pytest.mark.parametrize("beside", [False, True])
@pytest.mark.parametrize(("step", "interval"), [(0.3, 1.0), (0.07, 0.25), (0.01, 0.05)])
def test_collocation_ends_where_its_equations_do(
    step: float, interval: float, beside: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    """CasADi goes on with what stands in its memory when a step fails; behind the end that was x = -0.03, silently."""
    model = EndingBesideClock() if beside else Ending()
    with fails_with(IntegrationError, "AC404") as error:
        acausal.simulate(model, stop_time=1.0, solver="collocation", step=step, output_interval=interval)
    result = error.value.result
    assert result is not None
    assert result.time[-1] <= 2 / 3
    np.testing.assert_allclose(result["x"], (1 - 1.5 * result.time) ** (2 / 3), atol=step)
    assert capfd.readouterr().err == ""


class EndingBesideClock(Ending):
    """The same beside a state that goes on."""

    clock: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.clock) == 1.0 - self.clock


class Folding(Component):
    """z^2 + z/1000 = 1 - t has no solution after 1 + 2.5e-7."""

    x: Real = variable(default=fixed(0.0))
    z: Real = variable(default=guess(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.z
        yield self.z * self.z + 1e-3 * self.z == 1.0 - time


class Owner(Component):
    """A failure inside a part."""

    tank: Emptying = Emptying()
    rate: Real = parameter(default=1.0)


EMPTY = 2.0 - 2.0 * np.log(2.0)
# Model, end, code, fact, and what the source line shown first holds.
CASES = [
    (Explosion, 1.0, "AC404", "x grows without bound", "def equations"),
    (Emptying, EMPTY, "AC404", "der(x) has no finite value just after it", "sqrt"),
    (Owner, EMPTY, "AC404", "der(tank.x) has no finite value just after it", "sqrt"),
    (Folding, 1.0, "AC402", "z can no longer be solved for", "1e-3 * self.z"),
]


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
@pytest.mark.parametrize(("model", "end", "code", "fact", "line"), CASES)
def test_what_is_said(model: type[Component], end: float, code: str, fact: str, line: str, solver: str) -> None:
    with pytest.raises(IntegrationError) as caught:
        acausal.simulate(model(), stop_time=2.0, solver=solver)
    error = caught.value
    first, _, rest = str(error).partition("\n")
    assert error.code == code
    assert first.startswith(f"error[{code}]: {model.__name__}: {solver} stopped at t = ")
    assert first.endswith(f" s: {fact}")
    assert float(first.split(" t = ")[1].split()[0]) == pytest.approx(end, abs=1e-5)
    assert line in "\n".join(rest.splitlines()[:3])
    assert "fastest there:" in rest
    assert error.result is not None
    # output times are 4 ms apart
    assert end - 0.0081 < error.result.time[-1] <= end + 1e-6
    if model is Explosion:  # what was computed is right; a relative error grows as 1/(1 - t)
        t = error.result.time[error.result.time < 0.99]
        np.testing.assert_allclose(error.result["x"][: len(t)] * (1.0 - t), 1.0, atol=1e-4)


def test_interrupted() -> None:
    """Ctrl-C between two pieces: the exception carries what there is."""

    class Slow(Component):
        x: Real = variable(default=fixed(1.0))
        v: Real = variable(default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.x) == self.v
            yield der(self.v) == -1e4 * self.x

    def press(fraction: float, t: float) -> None:
        if fraction > 0.1:
            signal.raise_signal(signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where the suite runs in the background
    try:
        with pytest.raises(KeyboardInterrupt) as caught:
            acausal.simulate(Slow(), stop_time=60.0, output_interval=0.1, progress=press)
    finally:
        signal.signal(signal.SIGINT, before)
    result = caught.value.result  # type: ignore[attr-defined]
    assert 0.0 < result.time[-1] < 60.0
    assert result["x"][-1] == pytest.approx(np.cos(100.0 * result.time[-1]), abs=1e-2)


SEGMENT = Segment(0.0, np.array([1.0]), np.array([0.0]), np.zeros(0), np.zeros(0), Tolerances(1e-6, 1.0), None)


def until(wall: float) -> list[float]:
    """Where `crawl` ends when nothing passes `wall`, and how many pieces it tries."""
    tried = 0

    def integrate(segment: Segment) -> Piece:
        nonlocal tried
        tried += 1
        assert segment.step_budget == RECOVERY_STEPS
        if segment.times[-1] > wall:
            raise RuntimeError("IDA_TOO_MUCH_WORK")
        return Piece(segment.times[None, :], np.zeros((0, 1)), {})

    left, piece = crawl(CountedSteps(integrate), replace(SEGMENT))
    return [left.start, 0.0 if piece is None else 1.0, tried]


def test_a_wall_is_found_to_nine_digits() -> None:
    reached, arrived, tried = until(0.123456789)
    assert reached == pytest.approx(0.123456789, abs=1e-8)
    assert reached <= 0.123456789
    assert not arrived
    assert tried < 150


def test_a_narrow_hard_place_is_passed() -> None:
    """Pieces longer than a thousandth fail around 0.5 only."""

    def integrate(segment: Segment) -> Piece:
        if segment.start < 0.51 and segment.times[-1] > 0.5 and segment.times[-1] - segment.start > 1e-3:
            raise RuntimeError("IDA_TOO_MUCH_WORK")
        return Piece(segment.times[None, :], np.zeros((0, 1)), {})

    left, piece = crawl(CountedSteps(integrate), replace(SEGMENT))
    assert piece is not None
    assert left.start + 1e-12 < 1.0


def test_a_run_that_would_take_for_ever_is_given_up() -> None:
    """Pieces that arrive, but take a thousand steps each for a millionth of the time."""
    steps = 0

    def integrate(segment: Segment) -> Piece:
        nonlocal steps
        if segment.times[-1] - segment.start > 1e-6:
            raise RuntimeError("IDA_TOO_MUCH_WORK")
        steps += 1000
        n = len(segment.times)
        return Piece(np.zeros((1, n)), np.zeros((0, n)), {"steps": 1000.0})

    grid = np.linspace(0.0, 1.0, 1001)[1:]
    reached, piece = recover(integrate, replace(SEGMENT, start=0.0, times=grid), lambda times, piece: piece)
    assert piece is None
    assert 0.0 < reached.start < 1e-2
    assert steps < 300_000


class Whirl(Component):
    """x = cos(w t), y = -sin(w t)."""

    w: Real = parameter(default=1.0, unit="1/s")
    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.w * self.y
        yield der(self.y) == -self.w * self.x


@pytest.mark.parametrize("native", [False, True])
@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
def test_no_solver_takes_more_steps_than_it_may(solver: str, native: bool) -> None:
    """A thousand turns to six digits take more than a thousand steps of any order up to five, one turn takes fewer.

    The whole-model solvers took a million steps in each output interval whatever they were allowed: near a vanishing
    pivot of a Stewart platform that was hours.
    """
    compiled = acausal.compile(Whirl(w=2.0 * math.pi))
    problem = Problem(compiled, np.array([2.0 * math.pi]), np.zeros(0), native)
    segment = replace(SEGMENT, x=np.array([1.0, 0.0]), step_budget=1000)
    piece = solver_named(solver).integrate(problem, replace(segment, times=np.array([1.0])))
    assert piece.x[:, -1] == pytest.approx([1.0, 0.0], abs=1e-4)
    with pytest.raises(RuntimeError):
        solver_named(solver).integrate(problem, replace(segment, times=np.array([1000.0])))


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
def test_what_is_not_finite_is_told_by_the_error_alone(solver: str, capfd: pytest.CaptureFixture[str]) -> None:
    """CasADi printed a line for each trial step beyond the end: a hundred with `rosenbrock`."""
    with pytest.raises(IntegrationError):
        acausal.simulate(Emptying(), stop_time=1.0, solver=solver, native=False)
    assert "".join(capfd.readouterr()) == ""


@pytest.mark.parametrize(("model", "name"), [(RCCircuit(), "V"), (OneAxisDrilling(), "gap")])
def test_an_infinite_parameter_is_named_where_a_run_fails(model: Component, name: str) -> None:
    """Not refused beforehand: an infinite limit or time means something."""
    for given in (model, acausal.compile(model)):
        with pytest.raises(AcausalError, match=rf"infinite: {name}\b|{name} = inf"):
            acausal.simulate(given, parameters={name: math.inf}, stop_time=0.1)
