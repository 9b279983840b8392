"""Friction where a `reset` makes a speed jump: what was stuck slides, what slid forward may slide backward.

Expected values are those of uniform deceleration, v**2/(2 a) until rest, and of conserved momentum.
"""

from __future__ import annotations

import pytest

import acausal
import acausal.library.rotational as rotational
import acausal.library.translational as translational
from acausal import Component, Equations, Real, connect, discrete, fixed, parameter, pre, reset, sample, when
from acausal.errors import AcausalError

LEVEL = ((0.0, 1.0),)
SOLVERS = ["idas", "rosenbrock", "cvodes", "erk"]


class Braked(Component):
    """An inertia of 1 kg.m2 that two brakes hold with 0.5 and 1.5 N.m, and that gets 1 rad/s at 0.5 s."""

    J: rotational.Inertia = rotational.Inertia(J=1.0, phi=fixed(0.0), w=fixed(0.0))
    first: rotational.Brake = rotational.Brake(fn_max=0.5, mu_pos=LEVEL)
    second: rotational.Brake = rotational.Brake(fn_max=1.5, mu_pos=LEVEL)

    def equations(self) -> Equations:
        yield connect(self.J.flange_b, self.first.flange_a)
        yield connect(self.first.flange_b, self.second.flange_a)
        yield self.first.f_normalized == 1.0
        yield self.second.f_normalized == 1.0
        yield when(sample(0.5, 10.0), reset(self.J.w, 1.0))


class Reversed(Braked):
    """The same, turned back at 0.7 s, where it has 0.6 rad/s, to -0.5 rad/s."""

    def equations(self) -> Equations:
        yield when(sample(0.7, 10.0), reset(self.J.w, -0.5))


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(("model", "angle"), [(Braked, 0.25), (Reversed, 0.16 - 0.0625)])
def test_a_braked_shaft_comes_to_rest(model: type[Component], angle: float, solver: str) -> None:
    """It was held at whatever speed the reset gave it, or braked in the wrong direction, for ever."""
    run = acausal.simulate(model(), stop_time=2.0, solver=solver, tolerance=1e-8)
    assert run.final("J.phi") == pytest.approx(angle, abs=1e-7)
    assert run.final("J.w") == pytest.approx(0.0, abs=1e-7)


class Carriage(Component):
    """The same for a mass of 2 kg and 4 N of friction in its guide, which gets 3 m/s."""

    mass: translational.Mass = translational.Mass(m=2.0, s=fixed(0.0), v=fixed(0.0))
    guide: translational.SupportFriction = translational.SupportFriction(f_pos=((0.0, 4.0),), peak=1.5)

    def equations(self) -> Equations:
        yield connect(self.mass.flange_b, self.guide.flange_a)
        yield when(sample(0.5, 10.0), reset(self.mass.v, 3.0))


class Geared(Component):
    """Inertias of 1 and 4 kg.m2 on a gear of ratio 2 with 1 N.m of bearing friction; the first gets 1 rad/s."""

    a: rotational.Inertia = rotational.Inertia(J=1.0, phi=fixed(0.0), w=fixed(0.0))
    gear: rotational.LossyGear = rotational.LossyGear(ratio=2.0, lossTable=((0.0, 1.0, 1.0, 1.0, 1.0),))
    b: rotational.Inertia = rotational.Inertia(J=4.0)

    def equations(self) -> Equations:
        yield connect(self.a.flange_b, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.b.flange_a)
        yield when(sample(0.5, 10.0), reset(self.a.w, 1.0))


@pytest.mark.parametrize(
    ("model", "name", "way"), [(Carriage, "mass.s", 9.0 / (2.0 * 2.0)), (Geared, "a.phi", 1.0 / (2.0 * 0.5))]
)
def test_other_elements_slide(model: type[Component], name: str, way: float) -> None:
    run = acausal.simulate(model(), stop_time=4.0, tolerance=1e-8)
    assert run.final(name) == pytest.approx(way, abs=1e-7)


class Freewheel(Component):
    """Two inertias on a one-way clutch of 2 N.m; the second gets a speed while the clutch is stuck."""

    to: Real = parameter(default=1.0)
    a: rotational.Inertia = rotational.Inertia(J=1.0, phi=fixed(0.0), w=fixed(0.0))
    clutch: rotational.OneWayClutch = rotational.OneWayClutch(fn_max=2.0, mu_pos=LEVEL)
    b: rotational.Inertia = rotational.Inertia(J=1.0, phi=fixed(0.0), w=fixed(0.0))

    def equations(self) -> Equations:
        yield connect(self.a.flange_b, self.clutch.flange_a)
        yield connect(self.clutch.flange_b, self.b.flange_a)
        yield self.clutch.f_normalized == 1.0
        yield when(sample(0.5, 10.0), reset(self.b.w, self.to))


def test_a_freewheel_lets_go() -> None:
    """The torque of 2 N.m makes both equally fast after 0.25 s, at 0.5 rad/s."""
    run = acausal.simulate(Freewheel(), stop_time=1.0, tolerance=1e-8)
    assert run.final("a.w") == pytest.approx(0.5, abs=1e-7)
    assert run.final("b.phi") == pytest.approx(0.25 * 0.75 + 0.25 * 0.5, abs=1e-7)


def test_a_reset_does_not_turn_a_freewheel_backward() -> None:
    with pytest.raises(AcausalError, match="w_rel >= 0"):
        acausal.simulate(Freewheel(to=-1.0), stop_time=1.0)


class Struck(Component):
    """Inertias of 1 and 2 kg.m2, stuck by two clutches of 1.5 N.m, at 2 rad/s; the first hits a wall at 1 rad."""

    first: rotational.Inertia = rotational.Inertia(J=1.0, phi=fixed(0.0), w=fixed(2.0))
    clutch: rotational.Clutch = rotational.Clutch(fn_max=1.5, mu_pos=LEVEL)
    other: rotational.Clutch = rotational.Clutch(fn_max=1.5, mu_pos=LEVEL)
    second: rotational.Inertia = rotational.Inertia(J=2.0, phi=fixed(0.0), w=fixed(2.0))
    wall: rotational.Torque = rotational.Torque()
    hit: Real = discrete()

    def equations(self) -> Equations:
        for clutch in (self.clutch, self.other):
            yield connect(self.first.flange_b, clutch.flange_a)
            yield connect(clutch.flange_b, self.second.flange_a)
            yield clutch.f_normalized == 1.0
        yield connect(self.wall.flange, self.first.flange_a)
        yield self.wall.u == self.hit
        yield when(self.first.phi > 1.0, reset(self.first.w, -0.5 * pre(self.first.w), by=self.hit))


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_stuck_clutches_bear_no_impulse(solver: str) -> None:
    """The torque of clutches is bounded: the second inertia keeps its speed, and the clutches slide with 3 N.m.

    Until 1 s the first gets faster from -1 rad/s by 3 rad/s2, the second slower by 1.5 rad/s2. The impulse went through
    the clutches, and was refused (AC508) where two of them were stuck.
    """
    run = acausal.simulate(Struck(), stop_time=1.0, solver=solver, tolerance=1e-8)
    assert run.final("first.w") == pytest.approx(-1.0 + 1.5, abs=1e-7)
    assert run.final("second.w") == pytest.approx(2.0 - 0.75, abs=1e-7)
