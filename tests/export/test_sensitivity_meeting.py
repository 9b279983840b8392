"""Events that meet at one instant: parameters move each of them alone, and closed forms say by how much.

A ball from h0 hits the floor at t1 = sqrt(2 h0 / g) with v1 = g t1; then h = e v1 s - g s^2 / 2 with s = t - t1.
"""

from __future__ import annotations

import math
from typing import Literal

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
    parameter,
    part,
    pre,
    reset,
    sample,
    time,
    variable,
    when,
    where,
)
from acausal.errors import ExportError
from acausal.library.electrical import Capacitor, Ground, IdealDiode, Resistor, SineVoltage

G, E, H = 9.81, 0.8, 1.0
METHODS: list[Literal["forward", "adjoint"]] = ["forward", "adjoint"]


class Ball(Component):
    """Dropped from h0."""

    g: Real = parameter(default=G)
    e: Real = parameter(default=E)
    h0: Real = parameter(default=H)
    h: Real = variable()
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -self.g
        yield when(self.h < 0, reset(self.v, -self.e * pre(self.v)))

    def initial_equations(self) -> Equations:
        yield self.h == self.h0


class Balls(Component):
    """Two that hit the floor at one instant."""

    a: Ball = Ball()
    b: Ball = Ball()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("native", [False, True])
def test_a_parameter_of_one_ball_moves_the_impact_of_that_ball_only(
    method: Literal["forward", "adjoint"], native: bool
) -> None:
    t = 1.0
    s = t - math.sqrt(2 * H / G)
    v1 = math.sqrt(2 * G * H)
    by_h0 = E * math.sqrt(G / (2 * H)) * s - (E * v1 - G * s) / math.sqrt(2 * G * H)
    found = acausal.sensitivities(
        Balls(), ["a.h0", "b.h0", "a.e"], ["a.h", "b.h"], stop_time=t, method=method, native=native, times=[t]
    )
    expected = [[by_h0, 0.0, v1 * s], [0.0, by_h0, 0.0]]
    np.testing.assert_allclose(found.final, expected, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found.along[0], expected, rtol=1e-8, atol=1e-9)
    assert np.isnan(found.of_event_times[0, :2]).all()  # one event of the run, with two instants


class Both(Component):
    """n rises once x and y, of the rates p r and q r, have both passed 1: from the later of two instants."""

    p: Real = parameter(default=1.0)
    q: Real = parameter(default=1.0)
    r: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    n: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.p * self.r
        yield der(self.y) == self.q * self.r
        yield der(self.n) == where((self.x > 1.0) & (self.y > 1.0), 1.0, 0.0)


@pytest.mark.parametrize("method", METHODS)
def test_events_whose_order_matters_are_refused_unless_they_move_alike(method: Literal["forward", "adjoint"]) -> None:
    """n(2) = 2 - max(1/(p r), 1/(q r))."""
    with pytest.raises(ExportError, match="AC615") as refused:
        acausal.sensitivities(Both(), ["p"], ["n"], stop_time=2.0, method=method)
    assert "p moves apart" in str(refused.value)
    found = acausal.sensitivities(Both(), ["r"], ["n"], stop_time=2.0, method=method)
    assert found.final[0, 0] == pytest.approx(1.0, rel=1e-8)


class Alone(Component):
    """n rises while y, of the rate q, is the only one of three that has passed 1."""

    q: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    z: Real = variable(default=fixed(0.0))
    n: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == self.q
        yield der(self.z) == 1.0
        yield der(self.n) == where((self.y > 1.0) & ~(self.x > 1.0) & ~(self.z > 1.0), 1.0, 0.0)


def test_of_three_events_all_orders_are_compared() -> None:
    """n = max(0, 1 - 1/q): x before y and y before z leave it zero, in this order and in the reverse of it."""
    with pytest.raises(ExportError, match="AC615"):
        acausal.sensitivities(Alone(), ["q"], ["n"], stop_time=2.0)


class Ticking(Component):
    """x = p t passes 1 at a tick, which is the switching time of a source, too."""

    p: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.0))
    n: Real = variable(default=fixed(0.0))
    k: Real = discrete(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.p
        yield der(self.n) == where(self.x > 1.0, 3.0, 0.0) + where(time > 1.0, 2.0, 0.0) + self.k
        yield when(sample(0.5, 0.5), reset(self.k, pre(self.k) + 0.1))


@pytest.mark.parametrize("method", METHODS)
def test_a_relation_that_meets_a_known_instant_moves_alone(method: Literal["forward", "adjoint"]) -> None:
    """n(1.75) = 3 (1.75 - 1/p) + 2 (1.75 - 1) + terms of the samples."""
    found = acausal.sensitivities(Ticking(), ["p"], ["n", "k"], stop_time=1.75, method=method)
    np.testing.assert_allclose(found.final, [[3.0], [0.0]], rtol=1e-8, atol=1e-9)


class Rectifier(Component):
    """Half a bridge: two diodes of 1e-5 Ohm in series, which block together, charge a capacitor."""

    R: Real = parameter(default=50.0)
    source: SineVoltage = part()
    diodes: list[IdealDiode] = part()
    inner: Resistor = part()
    capacitor: Capacitor = Capacitor(C=1e-3, v=fixed(0.0))
    load: Resistor = part()
    ground: Ground = Ground()

    def build(self) -> None:
        self.source, self.inner, self.load = SineVoltage(V=10.0, f=50.0), Resistor(R=0.5), Resistor(R=self.R)
        self.diodes = [IdealDiode(), IdealDiode()]

    def equations(self) -> Equations:
        first, second = self.diodes
        yield connect(self.source.p, self.inner.p)
        yield connect(self.inner.n, first.p)
        yield connect(first.n, self.capacitor.p, self.load.p)
        yield connect(self.capacitor.n, self.load.n, second.p)
        yield connect(second.n, self.source.n, self.ground.p)


def test_diodes_that_block_together_are_differentiated() -> None:
    """Against differences of runs."""
    model = acausal.compile(Rectifier())
    found = acausal.sensitivities(model, ["R", "inner.R"], ["capacitor.v"], stop_time=0.03).final[0]
    for name, value, derivative in (("R", 50.0, found[0]), ("inner.R", 0.5, found[1])):
        ends = [
            acausal.simulate(model, parameters={name: value * k}, stop_time=0.03, tolerance=1e-10).final("capacitor.v")
            for k in (1.001, 0.999)
        ]
        assert derivative == pytest.approx((ends[0] - ends[1]) / (0.002 * value), rel=1e-4)
