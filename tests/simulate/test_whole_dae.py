"""The whole DAE against the torn one, with multistep and one-step methods."""

from __future__ import annotations

import math
from importlib import import_module

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, der, fixed, guess, maximum, parameter, part, variable, where
from acausal.library.electrical import Capacitor, Ground, IdealDiode, Inductor, Resistor, SineVoltage
from acausal.models.drilling_control import ForceControlledDrilling
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.drilling_spindle import SpindleStall
from acausal.models.ivp import AndrewsSqueezer, ChargePump
from acausal.models.rc_circuit import RCCircuit
from acausal.models.rectifier import BridgeRectifier


@pytest.mark.parametrize("model", [RCCircuit, BridgeRectifier])
def test_both_forms_agree(model: type[Component]) -> None:
    """Final states within 1e-6 of their size at a tolerance of 1e-9; the runs are too short for chaos to show."""
    stop = min(1.0, model.experiment.stop_time)
    torn, whole = (
        acausal.simulate(acausal.compile(model(), formulation=form), stop_time=stop, tolerance=1e-9)
        for form in ("torn", "dae")
    )
    for name in acausal.compile(model()).states:
        size = max(1e-3, float(np.max(np.abs(torn[name]))))
        assert whole.final(name) == pytest.approx(torn.final(name), abs=1e-6 * size), name


@pytest.mark.parametrize("tolerance", [1e-7, 1e-8, 1e-11])
def test_currents_through_micro_ohms(tolerance: float) -> None:
    """The whole DAE has the currents of conducting diodes as unknowns: 150 V over 1e-5 Ohm, rounded, are 3e-9 A.

    Final state and events are those of the torn form at 1e-10, where the voltage alone is integrated.
    """
    reference = acausal.simulate(BridgeRectifier(), stop_time=0.1, tolerance=1e-10, solver="idas")
    whole = acausal.compile(BridgeRectifier(), formulation="dae")
    found = acausal.simulate(whole, stop_time=0.1, tolerance=tolerance, solver="idas")
    assert found.final("capacitor.v") == pytest.approx(reference.final("capacitor.v"), rel=100 * tolerance + 1e-9)
    times = [e.time for e in reference.events]
    assert [e.time for e in found.events] == pytest.approx(times, abs=0.01 * tolerance + 1e-9)


def test_accelerations_have_the_magnitude_of_their_velocities() -> None:
    """Nominal velocities are 1000 rad/s, angles 1 rad: an acceleration that only the compiler knows is 1e6 rad/s2."""
    compiled = acausal.compile(AndrewsSqueezer(), formulation="dae")
    sizes = dict(zip(compiled.algebraic, compiled.nominal_z, strict=True))
    assert {size for name, size in sizes.items() if name.startswith("der(v[")} == {1e6}


def test_a_model_without_states_is_torn_all_the_same() -> None:
    assert acausal.compile(ChargePump(), formulation="dae").algebraic == acausal.compile(ChargePump()).algebraic


@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_what_is_declared_monotone_is_solved_in_both_forms(solver: str) -> None:
    """The thrust of a drill has a safeguarded search of its own: left to a solver, it ends at the first touch."""
    whole = acausal.compile(ThickBlock(), formulation="dae")
    found = acausal.simulate(whole, stop_time=2.0, tolerance=1e-6, solver=solver)
    torn = acausal.simulate(ThickBlock(), stop_time=2.0, tolerance=1e-6, solver=solver)
    assert found.final("slide.s") == pytest.approx(torn.final("slide.s"), abs=1e-8)
    assert found.final("drill.s_tar") == pytest.approx(torn.final("drill.s_tar"), abs=1e-8)


class Crank(Component):
    """A slider crank in coordinates of its parts: two loop equations, all forces unknown, turned by a torque."""

    l1: Real = parameter(default=0.1)
    l2: Real = parameter(default=0.35)
    J1: Real = parameter(default=0.02)
    J2: Real = parameter(default=0.01)
    m2: Real = parameter(default=0.8)
    m3: Real = parameter(default=0.5)
    a: Real = variable(default=fixed(0.3), doc="Angle of the crank")
    w: Real = variable(default=fixed(5.0))
    b: Real = variable(default=guess(-0.1), doc="Angle of the rod")
    u: Real = variable()
    s: Real = variable(default=guess(0.4), doc="Place of the slider")
    v: Real = variable()
    fx: Real = variable()
    fy: Real = variable()
    gx: Real = variable()
    gy: Real = variable()
    x2: Real = variable()
    y2: Real = variable()
    vx: Real = variable()
    vy: Real = variable()

    def equations(self) -> Equations:
        sin, cos = acausal.sin, acausal.cos
        yield der(self.a) == self.w
        yield der(self.b) == self.u
        yield der(self.s) == self.v
        # f acts from the crank on the rod, g from the rod on the slider
        yield self.J1 * der(self.w) == 2.0 + self.l1 * (self.fx * sin(self.a) - self.fy * cos(self.a))
        yield self.x2 == self.l1 * cos(self.a) + self.l2 / 2 * cos(self.b)
        yield self.y2 == self.l1 * sin(self.a) + self.l2 / 2 * sin(self.b)
        yield self.vx == der(self.x2)
        yield self.vy == der(self.y2)
        yield self.m2 * der(self.vx) == self.fx - self.gx
        yield self.m2 * der(self.vy) == self.fy - self.gy - 9.81 * self.m2
        half = self.l2 / 2
        yield self.J2 * der(self.u) == half * ((self.fx + self.gx) * sin(self.b) - (self.fy + self.gy) * cos(self.b))
        yield self.m3 * der(self.v) == self.gx - 0.5 * self.v
        yield self.s == self.l1 * cos(self.a) + self.l2 * cos(self.b)
        yield self.l1 * sin(self.a) == -self.l2 * sin(self.b)

    def energy(self, r: acausal.Result) -> np.ndarray:
        """Kinetic and potential energy, less the work of the torque."""
        kinetic = 0.02 * r["w"] ** 2 + 0.01 * r["u"] ** 2 + 0.8 * (r["vx"] ** 2 + r["vy"] ** 2) + 0.5 * r["v"] ** 2
        return 0.5 * kinetic + 9.81 * 0.8 * r["y2"] - 2.0 * r["a"]


@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_a_slider_crank_turns(solver: str) -> None:
    """Torn and whole agree, and the energy falls by what the friction of the slider takes: 0.5 v^2."""
    torn, whole = (
        acausal.simulate(
            acausal.compile(Crank(), formulation=form),
            stop_time=1.0,
            tolerance=1e-8,
            solver=solver,
            output_interval=1e-3,
        )
        for form in ("torn", "dae")
    )
    for name in ("a", "w", "b", "s", "v"):
        size = float(np.max(np.abs(torn[name])))
        np.testing.assert_allclose(whole[name], torn[name], rtol=0, atol=2e-6 * size, err_msg=name)
    energy = Crank().energy(whole)
    lost = np.trapezoid(0.5 * whole["v"] ** 2, whole.time)
    assert whole.final("a") > 2 * math.pi
    assert energy[0] - energy[-1] == pytest.approx(lost, abs=1e-4)


class Gate(Component):
    """An inverter: a transistor of a square law behind a resistor, another to the supply: two implicit unknowns."""

    R: Real = parameter(default=1e4)
    C: Real = parameter(default=1e-9)
    input: Real = variable()
    output: Real = variable(default=guess(1.0))
    drain: Real = variable(default=guess(1.0))
    i: Real = variable(nominal=1e-4)
    q: Real = variable(default=fixed(0.0), nominal=1e-9)

    def equations(self) -> Equations:
        over = maximum(self.input - 1.0, 0.0)
        triode = (over - self.drain / 2) * self.drain
        yield self.i == 2e-3 * where(self.drain < over, triode, over * over / 2, smooth=True)
        yield self.output - self.drain == 300.0 * self.i
        yield self.q == self.C * self.output
        yield der(self.q) == (5.0 - self.output) / self.R - self.i


class TwoGates(Component):
    first: Gate = Gate()
    second: Gate = Gate(R=3e4, C=5e-10)

    def equations(self) -> Equations:
        yield self.first.input == 2.5 + 2.5 * acausal.sin(2 * math.pi * 1e4 * acausal.time)
        yield self.second.input == self.first.output


class Lines(Component):
    """A bridge of ideal diodes behind an inductance; source and currents are zero at the start."""

    V: SineVoltage = SineVoltage(V=325.0, f=60.0)
    line: Inductor = Inductor(L=2e-3, i=fixed(0.0))
    diodes: list[IdealDiode] = part()
    C: Capacitor = Capacitor(C=4e-4, v=fixed(80.0))
    load: Resistor = Resistor(R=60.0)
    ground: Ground = Ground()

    def build(self) -> None:
        self.diodes = [IdealDiode(Ron=1e-4, Goff=1e-5) for _ in range(4)]

    def equations(self) -> Equations:
        a, b, c, d = self.diodes
        yield connect(self.V.p, self.line.p)
        yield connect(self.line.n, a.p, b.n)
        yield connect(self.V.n, c.p, d.n, self.ground.p)
        yield connect(a.n, c.n, self.C.p, self.load.p)
        yield connect(b.p, d.p, self.C.n, self.load.n)


@pytest.mark.parametrize("tolerance", [1e-6, pytest.param(1e-9, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("model", "stop"), [(TwoGates, 3e-4), (Lines, 0.04)])
def test_circuits_end_as_torn_ones(model: type[Component], stop: float, tolerance: float) -> None:
    whole = acausal.compile(model(), formulation="dae")
    assert whole.algebraic
    torn = acausal.simulate(model(), stop_time=stop, tolerance=1e-10)
    found = acausal.simulate(whole, stop_time=stop, tolerance=tolerance, solver="rosenbrock")
    for name in whole.states:
        size = float(np.max(np.abs(torn[name])))
        assert found.final(name) == pytest.approx(torn.final(name), abs=(10 * tolerance + 1e-9) * size), name
    assert len(found.events) == len(torn.events)


class Rest(Component):
    """A mass between two forces of meganewtons that are equal: its acceleration is what rounding leaves of them."""

    s: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))
    a: Real = variable()
    push: Real = variable()
    pull: Real = variable()

    def equations(self) -> Equations:
        yield der(self.s) == self.v
        yield der(self.v) == self.a
        yield 1e-3 * self.a == self.push - self.pull - 30.0 * self.v
        yield self.push == 1e6 * (1.0 + 0.1 * acausal.sin(acausal.time)) * (2.0 - self.s)
        yield self.pull == 1e6 * (1.0 + 0.1 * acausal.sin(acausal.time)) * self.s**3


def test_an_acceleration_that_is_a_small_difference_rules_no_step() -> None:
    """IDAS leaves algebraic variables out of its error test: it takes a few dozen steps for the rest at s = 1."""
    found = acausal.simulate(
        acausal.compile(Rest(), formulation="dae"), stop_time=1.0, tolerance=1e-9, solver="rosenbrock"
    )
    assert np.abs(found["s"] - 1.0).max() < 1e-9
    steps = found.stats["steps"]
    assert isinstance(steps, float)
    assert steps < 3000


@pytest.mark.slow
@pytest.mark.parametrize(("model", "stop"), [(SpindleStall, 2.0), (ForceControlledDrilling, 1.0)])
def test_drills_in_a_spindle(model: type[Component], stop: float) -> None:
    """Both stopped with AC401 or crawled for minutes, with eight algebraic variables, at 1e-7."""
    torn, whole = (
        acausal.simulate(acausal.compile(model(), formulation=f), stop_time=stop, tolerance=1e-7, solver="rosenbrock")
        for f in ("torn", "dae")
    )
    for name in acausal.compile(model()).states:
        size = max(1e-3, float(np.max(np.abs(torn[name]))))
        assert whole.final(name) == pytest.approx(torn.final(name), abs=1e-6 * size), name


# Shipped models with blocks, and a span [s] in which each of them does something.
MODELS = [
    ("pendulum", "Pendulum", 0.5),
    ("double_pendulum", "DoublePendulum", 0.5),
    ("pendulum_chain", "PendulumChain", 0.3),
    ("mass_chain", "MassSpringDamperChain", 1.0),
    ("rc_ladder", "RCLadder", 1.0),
    ("drilling_dynamic", "ThickBlock", 1.0),
    ("ivp.car_axis", "CarAxis", 0.3),
    ("ivp.planar_pendulum", "PlanarPendulum", 0.5),
]


@pytest.mark.parametrize(("module", "name", "stop"), MODELS, ids=[name for _, name, _ in MODELS])
def test_shipped_models(module: str, name: str, stop: float) -> None:
    model: type[Component] = getattr(import_module(f"acausal.models.{module}"), name)
    torn, whole = (acausal.compile(model(), formulation=f) for f in ("torn", "dae"))
    assert set(torn.algebraic) <= set(whole.algebraic) or not torn.algebraic
    assert torn.states == whole.states
    a, b = (acausal.simulate(c, stop_time=stop, tolerance=1e-8, solver="idas") for c in (torn, whole))
    for state in torn.states:
        size = float(np.max(np.abs(a[state]))) + 1e-3
        np.testing.assert_allclose(b[state], a[state], rtol=0, atol=3e-5 * size, err_msg=state)


class Circle(Component):
    """A point mass on a circle in x and y: neither can be the state all the way round, so all are kept, stabilised."""

    g: Real = parameter(default=9.81)
    x: Real = variable(default=fixed(0.6))
    y: Real = variable(default=guess(-0.7))
    v: Real = variable(default=guess(5.0))
    w: Real = variable(default=fixed(4.2))
    tension: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.y) == self.w
        yield der(self.v) == -self.tension * self.x
        yield der(self.w) == -self.tension * self.y - self.g
        yield self.x * self.x + self.y * self.y == 1.0

    def energy(self, r: acausal.Result) -> np.ndarray:
        return 0.5 * (r["v"] ** 2 + r["w"] ** 2) + 9.81 * r["y"]


def test_a_stabilised_pendulum_turns_on_its_circle() -> None:
    """It starts at (0.6, -0.8) with 7 m/s along the circle: 24.5 - 7.848 J/kg, more than the 9.81 of the top."""
    model = Circle()
    compiled = acausal.compile(model)
    assert compiled.solution.structure.invariants
    result = acausal.simulate(compiled, stop_time=30.0, tolerance=1e-9)
    x, y = result["x"], result["y"]
    assert np.max(np.abs(x * x + y * y - 1.0)) < 1e-8
    assert np.max(np.abs(x * result["v"] + y * result["w"])) < 1e-8
    energy = model.energy(result)
    assert energy[0] == pytest.approx(24.5 - 0.8 * 9.81, abs=1e-6)
    assert np.max(np.abs(energy - energy[0])) < 1e-4
    turns = np.unwrap(np.arctan2(y, x))
    assert turns[-1] - turns[0] > 20 * np.pi
    # the pull is what the circular motion and the weight ask for: m (v^2 + w^2)/r - m g y/r
    np.testing.assert_allclose(result["tension"], result["v"] ** 2 + result["w"] ** 2 - 9.81 * y, rtol=0, atol=1e-4)
