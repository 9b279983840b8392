"""More friction elements than motions: what they carry together, who gives way when, and what is said of their shares.

Figures are those of statics: stuck elements carry a load as long as the sum of their limits does, shares of least
squares are equal up to the smallest limit, and an element that has given way carries its sliding torque.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal
from acausal import AcausalError, Component, Equations, Real, connect, fixed, part, signal_input, sin, time, where
from acausal.export.step.step import step_function
from acausal.library import rotational, translational


class Held(Component):
    """An inertia, a torque on it, and brakes that are pressed with these largest torques (limit, peak)."""

    brakes: list[rotational.Brake] = part()
    inertia: rotational.Inertia = part()
    torque: rotational.Torque = part()
    limits: tuple[tuple[float, float], ...] = acausal.structural(default=((2.0, 1.0), (5.0, 1.0)))
    w0: float = acausal.structural(default=0.0)
    u: Real = signal_input(unit="N.m", default=0.0)
    pressed: Real = signal_input(unit="1", default=1.0)

    def build(self) -> None:
        self.inertia = rotational.Inertia(J=2.0, phi=fixed(0.0), w=fixed(self.w0))
        self.torque = rotational.Torque(u=self.u)
        self.brakes = [
            rotational.Brake(fn_max=2.0 * limit, f_normalized=self.pressed, peak=peak) for limit, peak in self.limits
        ]

    def equations(self) -> Equations:
        yield connect(self.torque.flange, self.inertia.flange_a)
        for brake in self.brakes:
            yield connect(self.inertia.flange_b, brake.flange_a)


@pytest.mark.parametrize("solver", ["auto", "rosenbrock", "cvodes"])
def test_brakes_hold_up_to_the_sum_of_their_limits(solver: str) -> None:
    """Torque t: both stick with t/2 each up to 2*2, then 2 and t - 2 up to 7; then 2*w' = t - 7, at 9: w = 1."""
    compiled = acausal.compile(Held(u=1.0 * time))
    for _ in range(2):  # and once more with what the first run has left
        r = acausal.simulate(compiled, stop_time=9.0, tolerance=1e-8, solver=solver)
        shares = r["brakes[0].tau"], r["brakes[1].tau"]
        slides = np.maximum(r.time, 4.0) - 2.0
        assert shares[0] == pytest.approx(np.minimum(r.time / 2, 2.0), abs=1e-7)
        assert shares[1] == pytest.approx(np.where(r.time < 4.0, r.time / 2, np.minimum(slides, 5.0)), abs=1e-7)
        assert np.abs(r["inertia.w"][r.time < 6.99]).max() < 1e-12  # rounding of torques that cancel, over 7 s
        assert r.at(1.234, "brakes[0].tau") == pytest.approx(0.617, abs=1e-9)
        assert r.final("inertia.w") == pytest.approx(1.0, abs=1e-7)
        assert "statically undetermined from t = 0 s on: brakes[0].sa and brakes[1].sa" in str(r.stats["notes"])


def test_one_that_gives_way_at_its_peak_hands_its_load_to_the_other() -> None:
    """2 and 5 N.m, stuck half as much again: the first goes at 3 + 3; with its 2 the other holds up to 2 + 7.5."""
    r = acausal.simulate(Held(limits=((2.0, 1.5), (5.0, 1.5)), u=1.0 * time), stop_time=11.5, tolerance=1e-8)
    assert r.at(5.9, "brakes[0].tau") == pytest.approx(2.95, abs=1e-9)
    assert r.at(6.1, "brakes[0].tau") == pytest.approx(2.0, abs=1e-9)
    assert r.at(9.4, "inertia.w") == pytest.approx(0.0, abs=1e-14)
    # 2 w' = t - 7 from 9.5 on
    assert r.final("inertia.w") == pytest.approx((4.5**2 - 2.5**2) / 4, abs=1e-6)


def test_brakes_stop_what_turns_and_hold_it() -> None:
    """2 w' = -(1 + 3 + 0.5): from 9 rad/s at rest after 4 s and 18 rad."""
    r = acausal.simulate(Held(limits=((1.0, 1.0), (3.0, 1.2), (0.5, 1.0)), w0=9.0), stop_time=6.0, tolerance=1e-8)
    assert r.at(3.0, "inertia.w") == pytest.approx(9.0 - 6.75, abs=1e-7)
    assert r.final("inertia.phi") == pytest.approx(18.0, abs=1e-6)
    assert r.final("inertia.w") == pytest.approx(0.0, abs=1e-9)


def test_brakes_that_are_pressed_later() -> None:
    """Free up to 1 s under 4 N.m, 2 rad/s then; 2 w' = 4 - 6 stops it after 2 s more, and 4 is held."""
    r = acausal.simulate(
        Held(limits=((2.0, 1.0), (4.0, 1.0)), u=4.0, pressed=where(time < 1.0, 0.0, 1.0)), stop_time=4.0, tolerance=1e-8
    )
    assert r.at(1.0, "inertia.w") == pytest.approx(2.0, abs=1e-7)
    assert r.final("inertia.phi") == pytest.approx(1.0 + 2.0, abs=1e-6)
    assert r.final("brakes[0].tau") + r.final("brakes[1].tau") == pytest.approx(4.0, abs=1e-9)


def test_how_the_end_depends_on_a_limit_of_one_of_them() -> None:
    """w(9) = (9 - 7)^2/4 with 7 = 2 + fn_max/2: dw/dfn_max = -(9 - 7)/2/2; the instant of motion moves by a half."""
    s = acausal.sensitivities(Held(u=1.0 * time), ["brakes[1].fn_max"], ["inertia.w"], stop_time=9.0)
    assert s.final[0, 0] == pytest.approx(-0.5, abs=1e-6)
    moved = s.of_event_times[np.abs(s.event_times - 7.0) < 1e-9, 0]
    assert moved == pytest.approx([0.5], abs=1e-6)


class Swinging(Component):
    """An inertia at rest under 0.76 to 3.06 N.m, and two brakes whose normal forces swing, each in its own time."""

    brakes: list[rotational.Brake] = part()
    inertia: rotational.Inertia = rotational.Inertia(J=2.0, phi=fixed(0.0), w=fixed(0.0))
    torque: rotational.Torque = rotational.Torque(u=1.15 * sin(2.97 * time - 0.213) - 1.91)

    def build(self) -> None:
        self.brakes = [
            rotational.Brake(fn_max=20.0, f_normalized=0.6 + 0.5 * sin(5.4 * time)),
            rotational.Brake(fn_max=12.0, f_normalized=0.6 + 0.5 * sin(3.65 * time), peak=1.2),
        ]

    def equations(self) -> Equations:
        yield connect(self.torque.flange, self.inertia.flange_a)
        for brake in self.brakes:
            yield connect(self.inertia.flange_b, brake.flange_a)


@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_friction_moves_nothing(solver: str) -> None:
    """The limits of sliding carry 2.7 N.m more than the load at any time, so that nothing ever moves.

    The second gives way at its peak and is held by the first; it went on to push as its normal force grew, up to where
    the first gave way the other way round, and they turned the inertia with 0.07 rad/s.
    """
    t = np.linspace(0.0, 3.0, 3001)
    carried = 10 * (0.6 + 0.5 * np.sin(5.4 * t)) + 6 * (0.6 + 0.5 * np.sin(3.65 * t))
    assert (carried - np.abs(1.15 * np.sin(2.97 * t - 0.213) - 1.91)).min() > 2.7
    r = acausal.simulate(Swinging(), stop_time=3.0, tolerance=1e-8, solver=solver)
    assert np.abs(r["inertia.w"]).max() < 1e-11


class HeldAcross(Component):
    """Inertias at rest with a one-way clutch between them, a bearing on the left, a brake and a torque on the right.

    Largest torques: 3 N.m of the bearing, 1 of the clutch, 4 of the brake.
    """

    left: rotational.Inertia = rotational.Inertia(J=1.0, phi=fixed(0.0), w=fixed(0.0))
    right: rotational.Inertia = rotational.Inertia(J=1.0, phi=fixed(0.0), w=fixed(0.0))
    bearing: rotational.BearingFriction = rotational.BearingFriction(tau_pos=((0.0, 3.0),))
    clutch: rotational.OneWayClutch = rotational.OneWayClutch(fn_max=2.0, f_normalized=1.0)
    brake: rotational.Brake = rotational.Brake(fn_max=8.0, f_normalized=1.0)
    torque: rotational.Torque = rotational.Torque(u=1.0 * time)

    def equations(self) -> Equations:
        yield connect(self.left.flange_a, self.bearing.flange_a)
        yield connect(self.left.flange_b, self.clutch.flange_a)
        yield connect(self.clutch.flange_b, self.right.flange_a)
        yield connect(self.right.flange_b, self.brake.flange_a, self.torque.flange)


@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_a_one_way_clutch_hands_over_what_it_cannot_carry(solver: str) -> None:
    """Under a torque t the clutch carries t/3 up to its 1, then the brake t - 1 up to its 4; then w' = t - 5, at 7: 2.

    t/3 are least squares: x + y = t with x**2 + 2*y**2 least, as the bearing carries the clutch's load y on.
    """
    r = acausal.simulate(HeldAcross(), stop_time=7.0, tolerance=1e-8, solver=solver)
    assert r.at(1.5, "clutch.tau") == pytest.approx(0.5, abs=1e-9)
    assert r.at(3.5, "clutch.tau") == pytest.approx(1.0, abs=1e-9)
    assert r.at(3.5, "brake.tau") == pytest.approx(2.5, abs=1e-9)
    assert r.final("right.w") == pytest.approx(2.0, abs=1e-6)
    assert np.abs(r["left.w"]).max() < 1e-9


class GearedBearings(Component):
    """A gear with an inertia and a bearing on each side."""

    left: rotational.Inertia = rotational.Inertia(J=0.5, phi=fixed(0.0), w=fixed(-20.0))
    right: rotational.Inertia = rotational.Inertia(J=8.0)
    gear: rotational.IdealGear = rotational.IdealGear(ratio=4.0)
    near: rotational.BearingFriction = rotational.BearingFriction(tau_pos=((0.0, 0.75),))
    far: rotational.BearingFriction = rotational.BearingFriction(tau_pos=((0.0, 5.0),))

    def equations(self) -> Equations:
        yield connect(self.left.flange_b, self.near.flange_a)
        yield connect(self.near.flange_b, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.far.flange_a)
        yield connect(self.far.flange_b, self.right.flange_a)


def test_bearings_on_both_sides_of_a_gear() -> None:
    """(0.5 + 8/16) w' = 0.75 + 5/4 from -20 rad/s: at rest after 10 s."""
    r = acausal.simulate(GearedBearings(), stop_time=12.0, tolerance=1e-8)
    assert r.at(4.0, "left.w") == pytest.approx(-12.0, abs=1e-7)
    assert r.events[0].time == pytest.approx(10.0, abs=1e-6)
    assert r.final("right.phi") == pytest.approx(-100.0 / 4, abs=1e-5)


class Shafts(Component):
    """Two shafts in bearings of half a newton metre, and a clutch of two between them."""

    first: rotational.Inertia = rotational.Inertia(J=1.0, phi=fixed(0.0), w=fixed(10.0))
    second: rotational.Inertia = rotational.Inertia(J=3.0, phi=fixed(0.0), w=fixed(0.0))
    clutch: rotational.Clutch = rotational.Clutch(fn_max=4.0, f_normalized=1.0)
    one: rotational.BearingFriction = rotational.BearingFriction(tau_pos=((0.0, 0.5),))
    two: rotational.BearingFriction = rotational.BearingFriction(tau_pos=((0.0, 0.5),))

    def equations(self) -> Equations:
        yield connect(self.first.flange_b, self.one.flange_a)
        yield connect(self.one.flange_b, self.clutch.flange_a)
        yield connect(self.clutch.flange_b, self.two.flange_a)
        yield connect(self.two.flange_b, self.second.flange_a)


def test_a_clutch_between_shafts_in_bearings() -> None:
    """10 - 2.5 t = 0.5 t at 10/3 s with 5/3 rad/s, and both lose a quarter each second: at rest at 10 s."""
    r = acausal.simulate(Shafts(), stop_time=12.0, tolerance=1e-8)
    assert r.events[0].time == pytest.approx(10.0 / 3, abs=1e-7)
    assert r.at(6.0, "second.w") == pytest.approx(5.0 / 3 - (6.0 - 10.0 / 3) / 4, abs=1e-7)
    assert r.at(11.0, "first.w") == pytest.approx(0.0, abs=1e-7)
    energy = [r[name] for name in ("one.loss_power", "two.loss_power", "clutch.loss_power")]
    assert np.trapezoid(sum(energy), r.time) == pytest.approx(50.0, rel=1e-4)  # all of it turns into heat


class Rack(Component):
    """A pinion in a bearing drives a mass on a guide."""

    shaft: rotational.Inertia = rotational.Inertia(J=2.0, phi=fixed(0.0), w=fixed(0.0))
    bearing: rotational.BearingFriction = rotational.BearingFriction(tau_pos=((0.0, 1.0),))
    rack: rotational.IdealGearR2T = rotational.IdealGearR2T(ratio=4.0)
    mass: translational.Mass = translational.Mass(m=32.0)
    guide: translational.SupportFriction = translational.SupportFriction(f_pos=((0.0, 12.0),))
    torque: rotational.Torque = rotational.Torque(u=2.0 * time)

    def equations(self) -> Equations:
        yield connect(self.torque.flange, self.shaft.flange_a)
        yield connect(self.shaft.flange_b, self.bearing.flange_a, self.rack.flange_r)
        yield connect(self.rack.flange_t, self.mass.flange_a)
        yield connect(self.mass.flange_b, self.guide.flange_a)


def test_a_bearing_and_a_guide_on_a_rack() -> None:
    """2 t against 1 + 12/4 up to 2 s; then (2 + 32/16) w' = 2 t - 4: w = (t - 2)^2/4."""
    r = acausal.simulate(Rack(), stop_time=4.0, tolerance=1e-8)
    assert r.at(1.9, "mass.v") == pytest.approx(0.0, abs=1e-14)
    assert r.final("shaft.w") == pytest.approx(1.0, abs=1e-6)


class Prescribed(Component):
    """A shaft whose speed is given, and a brake on it."""

    speed: rotational.Speed = rotational.Speed(w_ref=where(time < 1.0, 0.0, time - 1.0), phi=fixed(0.0))
    brake: rotational.Brake = part()
    fn_max: float = acausal.structural(default=10.0)

    def build(self) -> None:
        self.brake = rotational.Brake(fn_max=self.fn_max, f_normalized=1.0)

    def equations(self) -> Equations:
        yield connect(self.speed.flange, self.brake.flange_a)


def test_a_brake_gives_way_to_a_prescribed_motion() -> None:
    """Still for a second, when the torque is anything up to 5, the least of which is 0; then 5 against the motion."""
    r = acausal.simulate(Prescribed(), stop_time=2.0)
    assert r.at(0.5, "brake.tau") == 0.0
    assert r.final("brake.tau") == pytest.approx(5.0, abs=1e-9)
    assert r.final("brake.w") == pytest.approx(1.0, abs=1e-9)


def test_what_nothing_can_give_way_to_is_refused() -> None:
    with pytest.raises(AcausalError, match=r"AC506(.|\n)*brake.sa"):
        acausal.simulate(Prescribed(fn_max=1e200), stop_time=2.0)


def test_a_step_of_fixed_equations_is_refused() -> None:
    with pytest.raises(AcausalError, match=r"AC610(.|\n)*brakes"):
        step_function(acausal.compile(Held()), 0.01, "sdirk", [])


class LossyDrive(Component):
    """LossyGearDemo2 of the Modelica Standard Library with other numbers: a bearing before a gear that loses half."""

    one: rotational.Inertia = rotational.Inertia(J=0.8)
    two: rotational.Inertia = rotational.Inertia(J=1.2, phi=fixed(0.0), w=fixed(0.0))
    bearing: rotational.BearingFriction = rotational.BearingFriction(tau_pos=((0.0, 0.4), (1.0, 0.9)))
    gear: rotational.LossyGear = rotational.LossyGear(ratio=2.0, lossTable=((0.0, 0.6, 0.5, 0.0, 0.0),))
    drive: rotational.Torque = rotational.Torque(u=9.0 * sin(6.0 * time))
    load: rotational.Torque = rotational.Torque(u=-6.0)

    def equations(self) -> Equations:
        yield connect(self.drive.flange, self.one.flange_a)
        yield connect(self.one.flange_b, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.two.flange_a)
        yield connect(self.two.flange_b, self.load.flange)


def _lossy(stop: float) -> float:
    """Speed of the first inertia: one degree of freedom, whose torque at the gear x solves one equation a direction."""

    def accelerated(t: float, w: float, way: float) -> float:
        bearing = way * (0.4 + 0.5 * abs(w))
        found = []
        for driven in (True, False):  # whether flange_a drives: x > 0
            eta = (0.6 if driven else 1 / 0.5) if way > 0 else (1 / 0.5 if driven else 0.6)
            # 0.8 a = u - bearing - x, 1.2 a/2 = 2 eta x - 6
            a = (2 * eta * (9.0 * np.sin(6.0 * t) - bearing) - 6.0) / (0.6 + 1.6 * eta)
            x = 9.0 * np.sin(6.0 * t) - bearing - 0.8 * a
            found += [a] if (x >= 0) == driven else []
        return float(found[0])

    def until(way: float) -> Callable[..., float]:
        def crossing(t: float, y: np.ndarray) -> float:
            return float(y[0])

        crossing.terminal, crossing.direction = True, -way  # type: ignore[attr-defined]
        return crossing

    def moved(t: float, way: float) -> tuple[float, float]:
        def rates(s: float, y: np.ndarray) -> list[float]:
            return [accelerated(s, y[0], way)]

        run = solve_ivp(rates, (t, stop), [0.0], "DOP853", events=until(way), rtol=1e-11, atol=1e-13)
        return float(run.t[-1]), float(run.y[0, -1])

    t, w, way = 0.0, 0.0, 0.0
    while t < stop:
        if way:
            (t, w), way = moved(t, way), 0.0
            continue
        w = 0.0
        ways = [s for s in (1.0, -1.0) if s * accelerated(t + 1e-9, 0.0, s) > 0]
        if ways:
            way = ways[0]
        else:  # held until one of both directions is open
            grid = np.linspace(t, stop, 20001)[1:]
            t = next((s for s in grid if accelerated(s, 0.0, 1.0) > 0 or accelerated(s, 0.0, -1.0) < 0), stop)
    return w


def test_a_gear_with_losses_and_a_bearing() -> None:
    """Against one equation of motion a direction, integrated by scipy's DOP853."""
    for stop in (0.45, 0.9):
        r = acausal.simulate(LossyDrive(), stop_time=stop, tolerance=1e-9)
        assert r.final("one.w") == pytest.approx(_lossy(stop), abs=2e-5)
