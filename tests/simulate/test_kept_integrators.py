"""Integrators of the search for events are kept: none is made in a second run, and rows lie between their mesh
points."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import cast

import casadi
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, quantity, variable, where
from acausal.models.drilling_dynamic import ThickBlock
from acausal.simulate.events.location.between import between
from acausal.simulate.events.location.mesh import growing, stepped


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """How many integrators were made since the last call."""
    count, make = [0], cast("Callable[..., object]", casadi.integrator)

    def counting(*arguments: object) -> object:
        count[0] += 1
        return make(*arguments)

    monkeypatch.setattr(casadi, "integrator", counting)

    def since() -> int:
        found, count[0] = count[0], 0
        return found

    return since


@pytest.mark.slow
@pytest.mark.parametrize("native", [False, True])
def test_a_second_run_makes_no_integrator(made: Callable[[], int], native: bool) -> None:
    """22 events, more than a hundred integrations; outputs are no business of an integrator's."""
    compiled = acausal.compile(ThickBlock())
    first = acausal.simulate(compiled, solver="idas", native=native)
    assert made() <= 50
    second = acausal.simulate(compiled, solver="idas", native=native)
    assert made() == 0
    assert second.final("drill.s") == first.final("drill.s")
    acausal.simulate(compiled, solver="idas", native=native, output_interval=0.37)
    assert made() <= 2


class Relay(Component):
    """A relay that leads back to its switching point, and then holds it; what it does for `k` = 2 is known."""

    k: Real = parameter(default=1.0, unit="1/s")
    x: Real = variable(default=fixed(1.0), unit="1")
    y: Real = variable(default=fixed(0.0), unit="s")

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * where(self.x > 0.0, 1.0, -1.0)
        yield der(self.y) == where(self.x > 0.0, 1.0, 0.0)


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
def test_other_parameters_make_no_integrator(solver: str, made: Callable[[], int]) -> None:
    """x = 1 - k*t up to 1/k, then it slides: 0, by a mode of one half; y(2) = 1/k + (2 - 1/k)/2."""
    compiled = acausal.compile(Relay())
    for k, most in ((1.0, 30), (1.0, 0), (2.0, 3), (0.8, 3), (1.0, 0), (2.0, 0)):
        made()
        r = acausal.simulate(compiled, parameters={"k": k}, stop_time=2.0, solver=solver, native=False)
        assert made() <= most
        assert r.final("y") == pytest.approx(1.0 + 0.5 / k, rel=1e-5)
        assert r.events[0].time == pytest.approx(1.0 / k, rel=1e-6)


@pytest.mark.parametrize("solver", ["idas", "rosenbrock", "auto"])
def test_parameters_that_are_divided_by_or_infinite(solver: str) -> None:
    """1/k is infinite for k = 0, where it is not used, and a limit may be infinite.

    Up to 0.25 at a rate of 3, then 1: x(1) = 0.25 + 1 - 0.25/3 = 7/6.
    """
    compiled = acausal.compile(Limited())
    for k, limit, end in ((0.0, math.inf, 1.0), (0.5, 0.25, 7 / 6), (0.5, math.inf, 3.0), (0.0, 0.5, 1.0)):
        if solver == "rosenbrock" and limit == math.inf:
            continue  # AC400 where it is interpreted: CasADi's derivative of such a guard is no number
        given = {"k": k, "limit": limit}
        r = acausal.simulate(compiled, parameters=given, stop_time=1.0, solver=solver, native=False)
        assert r.final("x") == pytest.approx(end, rel=1e-6)


class Limited(Component):
    """A rate of 1, and of 1/k more, where that is asked for, up to a limit of x."""

    k: Real = parameter(default=1.0, unit="1")
    limit: Real = parameter(default=1.0, unit="1")
    x: Real = variable(default=fixed(0.0), unit="1")

    def equations(self) -> Equations:
        extra = where(self.k > 0.0, 1.0 / self.k, 0.0, smooth=True)
        yield der(self.x) == quantity(1.0, "1/s") * (1.0 + where(self.x < self.limit, extra, 0.0))


class Switching(Component):
    """An oscillator, a fast lag behind it, and the time for which it is negative."""

    x: Real = variable(default=fixed(1.0), unit="")
    v: Real = variable(default=fixed(0.0), unit="")
    y: Real = variable(default=fixed(1.0), unit="")
    w: Real = variable(default=fixed(0.0), unit="")

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.x
        yield der(self.y) == 1e4 * (self.x - self.y)
        yield der(self.w) == where(self.x < 0.0, 1.0, 0.0)


@pytest.mark.parametrize("solver", ["idas", "cvodes"])
def test_rows_between_mesh_points_are_as_good_as_steps(solver: str, made: Callable[[], int]) -> None:
    """x = cos t, y' = a*(x - y) from 1: y = (a^2 cos t + a sin t + exp(-a t)) / (1 + a^2); rows at no step's end."""
    compiled = acausal.compile(Switching())
    a = 1e4
    for interval in (0.5, 0.013):
        made()
        r = acausal.simulate(compiled, stop_time=10.0, output_interval=interval, tolerance=1e-8, solver=solver)
        t = r.time
        assert np.abs(r["x"] - np.cos(t)).max() <= 2e-7
        assert np.abs(r["y"] - (a**2 * np.cos(t) + a * np.sin(t) + np.exp(-a * t)) / (1 + a**2)).max() <= 2e-7
        assert [e.time for e in r.events] == pytest.approx([math.pi * (k + 0.5) for k in range(3)], abs=2e-7)
    assert made() <= 5  # for other outputs


def test_between_mesh_points() -> None:
    """A polynomial of degree five is known exactly; what is not smooth is not known, but at the mesh points.

    What does not change is the same to the last digit: a hole is nowhere less deep than before.
    """
    nodes = np.cumsum(np.linspace(0.1, 0.3, 12))
    times = np.concatenate([np.linspace(nodes[0], nodes[-1], 37), nodes[3:4]])
    values = np.column_stack([nodes**5 - nodes, np.abs(nodes - 1.3)])
    found, good = between(nodes, values[:, :1], times, np.full((len(times), 1), 1e-10))
    assert good.all()
    assert found[:, 0] == pytest.approx(times**5 - times, rel=1e-11, abs=1e-11)
    found, good = between(nodes, values, times, np.full((len(times), 2), 1e-10))
    assert good[[0, -2, -1]].all()
    assert not good[1:-2].any()
    assert found[-1, 1] == values[3, 1]
    found, good = between(nodes, np.full((len(nodes), 1), 0.1), times, np.full((len(times), 1), 1e-10))
    assert good.all()
    assert (found == 0.1).all()


def test_meshes_are_few_grids() -> None:
    """Any stretch has one of some hundred grids, from a sixteenth of its first look to its end or to the last look."""
    grids = set()
    for length in np.geomspace(1e-9, 1e3, 40):
        for spacing in np.geomspace(1e-12, 1e2, 30):
            reach, shares = growing(length, 1e-4 * spacing, spacing, 256, 1e-13)
            assert 0.0 < reach <= length
            assert shares[-1] == 1.0
            assert (np.diff(shares) > 0).all()
            grids.add(shares.tobytes())
    assert len(grids) <= 100


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_counts_are_those_of_one_run(solver: str) -> None:
    """CasADi's statistics of a kept integrator go on from call to call; one Jacobian a step of `rosenbrock`."""
    compiled = acausal.compile(Relay())
    first, second = (acausal.simulate(compiled, solver=solver, native=False, stop_time=3.0).stats for _ in range(2))
    for name in ("steps", "rhs_evaluations", "jacobians"):
        assert second[name] == first[name]
    steps, jacobians = (cast("float", second[name]) for name in ("steps", "jacobians"))
    assert jacobians <= steps


class Web(Component):
    """70 decays, each fed by the one before: x_k = t**k exp(-t) / k! of a linear chain."""

    x: Real = variable(shape=70, default=fixed((1.0, *[0.0] * 69)))

    def equations(self) -> Equations:
        yield der(self.x[0]) == -self.x[0] / quantity(1.0, "s")
        for k in range(1, 70):
            yield der(self.x[k]) == (self.x[k - 1] - self.x[k]) / quantity(1.0, "s")


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock"])
def test_integrators_of_the_same_equations_derive_them_once(monkeypatch: pytest.MonkeyPatch, solver: str) -> None:
    """Two runs with other outputs have two integrators and one Jacobian; values are those of the chain (Poisson)."""
    make: Callable[..., casadi.Function] = casadi.integrator
    found: list[casadi.Function] = []

    def keeping(*arguments: object) -> casadi.Function:
        found.append(make(*arguments))
        return found[-1]

    monkeypatch.setattr(casadi, "integrator", keeping)
    compiled = acausal.compile(Web())
    for interval in (0.1, 0.3):
        run = acausal.simulate(
            compiled, stop_time=3.0, solver=solver, tolerance=1e-8, output_interval=interval, native=False
        )
        expected = [3.0**k * math.exp(-3.0) / math.factorial(k) for k in (0, 3, 10)]
        assert [run.final(f"x[{k}]") for k in (0, 3, 10)] == pytest.approx(expected, rel=1e-5)
    assert len(found) >= 2
    derived = [f.get_function("jacF").__hash__() for f in found]
    assert len(set(derived)) == 1


@pytest.mark.parametrize("count", [1, 7, 500])
def test_mesh_points_of_fixed_steps_are_two_steps_apart_and_cut_none(count: int) -> None:
    # each look is an output or lies on the steps between two of them, so that looking costs no further step
    outputs, end = np.linspace(0.0, 1.0, 101)[1:], 1.0
    assert stepped(0.0, outputs, end, 0.01, count).tolist() == outputs[:count].tolist()
    closer = np.arange(1, 501) / 500  # outputs ten steps of 1 ms apart have four mesh points between them
    assert stepped(0.0, outputs, end, 1e-3, count) == pytest.approx(closer[:count], rel=1e-14)


def test_guards_that_have_left_zero_are_not_looked_for_again_and_again() -> None:
    """A contact that opens is beyond zero by rounding for a while.

    Where the search allowed for that at some mesh points only, a guard seemed to turn back: 10 310 integrations instead
    of a few for each of the 22 contacts of `ThickBlock`. They are as many with every multistep method.
    """
    compiled = acausal.compile(ThickBlock())
    runs = [acausal.simulate(compiled, solver=s, tolerance=1e-6) for s in ("idas", "cvodes")]
    idas, cvodes = (cast("float", run.stats["steps"]) for run in runs)
    assert cvodes < 2 * idas
