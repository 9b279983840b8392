"""Starts that cannot be: of what follows from the equations at every time, off a constraint, at a zero factor."""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, Real, connect, der, fixed, guess, variable
from acausal.library.electrical import Capacitor, ConstantVoltage, Ground
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.bad_start("AC302", "capacitor.v", "Capacitor(C=1.0, v=fixed(1.0))")
class AtASource(Component):
    """A capacitor beside an ideal source has the voltage of that, from the start on."""

    source: ConstantVoltage = ConstantVoltage(V=5.0)
    capacitor: Capacitor = Capacitor(C=1.0, v=fixed(1.0))
    ground: Ground = Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.capacitor.p)
        yield connect(self.source.n, self.capacitor.n, self.ground.p)


@corpus.bad_start("AC302", "x * x + y * y == 1", "yield self.x * self.x + self.y * self.y == 1.0")
class OffTheCircle(Component):
    """A pendulum of index 3, started beside its circle."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(1.0))
    v: Real = variable()
    w: Real = variable()
    tension: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.y) == self.w
        yield der(self.v) == -self.tension * self.x
        yield der(self.w) == -self.tension * self.y - 9.81
        yield self.x * self.x + self.y * self.y == 1.0


@corpus.bad_start("AC302", "d/dt (x * x + y * y == 1)", "yield self.x * self.x + self.y * self.y == 1.0")
class OffTheTangent(Component):
    """A pendulum of index 3 on its circle that starts with a velocity across it."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=guess(0.0))
    v: Real = variable(default=fixed(1.0))
    w: Real = variable(default=fixed(0.0))
    tension: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.y) == self.w
        yield der(self.v) == -self.tension * self.x
        yield der(self.w) == -self.tension * self.y - 9.81
        yield self.x * self.x + self.y * self.y == 1.0


@corpus.bad_start("AC304", "y", "yield self.y * self.x == 1.0")
class ZeroFactor(Component):
    """y x = 1 where x starts at zero."""

    x: Real = variable(default=fixed(0.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.y * self.x == 1.0


@corpus.bad_start("AC301", "x", "yield self.x * self.x == -1.0")
class NoRoot(Component):
    """x^2 = -1."""

    x: Real = variable(default=guess(1.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield self.x * self.x == -1.0
        yield der(self.y) == self.x


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()


def test_newtons_method_fails_in_silence(capfd: pytest.CaptureFixture[str]) -> None:
    """CasADi printed a line for every point that was not finite, a thousand of them."""
    with pytest.raises(acausal.AcausalError):
        acausal.simulate(NoRoot(), stop_time=0.1)
    assert not capfd.readouterr().err
