"""The models that show components in the reference: every component has one, and each does what its words say."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Result
from acausal.cli.arguments.catalogue import library_parts
from acausal.cli.arguments.shipped import shipped_models

CHECKS: dict[str, Callable[[Result], None]] = {}
MODELS = {m.name: m for m in shipped_models() if m.module.startswith("acausal.models.components.")}
G = 9.80665


def test_every_component_that_can_stand_in_a_model_has_an_example(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path, str(Path(__file__).parents[2] / "docs")])
    examples: Any = import_module("examples")
    parts = [p for p in library_parts() if p.kind == "component" and not p.name.startswith("Partial")]
    assert len(parts) > 200
    assert [p.reference for p in parts if not examples.models_with(p)[0]] == []


def test_every_model_is_checked() -> None:
    assert set(CHECKS) == set(MODELS)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(MODELS))
def test_model(name: str, caplog: pytest.LogCaptureFixture) -> None:
    model = getattr(import_module(MODELS[name].module), name)()
    result = acausal.simulate(model, tolerance=1e-8)
    assert "start value" not in caplog.text
    CHECKS[name](result)


def check(function: Callable[[Result], None]) -> Callable[[Result], None]:
    """Enter what a model has to do under its name."""
    CHECKS["".join(word.capitalize() for word in function.__name__.split("_"))] = function
    return function


def near(r: Result, t: float, **expected: float) -> None:
    """Values at a time, of signals with two underscores for each dot."""
    for name, value in expected.items():
        assert r.at(t, name.replace("__", ".")) == pytest.approx(float(value), rel=1e-5, abs=1e-6), name


@check
def current_sources(r: Result) -> None:
    """C*v' + v*G is the sum of all currents, whose integral is known: 8*0.2 + 7*0.5 - 0.5*(1 + 3); sines have none."""
    leaked = np.trapezoid(r["leak.i"], r.time)
    assert 0.1 * r.final("capacitor.v") + leaked == pytest.approx(8 * 0.2 + 7 * 0.5 - 0.5 * (1 + 3), rel=1e-3)


@check
def transformer_on_line(r: Result) -> None:
    """The load of 1 Ohm stands for 100 Ohm on the other side."""
    near(r, 0.005, transformer__v1=325 * 100 / 110, voltage__v=32.5 * 100 / 110)


@check
def saturated_coil(r: Result) -> None:
    """The linear coil by its phasor and its transient; the saturated one takes more."""
    w, R = 2 * math.pi * 0.2, 0.1
    phase = math.atan2(w, R)
    current = 2 / math.hypot(R, w) * (math.sin(w * 20 - phase) + math.sin(phase) * math.exp(-R * 20))
    near(r, 20.0, coil__i=current)
    assert float(r["saturating.i"].max()) > 1.3 * float(r["coil.i"].max())


@check
def heated_circuit(r: Result) -> None:
    """In the end all losses go to the air, and R = 10*(1 + alpha*(T - 300.15 K))."""
    warmer = r.final("body.T") - 300.15
    assert r.final("hot_resistor.loss_power") + r.final("hot_diode.loss_power") == pytest.approx(
        0.02 * warmer, rel=1e-2
    )
    assert r.final("hot_resistor.v") / r.final("hot_resistor.i") == pytest.approx(10 * (1 + 4e-3 * warmer), rel=1e-6)


@check
def switched_coils(r: Result) -> None:
    """The arc: 30 V, 10 V more each millisecond, 60 V at most."""
    near(r, 0.013, opener__v=-40.0)
    near(r, 0.018, opener__v=-60.0)


@check
def chopped_half_wave(r: Result) -> None:
    near(r, 0.0025, load__v=325 * math.sin(math.pi / 4) / (1 + 1e-7))
    assert abs(float(r.at(0.0075, "load.v"))) < 0.5


@check
def motor_start(r: Result) -> None:
    """V = R*i + k*w and k*i = d*w."""
    assert r.final("rotor.w") == pytest.approx(24 * 0.1 / (0.5 * 0.0025 + 0.01), rel=2e-4)


@check
def voice_coil(r: Result) -> None:
    """The amplitude by phasors."""
    s = 2j * math.pi * 60
    x = 2 * 6 / ((6 + 5e-4 * s) * (0.01 * s**2 + s + 1500) + 36 * s)
    assert r["membrane.s"][r.time > 0.12].max() == pytest.approx(abs(x), rel=1e-3)


@check
def heated_room(r: Result) -> None:
    """Stefan and Boltzmann; the thermostat holds half a kelvin, and what the radiator still stores."""
    T, room = r.at(20000.0, "radiator.T"), r.at(20000.0, "room.T")
    assert r.at(20000.0, "radiation.Q_flow") == pytest.approx(1.5 * 5.670374419e-8 * (T**4 - room**4), rel=1e-6)
    assert np.abs(r["room.T"] - 293.15).max() < 1.0


@check
def arithmetic(r: Result) -> None:
    near(r, 4.0, add__y=3, add3__y=9, feedback__y=0, product__y=10, division__y=0.4, integrator__y=4)


@check
def limits(r: Result) -> None:
    near(r, 0.25, limiter__y=1.5, dead_zone__y=1, relay__y=2, hysteresis__y=1, table__y=0)
    near(r, 0.75, limiter__y=-1.5, dead_zone__y=-1, relay__y=-2, hysteresis__y=0, table__y=0)


@check
def responses(r: Result) -> None:
    assert r["exact.y"] == pytest.approx(r["second.yd"], abs=1e-9)
    near(r, 2.0, lag__y=1 - math.exp(-20))


@check
def delays(r: Result) -> None:
    near(r, 1.75, ramp__y=0.75, fixed_delay__y=0.25, variable__y=1.75 - (0.1 + 0.2 * 1.75) - 1)
    assert np.abs(r["pade.y"] - r["fixed_delay.y"]).max() < 0.05


@check
def noisy_signals(r: Result) -> None:
    assert np.abs(r["uniform.y"]).max() <= 1
    assert 0.3 < r["normal.y"].std() < 0.7


@check
def means_of_sine(r: Result) -> None:
    near(r, 3.5, mean__y=0.5, rectified__y=math.sqrt(3) / math.pi + 1 / 6, rms__y=math.sqrt(0.75))


@check
def two_controllers(r: Result) -> None:
    """Both have an integral part."""
    assert r.at(9.99, "plant1b.y") == pytest.approx(1, abs=1e-2)
    assert r.at(9.99, "plant2b.y") == pytest.approx(1, abs=1e-2)
    assert np.abs(r["pid.y"]).max() <= 2 + 1e-9


@check
def gates(r: Result) -> None:
    for t, a, b in ((0.5, False, False), (1.5, True, False), (2.5, True, True), (3.5, False, True)):
        near(r, t, conjunction__y=a and b, disjunction__y=a or b, nand__y=not (a and b), nor__y=not (a or b))
        near(r, t, xor__y=a != b, inverse__y=not a)


@check
def memories(r: Result) -> None:
    near(r, 4.5, at_rise__y=4, at_fall__y=2, at_change__y=4, flip_flop__Q=1, latch__y=1, switch__y=4, number__y=10)
    near(r, 7.0, at_rise__y=4, at_fall__y=6, at_change__y=6, flip_flop__Q=0, latch__y=1, switch__y=7, number__y=0)


@check
def comparisons(r: Result) -> None:
    near(r, 0.5, greater__y=1, less__y=0, above__y=1, at_least__y=1, below__y=0, at_most__y=0, as_boolean__y=1)
    near(r, 1.5, greater__y=0, less__y=1, above__y=0, at_least__y=0, below__y=1, at_most__y=1, as_boolean__y=0)


@check
def sampled_sine(r: Result) -> None:
    def s(t: float) -> float:
        return math.sin(2 * math.pi * t)

    near(r, 0.55, sampler__y=s(0.5), hold__y=s(0.5), late__y=s(0.4), line__y=1.5 * s(0.5) - 0.5 * s(0.4))
    near(r, 0.55, rarely__y=s(0.5))


@check
def braked_shaft(r: Result) -> None:
    """From 10 rad/s with (10 - 2)/0.1 rad/s2 to rest."""
    near(r, 0.5, rotor__w=10)
    near(r, 1.0, rotor__w=0, angle__phi=2.5 + 10**2 / (2 * 80), torque__tau=2)


@check
def sticking_bearing(r: Result) -> None:
    """It lets go at 2.4 N.m, as 5*sin(pi*t) reaches them."""
    free = math.asin(0.48) / math.pi
    near(r, free - 1e-3, rotor__w=0)
    assert r.at(free + 5e-3, "rotor.w") > 0


@check
def gear_train(r: Result) -> None:
    torque = r.at(2.0, "lossy.flange_a.tau"), r.at(2.0, "on_spring.flange_a.tau")
    near(r, 2.0, lossy__flange_b__tau=-0.8 * 3 * float(torque[0]))
    # The housing carries the difference of both torques of its gear, (2 - 1) times what drives it.
    near(r, 2.0, on_spring__support__tau=float(torque[1]))


@check
def wheel_and_rack(r: Result) -> None:
    """J*w' = 20*(1 - (w/30)**2), with both masses in J."""
    near(r, 1.0, rotor__w=30 * math.tanh(20 / (30 * (0.5 + 5 * 0.3**2 + 20 / 10**2))))


@check
def freewheel(r: Result) -> None:
    assert (r["driven.w"] - r["driving.w"]).min() > -1e-6
    assert r["driving.w"].min() < -4 < 0 < r["driven.w"][1:].min()


@check
def backlash(r: Result) -> None:
    """In the play there is no torque; the flanks give way by a little."""
    twist, torque = np.abs(r["twist.phi_rel"]), r["play.tau"]
    assert np.abs(torque[twist < 0.05 - 1e-6]).max() < 1e-9
    assert twist.max() < 0.06


@check
def eddy_brake(r: Result) -> None:
    """What the drive gives and what the disk loses warms the metal."""
    lost = 0.2 / 2 * (50**2 - r.final("disk.w") ** 2) + 0.5 * r.final("disk.phi")
    assert 20 * (r.final("metal.T") - 293.15) == pytest.approx(lost, rel=1e-6)


@check
def reacting_torque(r: Result) -> None:
    near(r, 1.5, prescribed__w=10 / math.pi * (1 - math.cos(1.5 * math.pi)), driven__w=3)
    near(r, 3.0, driven__w=6)


@check
def coast_down(r: Result) -> None:
    near(r, 20.0, speed__v=20 / (1 + 0.1 * 20 * 20 / 10), in_oil__v=20 * math.exp(-2 * 20 / 10))
    near(r, 20.0, position__s=10 / 0.1 * math.log(5))


@check
def stops_and_friction(r: Result) -> None:
    """Stops at 1 m, half a length before; the guide holds 12 N; the brake holds at t = 1."""
    assert np.abs(r["between_stops.s"]).max() == pytest.approx(0.9, abs=1e-9)
    near(r, math.asin(12 / 25) / math.pi - 1e-3, rubbing__s=0)
    near(r, 1.0, braked__v=0)


@check
def buffer_and_play(r: Result) -> None:
    """The buffer only pushes, and it takes energy."""
    assert r["buffer.f"].max() <= 1e-9
    assert 0.5 < -r.final("thrown.v") < 1


@check
def ball_on_floor(r: Result) -> None:
    """Stopped at e = 0.7 of the speed of the fall: v**2/2 is what weight and spring give on 0.5 m."""
    fall = math.sqrt(2 * (9.81 * 0.5 + 20 / 2 * (0.7**2 - 0.2**2)))
    assert r["ball.v"].min() == pytest.approx(-fall, rel=1e-6)
    assert r["ball.v"].max() == pytest.approx(0.7 * fall, rel=1e-6)


@check
def pushed_apart(r: Result) -> None:
    assert r["left.v"] + 2 * r["right.v"] == pytest.approx(0, abs=1e-9)


@check
def masses_on_springs(r: Result) -> None:
    """A damper only takes energy; the heavy spring keeps it, its own mass in the middle of its line."""
    damped = 0.5 * (r["mass2.v_0"] ** 2).sum(axis=1) + 50 * (r["parallel.s"] - 0.3) ** 2 + G * r["mass2.r_0"][:, 1]
    assert np.diff(damped).max() < 1e-6
    assert np.ptp(damped) > 0.1
    stretched = r["heavy.s"] - 0.3
    energy = 0.5 * (r["mass3.v_0"] ** 2).sum(axis=1) + 0.25 * (r["heavy.v_CM_0"] ** 2).sum(axis=1) + 50 * stretched**2
    middle = 0.5 * r["mass3.r_0"][:, 1]
    assert np.ptp(energy + G * (r["mass3.r_0"][:, 1] + 0.5 * middle)) < 1e-5


@check
def turned_by_thrusters(r: Result) -> None:
    """The first angular acceleration, about the centre of the cylinder, by hand."""
    m = 7700 * math.pi / 4 * 0.1**2 * 0.6
    about, across = m * 0.05**2 / 2, m * (3 * 0.05**2 + 0.6**2) / 12
    expected = np.array([0.2 / about, (0.5 - 0.3 * 4) / across, 0.3 * 5 / across])
    assert r.at(1e-3, "sensor.w") / 1e-3 == pytest.approx(expected, rel=5e-3)


@check
def measured_pendulum(r: Result) -> None:
    """The weight across the plane of the pendulum, at half the length."""
    m = 7700 * 0.5 * 0.04**2
    assert r["torque.torque"][:, 1] == pytest.approx(m * G * math.sin(math.radians(20)) * 0.25, rel=1e-6)


@check
def ball_and_cardan(r: Result) -> None:
    """Nothing turns the symmetric bar about its axis."""
    assert r["bar1.w_a"][:, 1] == pytest.approx(2, abs=1e-6)
    assert np.ptp(r["bar2.w_a"][:, 1]) > 0.1


@check
def four_bar(r: Result) -> None:
    """The loop stays closed, and nothing loses energy."""
    assert r["coupler.frame_b.r_0"] == pytest.approx(r["rocker.frame_b.r_0"], abs=1e-6)
    assert np.abs(r["coupler.frame_b.r_0"][:, :2] - r["crank.frame_b.r_0"][:, :2]).max() <= 0.4 + 1e-6
    assert np.linalg.norm(r["rocker.frame_b.r_0"] - [0.4, 0, 0], axis=1) == pytest.approx(0.3, abs=1e-6)


@check
def constrained_bodies(r: Result) -> None:
    assert r["held.w_a"][:, 2] == pytest.approx(r["jointed.w_a"][:, 2], abs=1e-4)
    assert r["sliding.r_0"][:, 0] == pytest.approx(1, abs=1e-8)


@check
def gear_in_space(r: Result) -> None:
    """Both inertias on the slow side: 100*Ja + Jb."""

    def about(d: float) -> float:
        return 7700 * math.pi / 4 * d**2 * 0.4 * d**2 / 8

    w = 20 / (100 * about(0.1) + about(0.2)) * (1 - math.cos(2 * math.pi * 1.3)) / (2 * math.pi)
    near(r, 1.3, w=w)


@check
def rolling_disk(r: Result) -> None:
    """What rolls does no work at the ground."""
    w, v = r["disk.w_a"], r["disk.v_0"]
    energy = (v**2).sum(axis=1) + (w**2 * [0.06, 0.03, 0.06]).sum(axis=1) + 2 * G * r["disk.r_0"][:, 2]
    assert np.ptp(energy) < 1e-5 * energy[0]


@check
def pushing_bodies(r: Result) -> None:
    assert r["rail1.v"] + 2 * r["rail2.v"] == pytest.approx(0, abs=1e-9)
    near(r, 3.0, spindle1__w=-15, spindle2__w=7.5)


@check
def fed_channel(r: Result) -> None:
    """In the end what flows out carries the feed: c = 1e-6/(A*v)."""
    assert r.final("channel.c[39]") == pytest.approx(1.0, rel=1e-6)
