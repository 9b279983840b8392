"""Crossings that a solver would pass: between its steps, beyond them, or with frozen equations that swing on."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import acausal
from acausal import Component, Equations, Real, connect, der, fabs, fixed, guess, parameter, part, time, variable, where
from acausal.library.electrical import (
    Capacitor,
    ConstantCurrent,
    ConstantVoltage,
    Ground,
    IdealDiode,
    Inductor,
    Resistor,
    SineVoltage,
)
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.clutches import ThreeClutchDrive
from acausal.models.rectifier import BridgeRectifier
from acausal.models.switched_converter import BuckConverter
from tests.marks import slow_but


class Pulse(Component):
    """A fast lag behind a pulse and a ramp, seen through a cubic: the crossing comes 5e-4 s after the pulse."""

    x: Real = variable(default=fixed(100.0))
    y: Real = variable(default=fixed(0.0))
    z: Real = variable(default=guess(20.0))

    def equations(self) -> Equations:
        u = where(time < 0.5, 100.0, 1.0 - (time - 0.5) / 0.0005)
        yield der(self.x) == (u - self.x) / 1e-6
        yield self.z + 0.01 * self.z**3 == self.x
        yield der(self.y) == where(self.z < 0.0, 1.0, 0.0)


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock"])
@pytest.mark.parametrize("run", [{}, {"output_interval": 0.3}, {"tolerance": 1e-9}])
def test_crossing_right_after_a_fast_transient(solver: str, run: dict[str, Any]) -> None:
    """z < 0 where x < 0; the lag is 1e-6 s behind the ramp, which is zero at 0.5005: y(1) = 0.5 - 0.0005 - 1e-6."""
    r = acausal.simulate(Pulse(), stop_time=1.0, solver=solver, **run)
    assert r.final("y") == pytest.approx(0.499499, abs=2e-9)


class StiffContact(Component):
    """A mass of 1 kg meets a spring of 1e8 N/m, beside a nonlinear algebraic equation."""

    k: Real = parameter(default=1e8)
    x: Real = variable(default=fixed(0.1))
    v: Real = variable(default=fixed(-1.0))
    z: Real = variable(default=guess(0.1))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == where(self.x < 0.0, -self.k * self.x, 0.0)
        yield self.z + self.z**3 == self.x


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
@pytest.mark.parametrize("tolerance", [1e-6, 1e-8])
def test_stiff_contact_lasts_half_a_period(solver: str, tolerance: float) -> None:
    """In contact from 0.1 s on for pi*sqrt(m/k), then away with the speed it came with: x(1) = 0.9 - 1e-4*pi."""
    r = acausal.simulate(StiffContact(), stop_time=1.0, solver=solver, tolerance=tolerance)
    assert [e.time for e in r.events] == pytest.approx([0.1, 0.1 + math.pi * 1e-4], abs=100 * tolerance)
    assert r.final("x") == pytest.approx(0.9 - math.pi * 1e-4, abs=100 * tolerance)


class ChargedThroughDiodes(Component):
    """A source charges two capacitors: over a clamping diode, and over another one."""

    source: ConstantVoltage = ConstantVoltage(V=1.0)
    first: Capacitor = Capacitor(C=1.0, v=fixed(0.0))
    clamp: IdealDiode = IdealDiode()
    feed: IdealDiode = IdealDiode()
    second: Capacitor = Capacitor(C=1.0, v=fixed(0.0))
    ground: Ground = Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.first.p)
        yield connect(self.first.n, self.clamp.p, self.feed.p)
        yield connect(self.feed.n, self.second.p)
        yield connect(self.source.n, self.clamp.n, self.second.n, self.ground.p)


@pytest.mark.parametrize("solver", ["idas", "cvodes"])
@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10])
def test_charge_is_shared_in_microseconds(solver: str, tolerance: float) -> None:
    """Both diodes are 1e-5 Ohm until the voltages of the node (from 1 V on) and of the second capacitor are equal.

    From then on that one keeps its charge but for 1e-5 S, a hundred-thousandth of it in 1 s.
    """
    to = np.array([[-2.0, 1.0], [1.0, -1.0]]) / 1e-5

    def voltages(t: float) -> np.ndarray:
        return np.asarray(expm(to * t) @ [1.0, 0.0])

    t: Any = brentq(lambda t: np.diff(voltages(t))[0], 1e-7, 1e-4, xtol=1e-18)
    r = acausal.simulate(ChargedThroughDiodes(), stop_time=1.0, solver=solver, tolerance=tolerance)
    assert [e.time for e in r.events] == pytest.approx([t], rel=1e-5)
    assert r.final("second.v") == pytest.approx(voltages(t)[1], rel=2e-5)


class PeakRectifier(Component):
    """A sine of 10 V, a diode, 10 Ohm beside 1 mF."""

    source: SineVoltage = SineVoltage(V=10.0, f=1.0)
    diode: IdealDiode = IdealDiode()
    R: Resistor = Resistor(R=10.0)
    C: Capacitor = Capacitor(C=1e-3, v=fixed(0.0))
    ground: Ground = Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.diode.p)
        yield connect(self.diode.n, self.R.p, self.C.p)
        yield connect(self.R.n, self.C.n, self.source.n, self.ground.p)


@pytest.mark.parametrize("solver", ["idas", "cvodes"])
@pytest.mark.parametrize("tolerance", [1e-6, 1e-8])
@pytest.mark.parametrize("stop", [0.7, 0.95])
def test_a_diode_blocks_where_its_current_ends(solver: str, tolerance: float, stop: float) -> None:
    """C u' + u/R = 0 for u = 10 V sin(2 pi t): at t = 1/2 - atan(2 pi RC) / (2 pi) = 0.49001 s; RC = 10 ms."""
    t = 0.5 - math.atan(2 * math.pi * 0.01) / (2 * math.pi)
    r = acausal.simulate(PeakRectifier(), stop_time=stop, solver=solver, tolerance=tolerance)
    assert [e.time for e in r.events] == pytest.approx([t], abs=100 * tolerance)
    u = 10 * math.sin(2 * math.pi * t)  # the leakage of 1e-5 S takes 1e-4 of it
    assert r.at(t + 0.05, "C.v") == pytest.approx(u * math.exp(-5.0), abs=2e-3)


@pytest.mark.parametrize("solver", ["idas", "cvodes"])
def test_a_diode_does_not_conduct_backwards_at_a_coarse_tolerance(solver: str) -> None:
    """The same at 1e-4: state by state, 1e-4 of 10 V would be 100 A through 1e-5 Ohm, and outputs move no event.

    Rows are points between the steps of BDF: off by some of the share of the tolerance that solvers get, 1e-5 V. The
    error of the current, 0.014 A, is a millisecond where it falls by 12 A in a second: at 15 tolerances from 0.9e-4 to
    1.1e-4, instants of `cvodes` are 2e-6 to 1e-3 s off.
    """
    t = 0.5 - math.atan(2 * math.pi * 0.01) / (2 * math.pi)
    compiled, found = acausal.compile(PeakRectifier()), []
    for interval in (0.007, 0.0053):
        r = acausal.simulate(compiled, stop_time=3.5, solver=solver, tolerance=1e-4, output_interval=interval)
        assert min(r["diode.i"]) > -2.0
        found.append([e.time for e in r.events])
        for period in range(3):
            assert min(abs(e - t - period) for e in found[-1]) < 2e-3
    assert found[1] == pytest.approx(found[0], abs=1e-12)


def test_idas_knows_currents_at_the_coarsest_tolerance() -> None:
    """The same at 1e-3, where it found no event at all: errors of states had not relaxed over steps of nobody yet."""
    first = 0.5 - math.atan(2 * math.pi * 0.01) / (2 * math.pi)
    r = acausal.simulate(PeakRectifier(), solver="idas", tolerance=1e-3, stop_time=1.7)
    assert [e.time for e in r.events] == pytest.approx([first, 1.0, 1.0 + first], abs=1e-3)


@pytest.mark.parametrize("native", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
@pytest.mark.parametrize("interval", [3.5, 0.05, 0.007])
def test_one_step_methods_know_currents_at_coarse_tolerances(interval: float, tolerance: float, native: bool) -> None:
    """The same with rosenbrock: seven events at any tolerance, with any outputs.

    State by state, guards were known to an ampere at 1e-4: it blocked 0.05 s early and conducted backwards for ever.
    """
    first = 0.5 - math.atan(2 * math.pi * 0.01) / (2 * math.pi)
    options: dict[str, Any] = {"stop_time": 3.5, "output_interval": interval, "native": native}
    r = acausal.simulate(PeakRectifier(), solver="rosenbrock", tolerance=tolerance, **options)
    expected = [first, 1.0, 1.0 + first, 2.0, 2.0 + first, 3.0, 3.0 + first]
    found = [e.time for e in r.events]
    assert all(min(abs(t - e) for e in expected) < max(1e-5, 0.05 * tolerance) for t in found)
    assert all(min(abs(t - e) for t in found) < max(1e-5, 0.05 * tolerance) for e in expected)
    assert min(r["diode.i"]) > -1e-3


class Rectifier(Component):
    """Modelica.Electrical.Analog.Examples.Rectifier: three phases, line inductors, six diodes, 500 A."""

    sources: tuple[SineVoltage, ...] = part()
    lines: tuple[Inductor, ...] = part()
    upper: tuple[IdealDiode, ...] = part()
    lower: tuple[IdealDiode, ...] = part()
    C1: Capacitor = part()
    C2: Capacitor = part()
    load: ConstantCurrent = ConstantCurrent(I=500.0)
    ground: Ground = Ground()

    def build(self) -> None:
        phases = [-2 * math.pi / 3 * k for k in range(3)]
        self.sources = tuple(SineVoltage(V=400.0 * math.sqrt(2 / 3), f=50.0, phase=p) for p in phases)
        self.lines = tuple(Inductor(L=60e-6) for _ in phases)
        self.upper, self.lower = (tuple(IdealDiode(Ron=1e-3, Goff=1e-3, Vknee=2.0) for _ in phases) for _ in range(2))
        self.C1, self.C2 = (Capacitor(C=30e-3, v=fixed(200.0 * math.sqrt(2))) for _ in range(2))

    def equations(self) -> Equations:
        yield connect(*(s.n for s in self.sources))
        for source, line, up, down in zip(self.sources, self.lines, self.upper, self.lower, strict=True):
            yield connect(source.p, line.p)
            yield connect(line.n, up.p, down.n)
        yield connect(*(d.n for d in self.upper), self.C1.p, self.load.p)
        yield connect(*(d.p for d in self.lower), self.C2.n, self.load.n)
        yield connect(self.C1.n, self.C2.p, self.ground.p)


@pytest.mark.parametrize("solver", ["idas", "cvodes"])
@pytest.mark.parametrize(
    "run", [{"stop_time": 2e-3}, {"stop_time": 2e-3, "output_interval": 1e-3}, {"stop_time": 3e-4}]
)
def test_the_first_diode_of_the_rectifier_of_msl(solver: str, run: dict[str, Any]) -> None:
    """MSL's first event is at 2.97e-5 s; it was found at the first look, which moves with outputs and stop time."""
    r = acausal.simulate(Rectifier(), solver=solver, **run)
    assert r.events[0].time == pytest.approx(2.97e-5, rel=2e-3)


class Touching(Component):
    """A mass that starts just at its spring, at a speed towards it or away from it, in gravity."""

    k: Real = parameter(default=1e6)
    g: Real = parameter(default=0.0)
    start: Real = parameter(default=-1.0)
    x: Real = variable(default=fixed(0.0))
    v: Real = variable()
    z: Real = variable(default=guess(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == where(self.x < 0.0, -self.k * self.x, 0.0) - self.g
        yield self.z + self.z**3 == self.x

    def initial_equations(self) -> Equations:
        yield self.v == self.start


@pytest.mark.parametrize("solver", ["idas", "cvodes"])
@pytest.mark.parametrize("stop", [0.01, 1.0, 300.0])
def test_a_start_on_the_guard_into_contact(solver: str, stop: float) -> None:
    """Half a period of 1e3 rad/s in contact, then away at 1 m/s for ever."""
    r = acausal.simulate(Touching(), stop_time=stop, solver=solver, tolerance=1e-8)
    assert [e.time for e in r.events] == pytest.approx([math.pi * 1e-3], abs=1e-8)
    assert r.final("x") == pytest.approx(stop - math.pi * 1e-3, rel=1e-5)


@pytest.mark.parametrize("solver", ["idas", "cvodes"])
@pytest.mark.parametrize("stop", [0.05, 0.3])
def test_a_start_on_the_guard_that_leaves_it(solver: str, stop: float) -> None:
    """A flight of 2 v/g from 0.1 m/s on, then contact: half a period and what gravity adds, again and again.

    In contact x'' = -w^2 x - g from x = 0 at -v: it lasts (pi + 2 atan(g / (v w))) / w.
    """
    w, g, v = 1e3, 10.0, 0.1
    contact = (math.pi + 2 * math.atan(g / (v * w))) / w
    flight = 2 * v / g
    times = [t for k in range(200) for t in (k * (flight + contact) + flight, (k + 1) * (flight + contact)) if t < stop]
    model = Touching(g=g, start=v)
    r = acausal.simulate(model, stop_time=stop, solver=solver, tolerance=1e-9)
    assert [e.time for e in r.events] == pytest.approx(times, abs=1e-5)


class Late(Component):
    """y grows slowly, then at once, and ends at 1; w counts the time above a threshold."""

    threshold: Real = parameter(default=0.5)
    y: Real = variable(default=fixed(1e-4), nominal=1e-4)
    w: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.y) == self.y**2 - self.y**3
        yield der(self.w) == where(self.y > self.threshold, 1.0, 0.0)


@pytest.mark.parametrize("solver", ["idas", "cvodes"])
@pytest.mark.parametrize("tolerance", [1e-8, 1e-10])
def test_a_late_crossing_is_found_once(solver: str, tolerance: float) -> None:
    """1/y + log(1/y - 1) falls by t: a relative error of y at the start is 1e4 s times as large in the time."""
    t = (1e4 + math.log(1e4 - 1)) - (2.0 + math.log(1.0))
    r = acausal.simulate(Late(), stop_time=2e4, solver=solver, tolerance=tolerance)
    assert [e.time for e in r.events] == pytest.approx([t], abs=3e5 * tolerance)


@pytest.mark.parametrize(
    ("model", "solver"),
    slow_but(
        product([BouncingBall, ThreeClutchDrive, BridgeRectifier, BuckConverter], ["idas", "cvodes"]),
        (BouncingBall, "cvodes"),
        (ThreeClutchDrive, "idas"),
        (BridgeRectifier, "cvodes"),
        (BuckConverter, "idas"),
    ),
)
def test_events_depend_on_neither_outputs_nor_stop_time(model: type[Component], solver: str) -> None:
    """The same events to the last digit whatever is put out; from another stop time to the accuracy of the run."""
    compiled = acausal.compile(model())
    stop = model.experiment.stop_time

    def events(**run: Any) -> list[float]:
        r = acausal.simulate(compiled, solver=solver, tolerance=1e-7, **{"stop_time": stop, **run})
        return [e.time for e in r.events if e.time < 0.8 * stop]

    usual = events()
    assert usual
    assert events(output_interval=stop / 7) == usual
    assert events(stop_time=0.83 * stop) == pytest.approx(usual, abs=1e-7 * stop)


class NarrowFunction(Component):
    """y' = 1e3 where |x - 5| < 1e-3 and x' = 1: y(9) = 2; the guard has a kink, and lasts 2 ms of 9 s."""

    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == where(fabs(self.x - 5.0) < 1e-3, 1e3, 0.0)


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
@pytest.mark.parametrize("stop", [5.0011, 9.0, 40.0])
def test_a_kinked_guard_is_not_passed_there_and_back(solver: str, stop: float) -> None:
    """Two looks at both sides of the kink, and a parabola through them, say that the guard turns back far above."""
    r = acausal.simulate(NarrowFunction(), stop_time=stop, solver=solver)
    assert r.final("y") == pytest.approx(2.0, abs=1e-5)
    assert [e.time for e in r.events] == pytest.approx([4.999, 5.001], abs=1e-6)
