"""Linearizations against textbook matrices and against differences of the simulation."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    connect,
    der,
    discrete,
    fixed,
    guess,
    parameter,
    part,
    quantity,
    signal_input,
    sqrt,
    unitless,
    variable,
    where,
)
from acausal.errors import ExportError, UsageError
from acausal.library.contact import ContactBody, ContactScene, HalfSpace, HuntCrossley, Sphere, Surfaces
from acausal.library.multibody import Body, World
from acausal.models.double_pendulum import DoublePendulum
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.oscillator import Oscillator
from acausal.models.pendulum import Pendulum
from acausal.optimal_control import Problem
from tests.expected import fails_with
from tests.export.scenes import DrivenSlider, Slider


def test_oscillator() -> None:
    """A = [[0, 1], [-c/m, -d/m]]; m = 1 kg, c = 100 N/m, d = 1 N.s/m. The spring's force is c*s."""
    linear = acausal.linearize(Oscillator(), outputs=["spring.f", "mass.a"])
    assert linear.states == ("mass.s", "mass.v")
    np.testing.assert_allclose(linear.A, [[0.0, 1.0], [-100.0, -1.0]], atol=1e-12)
    np.testing.assert_allclose(linear.C, [[100.0, 0.0], [-100.0, -1.0]], atol=1e-12)
    np.testing.assert_allclose(linear.eigenvalues, -0.5 + 1j * np.sqrt(99.75) * np.array([1, -1]), rtol=1e-12)
    # It is released at 0.1 m, where it accelerates with c*s/m.
    np.testing.assert_allclose(linear.rates, [0.0, -10.0])


def test_pendulum_at_rest_swings_with_its_natural_frequency() -> None:
    """A point mass of 1 kg at 0.5 m, inertia 0.001 kg.m2: omega**2 = m g l / (m l**2 + I)."""
    linear = acausal.linearize(Pendulum(), x={"revolute.phi": -math.pi / 2})
    square = 9.80665 * 0.5 / (0.25 + 0.001)
    assert np.abs(linear.eigenvalues.imag) == pytest.approx([math.sqrt(square)] * 2, rel=1e-4)
    np.testing.assert_allclose(linear.rates, 0.0, atol=1e-12)


def test_inputs_and_outputs() -> None:
    """power = u v about u = 3 N, v = 2 m/s; parameters change without a new model."""
    compiled = acausal.compile(Slider())
    linear = acausal.linearize(compiled, x={"mass.v": 2.0}, inputs={"u": 3.0}, parameters={"m": 4.0})
    np.testing.assert_allclose(linear.B, [[0.0], [0.25]])
    np.testing.assert_allclose(linear.C, [[0.0, 3.0]])
    np.testing.assert_allclose(linear.D, [[2.0]])
    np.testing.assert_allclose(linear.y, [6.0])
    assert (linear.inputs, linear.outputs) == (("u",), ("power",))


def test_algebraic_variables_are_eliminated() -> None:
    """u = i + i**3 at u = 2: i = 1 and di/du = 1/4, which is also the acceleration of 1 kg."""
    linear = acausal.linearize(DrivenSlider(), inputs={"u": 2.0})
    np.testing.assert_allclose(linear.B, [[0.0], [0.25]], atol=1e-12)
    np.testing.assert_allclose(linear.D, [[0.25]], atol=1e-12)
    np.testing.assert_allclose(linear.y, [1.0], rtol=1e-10)


def test_at_a_time_of_a_run() -> None:
    """While drilling steadily dF_f/ds is the contact stiffness in series with the cut, below k = 1e8 N/m.

    Expected values by differences of the exported equations, with the algebraic variable solved again.
    """
    compiled = acausal.compile(ThickBlock())
    run = acausal.simulate(compiled, stop_time=15.0)
    linear = acausal.linearize(compiled, result=run, outputs=["drill.F_f"])
    assert linear.t == 15.0
    assert linear.y[0] == pytest.approx(2000.0, rel=1e-6)
    model = compiled.casadi(["drill.F_f"])
    step = 1e-9
    for k in (0, 3):
        ends = []
        for side in (-1, 1):
            x = linear.x.copy()
            x[k] += side * step
            ends.append(float(model.ode(15.0, x, [], model.p.start)[1]))
        assert linear.C[0, k] == pytest.approx((ends[1] - ends[0]) / (2 * step), rel=1e-4)
    assert 0.9e8 < linear.C[0, 0] < 1e8


def test_a_run_brings_its_parameters_and_inputs() -> None:
    run = acausal.simulate(Slider(), inputs={"u": 3.0}, parameters={"m": 2.0}, stop_time=1.0)
    linear = acausal.linearize(Slider(), result=run)
    np.testing.assert_allclose(linear.u, [3.0])
    np.testing.assert_allclose(linear.x, [0.75, 1.5], rtol=1e-6)
    np.testing.assert_allclose(linear.B, [[0.0], [0.5]])


class Damped(Component):
    """x'' = -k x - d x', with d = 2 k unless it is given."""

    k: Real = parameter(default=4.0)
    d: Real = parameter(default=lambda self: 2.0 * self.k)
    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.k * self.x - self.d * self.v


@pytest.mark.parametrize("suffix", ["", ".mat", ".npz", ".csv"])
def test_parameters_of_a_run_are_those_of_its_file(suffix: str, tmp_path: Path) -> None:
    """A = [[0, 1], [-k, -d]]; a CSV does not say which of its columns are parameters, and d = 5 is not 2 k."""
    for values, k, d in (({"k": 9.0}, 9.0, 18.0), ({"d": 5.0}, 4.0, 5.0)):
        run = acausal.simulate(Damped(), parameters=values, stop_time=0.1)
        if suffix:
            run.save(tmp_path / f"run{suffix}")
            run = acausal.load(tmp_path / f"run{suffix}")
        np.testing.assert_allclose(acausal.linearize(Damped(), result=run).A, [[0.0, 1.0], [-k, -d]])
    with fails_with(UsageError, "AC022", match="d follows"):
        acausal.linearize(acausal.compile(Damped()), result=run)


def test_parameters_that_a_file_lacks_are_noted(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("time,x,v\n0,1,0\n1,1,0\n")
    found = acausal.linearize(Damped(), result=acausal.load(tmp_path / "run.csv"))
    assert found.notes == ("the result does not contain k: as declared",)


@pytest.mark.parametrize("compiled", [False, True])
def test_parameters_that_are_given_are_not_those_of_the_run(compiled: bool) -> None:
    """B = 1/m, with the mass of the run or another one; the inputs stay those of the run."""
    run = acausal.simulate(Slider(), inputs={"u": 3.0}, parameters={"m": 2.0}, stop_time=1.0)
    model = acausal.compile(Slider()) if compiled else Slider()
    linear = acausal.linearize(model, result=run, parameters={"m": 4.0})
    np.testing.assert_allclose(linear.B, [[0.0], [0.25]])
    np.testing.assert_allclose(linear.u, [3.0])


def test_states_between_the_rows_of_a_file_are_noted(tmp_path: Path) -> None:
    """A file has rows only; a run just made has the solution between them, and its rows are those of the file."""
    run = acausal.simulate(Oscillator(), stop_time=1.0, output_interval=0.25)
    run.save(tmp_path / "run.npz")
    file = acausal.load(tmp_path / "run.npz")
    for result, t, noted in ((run, 0.3, False), (file, 0.25, False), (file, 0.3, True)):
        notes = acausal.linearize(Oscillator(), t, result=result).notes
        assert any("interpolated" in note for note in notes) == noted


def test_unknown_names() -> None:
    cases: tuple[dict[str, Any], ...] = ({"x": {"mass.w": 1.0}}, {"outputs": ["mass.w"]})
    for keywords in cases:
        with fails_with(UsageError, "AC010", match=r"mass\.w") as caught:
            acausal.linearize(Slider(), **keywords)
        assert "mass.v" in str(caught.value)
    with pytest.raises(UsageError, match="no input 'force'"):
        acausal.linearize(Slider(), inputs={"force": 1.0})


class Dragged(Component):
    """A body that moves across a fluid in x and y: drag along the velocity, by the power 1.5 of its size."""

    u: Real = signal_input(unit="1/s2", default=0.0)
    x: Real = variable(default=fixed(0.0), unit="1/s")
    y: Real = variable(default=fixed(0.0), unit="1/s")

    def equations(self) -> Equations:
        size = sqrt(self.x**2 + self.y**2)
        yield der(self.x) == self.u - self.x * sqrt(unitless(size)) * quantity(1.0, "1/s")
        yield der(self.y) == -self.y * sqrt(unitless(size)) * quantity(1.0, "1/s")


def test_a_length_that_vanishes_has_no_slope_and_is_no_nan() -> None:
    """At rest the drag grows with the power 1.5, its slope is 0; roots of zero alone would make it 0 * infinity."""
    linear = acausal.linearize(Dragged())
    np.testing.assert_array_equal(linear.A, np.zeros((2, 2)))
    np.testing.assert_array_equal(linear.B, [[1.0], [0.0]])


def test_second_derivatives_of_optimal_control_are_numbers_there() -> None:
    """ipopt evaluates the Hessian at whatever guess it is given, at rest as well."""
    dae = Problem(Dragged()).quantities.dae()
    x = ca.SX.sym("x", 2)
    rates = dae(0.0, x, [], 0.0, [])[0]
    hessian = ca.Function("H", [x], [ca.hessian(ca.sum1(rates), x)[0]])
    assert hessian([0.0, 0.0]).is_regular()


class Knee(Component):
    """a + 0.5 b = x, b = 4 (a - 1) where a > 1, else (a - 1): the relation is inside the loop. x' = 3 b."""

    x: Real = variable(default=fixed(0.0))
    a: Real = variable()
    b: Real = variable()

    def equations(self) -> Equations:
        yield self.a + 0.5 * self.b == self.x
        yield self.b == where(self.a > 1.0, 4.0 * (self.a - 1.0), self.a - 1.0)
        yield der(self.x) == 3.0 + 0.0 * self.b


def test_a_relation_in_an_algebraic_loop_is_decided_at_the_point() -> None:
    """db/dx = 1/1.5 below x = 1, 4/3 above it: at the start, at given states, at times of a run (x = 3 t)."""
    compiled = acausal.compile(Knee())
    run = acausal.simulate(compiled, stop_time=1.0, tolerance=1e-9)
    for x in (0.0, 0.5, 0.9, 1.1, 2.0, 2.9):
        slope, b = (4.0 / 3.0, 4.0 / 3.0 * (x - 1.0)) if x > 1.0 else (1.0 / 1.5, (x - 1.0) / 1.5)
        for found in (
            acausal.linearize(compiled, x={"x": x}, outputs=["b"]),
            acausal.linearize(compiled, x / 3.0, result=run, outputs=["b"]),
            acausal.linearize(compiled, 0.0, {"x": x}, result=run, outputs=["b"]),
        ):
            assert found.y[0] == pytest.approx(b, abs=1e-7)
            assert found.C[0, 0] == pytest.approx(slope, rel=1e-9)


class Loaded(Component):
    """A mass of 1 kg on a spring whose stiffness only events change, of which there are none."""

    k: Real = discrete(unit="N/m", default=fixed(4.0))
    x: Real = variable(unit="m", default=guess(1.0))
    v: Real = variable(unit="m/s", default=guess(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == (quantity(8.0, "N") - self.k * self.x) / quantity(1.0, "kg")


def test_discrete_variables_are_parameters_of_the_motion() -> None:
    """omega**2 = k/m and x = F/k, k as at the start or as given; a state that never moves would be a zero row of A."""
    linear = acausal.linearize(Loaded())
    assert linear.states == ("x", "v")
    np.testing.assert_allclose(linear.A, [[0.0, 1.0], [-4.0, 0.0]], atol=1e-12)
    assert acausal.linearize(Loaded(), x={"k": 9.0}).A[1, 0] == pytest.approx(-9.0)
    for given, k in (({}, 4.0), ({"k": 16.0}, 16.0)):
        point = acausal.operating_point(Loaded(), guess=given)
        assert point.states == pytest.approx({"x": 8.0 / k, "v": 0.0, "k": k})
        assert not point.notes


class Swing(Component):
    """A point mass on a circle of radius 2, in x and y: no fixed choice of two states is safe."""

    x: Real = variable(default=fixed(0.5))
    y: Real = variable(default=guess(-1.0))
    vx: Real = variable(default=fixed(0.0))
    vy: Real = variable()
    f: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.vx
        yield der(self.y) == self.vy
        yield der(self.vx) == -self.x * self.f
        yield der(self.vy) == -self.y * self.f - 9.81
        yield self.x**2 + self.y**2 == 4.0


def test_only_the_modes_of_the_motion_are_left() -> None:
    """At rest below: omega**2 = g / l."""
    linear = acausal.linearize(Swing(), x={"x": 0.0, "vx": 0.0}, outputs=["y", "f"])
    assert linear.states == ("x", "vx")
    np.testing.assert_allclose(linear.A, [[0.0, 1.0], [-9.81 / 2.0, 0.0]], atol=1e-12)
    # y has its lowest value there, and the force depends on the square of the velocity
    np.testing.assert_allclose(linear.C, 0.0, atol=1e-12)
    np.testing.assert_allclose(linear.y, [-2.0, 9.81 / 2.0], rtol=1e-12)
    np.testing.assert_allclose(linear.rates, 0.0, atol=1e-12)


def test_the_coordinates_are_those_that_determine_the_others_best_at_the_point() -> None:
    """At the height of the pivot, y moves and x stands still: x'' = -v**2/l, y'' = -g."""
    linear = acausal.linearize(Swing(), x={"x": 2.0, "y": 0.0, "vy": 0.0})
    assert linear.states == ("y", "vy")
    np.testing.assert_allclose(linear.rates, [0.0, -9.81], atol=1e-12)


def test_states_off_the_constraints_are_refused() -> None:
    with pytest.raises(ExportError, match="AC609"):
        acausal.linearize(Swing(), x={"x": 1.0, "y": 1.0})


def test_states_that_are_not_named_follow() -> None:
    linear = acausal.linearize(Swing(), x={"x": 1.2}, outputs=["y"])
    assert linear.y[0] == pytest.approx(-1.6)


def test_chosen_and_stabilised_states_have_the_same_modes() -> None:
    """Both hang straight down, where the modes of a system do not depend on its coordinates."""
    down = {"revolute1.phi": -math.pi / 2, "revolute1.w": 0.0, "revolute2.phi": 0.0, "revolute2.w": 0.0}
    found = []
    for formulation in ("torn", "projected"):
        compiled = acausal.compile(DoublePendulum(), formulation=formulation)
        linear = acausal.linearize(compiled, x=down)
        np.testing.assert_allclose(linear.rates, 0.0, atol=1e-10)
        np.testing.assert_allclose(linear.eigenvalues.real, 0.0, atol=1e-7)
        found.append(np.sort(linear.eigenvalues.imag))
    assert len(found[0]) == len(found[1]) == 4
    np.testing.assert_allclose(found[1], found[0], atol=1e-7)


class Telescope(Component):
    """A pendulum in x and y, whose length only events change."""

    length: Real = discrete(unit="m", default=fixed(1.0))
    x: Real = variable(unit="m", default=guess(0.6))
    y: Real = variable(unit="m", default=guess(-0.8))
    vx: Real = variable(unit="m/s")
    vy: Real = variable(unit="m/s")
    f: Real = variable(unit="1/s2")

    def equations(self) -> Equations:
        yield der(self.x) == self.vx
        yield der(self.y) == self.vy
        yield der(self.vx) == -self.x * self.f
        yield der(self.vy) == -self.y * self.f - quantity(9.81, "m/s2")
        yield self.x**2 + self.y**2 == self.length**2


def test_no_constraint_changes_a_discrete_variable() -> None:
    """omega**2 = g / l; a place off the circle of the present length is refused, not a reason for another length."""
    linear = acausal.linearize(Telescope(), x={"length": 1.2, "x": 0.0, "vx": 0.0})
    assert linear.states == ("x", "vx")
    np.testing.assert_allclose(linear.A, [[0.0, 1.0], [-9.81 / 1.2, 0.0]], atol=1e-12)
    with pytest.raises(ExportError, match="AC609"):
        acausal.linearize(Telescope(), x={"x": 0.0, "y": -1.2})


K = 1e4


class Tower(Component):
    """A ball of 2 kg upon one of 1 kg; one pair at a time stays in the equations for the whole run."""

    world: World = World(n=(0.0, 0.0, -1.0))
    balls: list[Body] = part()
    scene: ContactScene = part()

    def build(self) -> None:
        self.balls = [
            Body(
                m=1.0 + k,
                r_0=fixed((0.0, 0.0, 0.05 + 0.1 * k)),
                v_0=fixed((0.0, 0.0, 0.0)),
                Q=fixed((0.0, 0.0, 0.0, 1.0)),
                w_a=fixed((0.0, 0.0, 0.0)),
            )
            for k in range(2)
        ]
        bodies = [ContactBody(name=f"ball{k}", shape=Sphere(0.05)) for k in range(2)]
        ground = ContactBody(name="ground", shape=HalfSpace(), at_rest=True)
        surfaces = Surfaces(law=HuntCrossley(k=K, n=1.0, e=0.1, v_0=0.01))
        self.scene = ContactScene(bodies=(ground, *bodies), surfaces=surfaces, keep=1)

    def equations(self) -> Equations:
        for k, ball in enumerate(self.balls):
            yield connect(ball.frame_a, self.scene.frame(f"ball{k}"))


def test_a_tower_has_the_stiffness_matrix_of_its_springs() -> None:
    """M^-1 K with springs k to the ground and between the balls: [[-2k, k], [k, -k]] over 1 kg and 2 kg.

    Nearly at rest (the tower topples by rounding errors within four seconds). The run calls contacts by the names of
    the bodies, the model by number. Only rounding errors turn the balls, which are no kinks.
    """
    compiled = acausal.compile(Tower())
    run = acausal.simulate(compiled, stop_time=1.5, tolerance=1e-9)
    for model in (compiled, Tower()):
        linear = acausal.linearize(model, result=run)
        places = ([linear.states.index(f"balls[{k}].{name}[2]") for k in (0, 1)] for name in ("v_0", "r_0"))
        np.testing.assert_allclose(linear.A[np.ix_(*places)], K * np.array([[-2.0, 1.0], [0.5, -0.5]]), rtol=1e-2)
        assert np.isfinite(linear.A).all()
