"""The exported functions against the simulator, at instants, and the start of loops of joints."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    change,
    connect,
    der,
    discrete,
    fabs,
    fixed,
    guess,
    integer,
    log,
    parameter,
    pre,
    quantity,
    reset,
    signal_output,
    sin,
    structural,
    time,
    variable,
    when,
    where,
)
from acausal.errors import UsageError
from acausal.export.step.methods import METHODS
from acausal.library.multibody import Body, Fixed, FreeMotion, Prismatic, Universal, World
from acausal.lower.casadi_model import CasadiModel
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.pendulum import Pendulum
from tests.expected import fails_with
from tests.export.scenes import DrivenSlider, Slider, numbers, timed


def integrated(model: CasadiModel, stop: float, tolerance: float = 1e-9) -> NDArray[np.float64]:
    """States at `stop`, by CasADi's IDAS straight from `dae`, restarted where sources switch."""
    t = ca.SX.sym("t")
    x, z, p = (ca.SX.sym(n, model.dae.size1_in(n)) for n in "xzp")
    ode, alg, _ = model.dae(*timed(model, t), x, z, [], p)
    problem = {"t": t, "x": x, "z": z, "p": p, "ode": ode, "alg": alg}
    values = np.array(model.p.start)
    here, algebraic = model.init(values)
    switches = {float(s) for s in numbers(model.instants(values)) if 0.0 < s < stop}
    for begin, end in pairwise([0.0, *sorted(switches), stop]):
        options = {
            "reltol": tolerance,
            "abstol": 1e-13,
            "max_num_steps": 10**6,
            "suppress_algebraic": True,
            "init_xdot": numbers(model.dae(*timed(model, begin), here, algebraic, [], values)[0]).tolist(),
            "calc_ic": False,
        }
        found = ca.integrator("run", "idas", problem, begin, end, options)(x0=here, z0=algebraic, p=values)
        here, algebraic = found["xf"], found["zf"]
    return np.array(here).ravel()


def test_dae_of_the_pendulum_moves_like_the_simulation() -> None:
    model = acausal.compile(Pendulum()).casadi()
    run = acausal.simulate(Pendulum(), stop_time=3.0, tolerance=1e-10)
    expected = np.array([run.final(n) for n in model.x.names])
    np.testing.assert_allclose(integrated(model, 3.0), expected, rtol=0.0, atol=1e-6)


def test_dae_of_the_drill_moves_like_the_simulation() -> None:
    """With its time events inlined and its force solved inside; 8 s is past the touch and the start of the spindle."""
    model = acausal.compile(ThickBlock()).casadi()
    assert len(model.z) == 0
    run = acausal.simulate(ThickBlock(), stop_time=8.0, tolerance=1e-9)
    found = dict(zip(model.x.names, integrated(model, 8.0), strict=True))
    for name in ("slide.s", "drill.s_tar"):
        assert found[name] == pytest.approx(run.final(name), abs=1e-9)
    assert found["spindle.phi"] == pytest.approx(2 * math.pi * 9.28 * 2.5, rel=1e-9)


class Rectified(Component):
    """A capacitor charged from a sine through a resistor and a diode, whose current is iterated upon."""

    u: Real = variable(default=fixed(0.0), unit="V")
    i: Real = variable(unit="A", nominal=1e-3)

    def equations(self) -> Equations:
        yield der(self.u) == self.i / quantity(1e-4, "F")
        drop = quantity(0.025, "V") * log(1.0 + fabs(self.i) / quantity(1e-6, "A"))
        across = where(self.i > 0.0, drop, -drop, smooth=True)
        yield (
            quantity(2.0, "V") * sin(quantity(6.0, "rad/s") * time) == self.u + quantity(100.0, "Ohm") * self.i + across
        )


def test_ode_is_dae_with_the_algebraic_variables_solved() -> None:
    """Along the whole run, though the iteration always starts from the same z."""
    compiled = acausal.compile(Rectified())
    model = compiled.casadi()
    assert len(model.z) == 1
    run = acausal.simulate(compiled, stop_time=1.0, tolerance=1e-10)
    p = model.p.start
    for k in range(0, len(run.time), 23):
        t, x, z = run.time[k], [run[n][k] for n in model.x.names], [run[n][k] for n in model.z.names]
        rate, *_ = model.dae(t, x, z, [], p)
        xdot, _ = model.ode(t, x, [], p)
        np.testing.assert_allclose(numbers(xdot), numbers(rate), rtol=1e-6, atol=1e-6)


def test_ode_is_twice_differentiable_through_its_rootfinder() -> None:
    """u = i + i**3, so di/du = 1/(1 + 3 i**2) and d2i/du2 = -6 i/(1 + 3 i**2)**3; at u = 2, i = 1."""
    model = acausal.compile(DrivenSlider()).casadi(["drive.i"])
    assert model.ode.is_a("MXFunction")
    u = ca.MX.sym("u")
    current = model.ode([0.0, 0.0], u, model.p.start)[1]
    second, first = ca.hessian(current, u)
    f = ca.Function("f", [u], [current, first, second])
    np.testing.assert_allclose(numbers(f(2.0)), [1.0, 1 / 4, -6 / 64], rtol=1e-9)


def test_functions_without_algebraic_variables_are_plain_expressions() -> None:
    model = acausal.compile(Slider()).casadi()
    for f in (model.dae, model.ode, model.init):
        assert f.is_a("SXFunction")
    names = {f.name(): (f.name_in(), f.name_out()) for f in (model.dae, model.ode, model.init)}
    assert names == {
        "dae": (["x", "z", "u", "p"], ["ode", "alg", "y"]),
        "ode": (["x", "u", "p"], ["xdot", "y"]),
        "init": (["p"], ["x0", "z0"]),
    }
    xdot, y = model.ode([0.0, 2.0], 3.0, model.p.start)
    np.testing.assert_allclose(numbers(xdot), [2.0, 3.0])
    np.testing.assert_allclose(numbers(y), [6.0])


class Tank(Component):
    """Outflow of a tank whose start is its steady state: sqrt(h) == q, a nonlinear start problem."""

    q: Real = parameter(default=2.0, unit="1", doc="Inflow")
    h: Real = variable(default=guess(1.0), unit="1", nominal=4.0, min=0.0, max=50.0, doc="Level")
    tau: Real = parameter(default=1.0, unit="s")

    def equations(self) -> Equations:
        yield self.tau * der(self.h) == self.q - acausal.sqrt(self.h)

    def initial_equations(self) -> Equations:
        yield der(self.h) == 0.0


def test_init_solves_for_free_states() -> None:
    """h = q**2 for every q, with derivative 2 q, though found by iteration."""
    model = acausal.compile(Tank()).casadi()
    q = ca.MX.sym("q")
    x0, _ = model.init(ca.vertcat(*(q if n == "q" else v for n, v in zip(model.p.names, model.p.start, strict=True))))
    f = ca.Function("f", [q], [x0, ca.jacobian(x0, q)])
    for value in (2.0, 3.0):
        np.testing.assert_allclose(numbers(f(value)), [value**2, 2 * value], rtol=1e-9)
    assert model.x[0].start == pytest.approx(4.0)
    assert (model.x[0].name, model.x[0].nominal, model.x[0].min, model.x[0].max) == ("h", 4.0, 0.0, 50.0)


def test_start_conditions_follow_the_parameters() -> None:
    """ThickBlock starts `gap` above the block."""
    model = acausal.compile(ThickBlock()).casadi()
    p = np.array(model.p.start)
    p[model.p.position("gap")] = 5e-3
    x0, _ = model.init(p)
    assert float(x0[model.x.position("slide.s")]) == pytest.approx(-5e-3, abs=1e-15)


def test_description_of_every_entry() -> None:
    model = acausal.compile(DrivenSlider()).casadi()
    assert [p.name for p in model.x] == ["mass.s", "mass.v"]
    assert [p.unit for p in model.x] == ["m", "m/s"]
    (i,), (u,), (y,) = model.z, model.u, model.y
    assert (i.name, i.unit, i.doc, i.min, i.max) == ("drive.i", "A", "Current", -10.0, 20.0)
    assert (u.name, u.unit, u.doc, u.start, u.max) == ("u", "V", "Voltage of the drive", 0.0, math.inf)
    assert (y.name, y.unit) == ("current", "A")
    assert dict(zip(model.p.names, model.p.start, strict=True))["drive.S"] == 1.0
    assert model.p[model.p.position("mass.m")].min == 0.0
    with pytest.raises(UsageError, match="not in this vector") as caught:
        model.p.position("drive.r")
    assert "drive.R" in str(caught.value)


def test_outputs_by_name_arrays_entry_by_entry() -> None:
    compiled = acausal.compile(Pendulum())
    model = compiled.casadi(["body.frame_a.R", "revolute.phi"])
    assert model.y.names[:2] == ("body.frame_a.R[0,0]", "body.frame_a.R[0,1]")
    assert model.y.names[-1] == "revolute.phi"
    angle = 0.3
    y = numbers(model.dae([angle, 0.0], [], [], model.p.start)[2])
    # World axes of the body's own: turned by the angle about z.
    c, s = math.cos(angle), math.sin(angle)
    np.testing.assert_allclose(y, [c, -s, 0, s, c, 0, 0, 0, 1, angle], atol=1e-15)
    with fails_with(UsageError, "AC010", match=r"no variable 'revolute\.phy'") as caught:
        compiled.casadi(["revolute.phy"])
    assert "revolute.phi" in str(caught.value)


SPELLINGS: dict[str, Any] = {
    "time > p": lambda p: time > p,
    "time >= p": lambda p: time >= p,
    "p < time": lambda p: p < time,
    "p <= time": lambda p: p <= time,
    "~(time < p)": lambda p: ~(time < p),
    "~(time <= p)": lambda p: ~(time <= p),
    "-time < -p": lambda p: -time < -p,
    "3 time >= 3 p": lambda p: 3.0 * time >= 3.0 * p,
    "time / 3 > p / 3": lambda p: time / 3.0 > p / 3.0,
    "time - p > 0": lambda p: time - p > 0.0,
}


class Switched(Component):
    """x' = 5 after the instant p, 2 before it."""

    p: Real = parameter(default=0.7)
    on: str = structural()
    x: Real = variable(default=fixed(0.0))
    y: Real = signal_output()

    def equations(self) -> Equations:
        yield self.y == where(SPELLINGS[self.on](self.p), 5.0, 2.0)
        yield der(self.x) == self.y * (1.0 + self.x)


@pytest.mark.parametrize("on", SPELLINGS)
def test_functions_take_the_value_after_a_switch(on: str) -> None:
    """Each of many instants p, whose products and quotients round either way; the value before is 2, after 5."""
    compiled = acausal.compile(Switched(on=on))
    plain, events = compiled.casadi(), compiled.casadi(events=True).events
    assert events is not None
    for p in (0.7, 0.1, 0.3, 1.1, 2.3, 1e-3, 7.7e3):
        at = float(plain.instants([p]))
        assert at == pytest.approx(p, rel=1e-14)
        for t, rate in ((at * (1 - 1e-9), 2.0), (at, 5.0), (at * (1 + 1e-9), 5.0)):
            assert float(plain.ode(t, 0.0, [], [p])[0]) == rate
            m = events.react(t, 0.0, [], [], [p], events.m.start, [])[2]
            assert float(events.dae(t, 0.0, [], [], [p], m)[0]) == rate
            assert float(acausal.linearize(compiled, t, parameters={"p": p}).A[0, 0]) == rate


@pytest.mark.parametrize("on", SPELLINGS)
def test_a_switch_at_the_start_has_happened(on: str) -> None:
    """A run begins behind it, and so do `init`, `linearize`, steady states and exported steps."""
    compiled = acausal.compile(Switched(on=on, p=0.0))
    run = acausal.simulate(compiled, stop_time=0.1)
    assert run["y"][0] == 5.0
    assert compiled.casadi(["y"]).y.start[0] == 5.0
    assert float(acausal.linearize(compiled, outputs=["y"]).y[0]) == 5.0
    step = acausal.step_function(compiled, 1e-3, "rosenbrock", ["x"])
    assert float(np.array(step.function(step.x.start, [], step.p.start)[1]).ravel()[0]) == pytest.approx(
        np.expm1(5e-3), rel=1e-6
    )


class Counted(Component):
    """Each passage sets d, on which the rates of two states depend; `n` counts how often d has changed."""

    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.4))
    w: Real = variable(default=fixed(0.4))
    d: Real = discrete()
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0 + 0.3 * self.w
        yield der(self.y) == -self.y - self.w + self.d
        yield der(self.w) == self.y - 0.3 * self.d
        yield when(self.x > 0.5, reset(self.d, self.y), reset(self.x, pre(self.x) - 0.5))
        yield when(change(self.d), reset(self.n, pre(self.n) + 1))


@pytest.mark.parametrize("method", METHODS)
def test_steps_leave_discrete_variables_exactly_as_they_are(method: str) -> None:
    """`change(d)` asks whether d is exactly what it was: implicit methods do not solve for it. Four passages in 2 s."""
    compiled = acausal.compile(Counted())
    assert acausal.simulate(compiled, stop_time=2.0).final("n") == 4.0
    step = acausal.step_function(compiled, 5e-3, method, ["d", "n"])
    x, seen = np.array(step.x.start), []
    for _ in range(400):
        new, y = (np.array(v).ravel() for v in step.function(x, [], step.p.start))
        x = new
        seen.append((y[0], y[1]))
        assert not y[2:-1].any()
    assert len(set(seen)) == 5, "d has five values, and n counts them"
    assert seen[-1][1] == 4.0


def test_reactions_do_not_take_rounding_for_a_change() -> None:
    """A loop that integrates all of x, d with the rate zero, moves d by rounding; `react` counts what an event sets."""
    made = acausal.compile(Counted()).casadi(events=True)
    assert made.events is not None
    d = made.x.position("d")
    for moved in (0.0, 1e-22, -3e-17):
        x = np.array(made.x.start)
        x[made.x.position("x")], x[d] = 0.5 + 1e-12, moved
        after = np.array(made.events.react(x, [], [], [], made.events.m.start, [])[0]).ravel()
        assert after[made.x.position("n")] == 1.0
        assert after[d] == x[made.x.position("y")]


class Held(Component):
    """A body with the six coordinates of a free one, and a slide from it to a universal joint at 1 m from the ground.

    Three coordinates of the first body are left; the length of its quaternion nothing says.
    """

    world: World = World()
    free: FreeMotion = FreeMotion(
        r_rel_a=fixed((0.1, 0.2, -0.1)), v_rel_a=fixed((0.3, -0.1, 0.2)), Q=guess((0.1, -0.1, 0.2, 0.9))
    )
    first: Body = Body(m=1.0, r_CM=(0.1, 0.0, 0.0))
    slide: Prismatic = Prismatic(s=guess(0.9))
    second: Body = Body(m=2.0, r_CM=(-0.1, 0.1, 0.0))
    joint: Universal = Universal(n_a=(0.0, 1.0, 0.0), n_b=(0.0, 0.0, 1.0), phi_a=guess(0.2), phi_b=guess(0.1))
    ground: Fixed = Fixed(r=(1.0, 0.0, 0.0))

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.free.frame_a)
        yield connect(self.free.frame_b, self.first.frame_a, self.slide.frame_a)
        yield connect(self.slide.frame_b, self.second.frame_a, self.joint.frame_b)
        yield connect(self.joint.frame_a, self.ground.frame_b)


def test_the_start_of_a_loop_is_that_of_a_run() -> None:
    """It was nan: a joint was held at its guess that the loop determines, and the length of the quaternion was open."""
    compiled = acausal.compile(Held())
    model = compiled.casadi()
    p = np.array(model.p.start)
    x, z = model.init(p)
    run = acausal.simulate(compiled, stop_time=1e-3)
    assert np.array(x).ravel() == pytest.approx([run[name][0] for name in model.x.names], abs=1e-9)
    # the ground moved, and the start with it: the loop is closed, and so are its velocities
    p[model.p.position("ground.r[1]")] = 0.05
    x, z = model.init(p)
    position, velocity = (np.array(g) for g in model.invariants(x=x, z=z, p=p).values())
    assert np.abs(position).max() < 1e-10
    assert np.abs(velocity).max() < 1e-10
