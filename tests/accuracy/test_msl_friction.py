"""Friction that sticks: examples of the Modelica Standard Library against their published and converged solutions.

The published solutions (`reference.csv`) carry the error of their own solver, 2e-3 is what the library asks for; modes
are compared by their sequence and the instants at which they change, which the published event rows give to 1e-4.
"""

from __future__ import annotations

import csv
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, connect, part, sin, time, where
from acausal.library import blocks, rotational, translational
from tests.accuracy.msl_reference import met


class Friction(Component):
    """Rotational_Friction: a clutch and a brake on a drive train that swings."""

    torque: rotational.Torque = rotational.Torque(u=where(time < 0.5, 200.0 * sin(100.0 * time), 0.0))
    inertia3: rotational.Inertia = rotational.Inertia(J=1.0, phi=0.0, w=100.0)
    clutch: rotational.Clutch = rotational.Clutch(fn_max=160.0, f_normalized=1.0)
    inertia2: rotational.Inertia = rotational.Inertia(J=0.05, phi=0.0, w=90.0)
    spring: rotational.SpringDamper = rotational.SpringDamper(c=160.0, d=1.0)
    inertia1: rotational.Inertia = rotational.Inertia(J=1.0, phi=0.0, w=90.0)
    brake: rotational.Brake = rotational.Brake(fn_max=1600.0, f_normalized=where(time < 0.5, 0.0, 1.0))

    def equations(self) -> Equations:
        yield connect(self.torque.flange, self.inertia3.flange_a)
        yield connect(self.inertia3.flange_b, self.clutch.flange_a)
        yield connect(self.clutch.flange_b, self.inertia2.flange_a)
        yield connect(self.inertia2.flange_b, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.inertia1.flange_a)
        yield connect(self.inertia1.flange_b, self.brake.flange_a)


class OneWayClutch(Component):
    """Rotational_OneWayClutch: a freewheel between a swinging inertia and one that only it drives."""

    torque: rotational.Torque = rotational.Torque(u=10.0 * sin(6.0 * math.pi * time))
    inertiaIn: rotational.Inertia = rotational.Inertia(J=1.0, phi=0.0, w=-0.5)
    oneWayClutch: rotational.OneWayClutch = rotational.OneWayClutch(fn_max=3.0, peak=25.0)
    inertiaOut: rotational.Inertia = rotational.Inertia(J=1.0, phi=0.0, w=0.0)
    pulse: blocks.Pulse = blocks.Pulse(period=1.3, width=0.5, start_time=0.3, nperiod=2)

    def equations(self) -> Equations:
        yield connect(self.torque.flange, self.inertiaIn.flange_a)
        yield connect(self.inertiaIn.flange_b, self.oneWayClutch.flange_a)
        yield connect(self.oneWayClutch.flange_b, self.inertiaOut.flange_a)
        yield connect(self.pulse.y, self.oneWayClutch.f_normalized)


STRIBECK = tuple((v, 5.0 + v + 10.0 * math.exp(-2.0 * v)) for v in np.linspace(0.0, 12.0, 50).tolist())


class StribeckFriction(Component):
    """Translational_Friction: sliding masses with Stribeck friction, one between stops, one from a table."""

    stop1: translational.MassWithStopAndFriction = translational.MassWithStopAndFriction(m=1.0, L=1.0, s=0.0, v=0.0)
    force: translational.Force = part()
    stop2: translational.MassWithStopAndFriction = translational.MassWithStopAndFriction(
        m=1.0, L=1.0, F_Coulomb=3.0, F_Stribeck=5.0, smax=0.9, smin=-0.9, s=0.0, v=-5.0
    )
    spring: translational.Spring = translational.Spring(c=500.0, s_rel0=1.0)
    wall: translational.Fixed = translational.Fixed(s0=-1.75)
    mass: translational.Mass = translational.Mass(m=1.0, L=1.0, s=0.0, v=0.0)
    supportFriction: translational.SupportFriction = translational.SupportFriction(f_pos=STRIBECK)
    force2: translational.Force = part()

    def build(self) -> None:
        drive = 25.0 * sin(0.5 * math.pi * time)
        self.force, self.force2 = translational.Force(u=drive), translational.Force(u=drive)

    def equations(self) -> Equations:
        yield connect(self.force.flange, self.stop1.flange_b)
        yield connect(self.wall.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.stop2.flange_a)
        yield connect(self.force2.flange, self.mass.flange_b)
        yield connect(self.mass.flange_a, self.supportFriction.flange_b)


def changes(folder: Path, name: str) -> list[tuple[float, float]]:
    """Instants at which a published mode signal changes, and to what; what it is in passing does not count."""
    with (folder / "reference.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    found = [(float(r["time"]), float(r[name])) for r in rows]
    after = [*found[1:], (math.inf, 0.0)]
    lasting = [a for a, b in zip(found, after, strict=True) if b[0] - a[0] > 1e-6]
    return [b for a, b in pairwise(lasting) if a[1] != b[1]]


def sequence(result: acausal.Result, name: str) -> list[tuple[float, float]]:
    """The same of a result."""
    mode = result[name]
    at = np.flatnonzero(np.diff(mode) != 0.0) + 1
    return [(float(result.time[k]), float(mode[k])) for k in at]


@pytest.mark.parametrize(
    ("name", "model", "modes"),
    [
        ("Rotational_Friction", Friction, ("brake.mode", "clutch.mode")),
        pytest.param(
            "Translational_Friction",
            StribeckFriction,
            ("stop1.mode", "stop2.mode", "supportFriction.mode"),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_published_solution_and_modes_are_met(
    reference: Path, name: str, model: type[Component], modes: tuple[str, ...]
) -> None:
    folder = reference / "msl" / name
    r = met(model(), folder, 2e-3, file="reference.csv", without=modes)
    for mode in modes:
        found, expected = sequence(r, mode), changes(folder, mode)
        assert [m for _, m in found] == [m for _, m in expected], (mode, found, expected)
        np.testing.assert_allclose([t for t, _ in found], [t for t, _ in expected], rtol=0, atol=1e-4)


def test_one_way_clutch_meets_the_converged_solution(reference: Path) -> None:
    r = met(OneWayClutch(), reference / "msl" / "Rotational_OneWayClutch")
    assert r["oneWayClutch.w_rel"].min() > -1e-7
