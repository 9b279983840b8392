"""The exported functions against the simulator, and the description of their entries."""

from __future__ import annotations

import math
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    fabs,
    fixed,
    guess,
    log,
    parameter,
    quantity,
    sin,
    time,
    variable,
    where,
)
from acausal.errors import UsageError
from acausal.lower.casadi_model import CasadiModel
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.pendulum import Pendulum
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
    with pytest.raises(UsageError, match=r"no variable 'revolute\.phy'") as caught:
        compiled.casadi(["revolute.phy"])
    assert caught.value.code == "AC010"
    assert "revolute.phi" in str(caught.value)
