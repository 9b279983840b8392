"""Events where a run has nothing to integrate, and where it ends."""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, Real, connect, der, discrete, fixed, reset, sample, variable, when
from acausal.library.electrical import Ground, IdealDiode, Resistor, SineVoltage


class HalfWave(Component):
    """A diode between a source of 50 Hz and a resistor: no state at all."""

    source: SineVoltage = SineVoltage(V=10.0, f=50.0)
    diode: IdealDiode = IdealDiode()
    load: Resistor = Resistor(R=10.0)
    ground: Ground = Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.diode.p)
        yield connect(self.diode.n, self.load.p)
        yield connect(self.load.n, self.source.n, self.ground.p)


@pytest.mark.parametrize("solver", ["auto", "idas", "rosenbrock"])
def test_a_rectifier_without_states(solver: str) -> None:
    """The diode changes at every zero crossing of the source; its 1e-5 Ohm takes a millionth of the peak."""
    r = acausal.simulate(HalfWave(), stop_time=0.095, solver=solver)
    assert [e.time for e in r.events] == pytest.approx([0.01 * k for k in range(1, 10)], abs=1e-9)
    assert r.at(0.005, "load.v") == pytest.approx(10.0 / (1 + 1e-6), rel=1e-9)
    assert r["load.v"].min() > -1.1e-3  # the leakage of 1e-5 S


class Stairs(Component):
    """n counts samples, x is its integral."""

    n: Real = discrete()
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.n
        yield when(sample(0.0, 0.25), reset(self.n, self.n + 1))


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_a_sample_at_the_stop_time_acts(solver: str) -> None:
    """Five samples from 0 to 1; x = (1 + 2 + 3 + 4) / 4."""
    r = acausal.simulate(Stairs(), stop_time=1.0, solver=solver)
    assert r.final("n") == 5.0
    assert r.final("x") == pytest.approx(2.5, rel=1e-6)
